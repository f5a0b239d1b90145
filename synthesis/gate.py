"""The gate: a candidate passes only on a certificate that holds (prop:certification_gate) or a regional proof."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inc_casadi import INC, Box, Plant, Polytope, Spec, Uniform
from inc_casadi.certificate import Certificate
from inc_casadi.certify import certify
from inc_casadi.claims import DiscountedCost, Regional
from inc_casadi.errors import InvalidInputError, SolverError
from inc_casadi.output_range import output_range, within_limits
from inc_casadi.pieces.walk import Budget


@dataclass(frozen=True, eq=False)
class Verdict:
    """What the gate says of a candidate.

    certificate: the one that holds with the lowest cost, or None; cost: its certified expected cost, infinite without;
    proofs: what is proved, in words; refusals: what is not, each with its reason.
    """

    certificate: Certificate | None
    cost: float
    proofs: tuple[str, ...]
    refusals: tuple[str, ...]

    @property
    def accepted(self) -> bool:
        """Whether the candidate is certified."""
        return self.certificate is not None


def gate(plant: Plant, spec: Spec, inc: INC, budget: Budget | None = None) -> Verdict:
    """Try the exact regional proof, then, where input limits are built in or absent, the global LMI.

    The former states the exact cost, so nothing can be gained from the latter when it holds. The optimizer that made
    the candidate plays no part in the verdict.
    """
    posed = inc.well_posedness()
    if not posed.holds:
        return Verdict(None, np.inf, (), (f"well-posedness: {posed.test}",))
    proofs = [f"well posed: {posed.test}"]
    refusals: list[str] = []
    for attempt in (_by_pieces, _by_inequality):
        certificate, words, why = attempt(plant, spec, inc, budget)
        if certificate is not None:
            return Verdict(certificate, certificate.bound, (*proofs, *words), tuple(refusals))
        refusals.append(why)
    return Verdict(None, np.inf, tuple(proofs), tuple(refusals))


Attempted = tuple[Certificate | None, list[str], str]


def _by_pieces(plant: Plant, spec: Spec, inc: INC, budget: Budget | None) -> Attempted:
    if not isinstance(spec.initial, Uniform) or not isinstance(spec.initial.support, Box | Polytope):
        return None, [], "exact pieces: the initial distribution is not uniform over a polytope"
    claim = Regional(spec.initial, spec.inputs, spec.Q, spec.R, spec.discount)
    try:
        certificate = certify(plant, inc, claim, budget=budget)
        reason = certificate.reason
    except InvalidInputError as error:  # a box of many dimensions has too many simplices
        return None, [], f"exact pieces: {error}"
    if reason:
        return None, [], f"exact pieces: {reason}"
    if not np.isfinite(certificate.bound):
        return None, [], f"exact pieces: the expected cost is not worked out in {plant.n} dimensions"
    pieces = len(certificate.walk.arrived)  # type: ignore[attr-defined]
    words = [f"converges from every initial state: exact subdivision, {pieces} pieces"]
    if spec.inputs is not None:
        words.insert(0, "input limits kept on every motion: exact subdivision")
    return certificate, [*words, "expected and worst cost: exact subdivision"], ""


def _by_inequality(plant: Plant, spec: Spec, inc: INC, _: Budget | None) -> Attempted:
    unstable = float(np.max(np.abs(np.linalg.eigvals(plant.A)))) >= 1
    bounded = all(np.isfinite(float(end)) for pair in output_range(inc) for end in pair)
    if bounded and unstable:
        return None, [], "global LMI: the input is bounded, and no bounded input stabilizes this unstable plant globally"
    if spec.inputs is not None and not within_limits(inc, spec.inputs):
        return None, [], "global LMI: the input limits are not built into the controller"
    try:
        certificate = certify(plant, inc, DiscountedCost(spec.Q, spec.R, spec.discount, spec.initial))
    except SolverError as error:
        return None, [], f"global LMI: {error}"
    if not certificate.holds():
        return None, [], f"global LMI: {certificate.reason}"
    words = ["expected cost: linear matrix inequality, for every initial state"]
    if spec.inputs is not None:
        words.insert(0, "input limits kept everywhere: the range of the activations")
    return certificate, words, ""
