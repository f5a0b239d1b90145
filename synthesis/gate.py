"""The gate: a candidate passes only on a certificate that holds (prop:certification_gate) or a regional proof."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from inc_casadi import INC, Box, Plant, Polytope, Spec, Uniform
from inc_casadi.certificate import Certificate
from inc_casadi.certify import certify
from inc_casadi.claims import DiscountedCost, Regional
from inc_casadi.errors import InvalidInputError, SolverError
from inc_casadi.output_range import output_range, within_limits
from inc_casadi.pieces.walk import Budget
from inc_casadi.regional_certificate import RegionalCertificate, certify_region

from .causes import Cause, cause_of


@dataclass(frozen=True, eq=False)
class Verdict:
    """What the gate says of a candidate.

    certificate: the one that holds with the lowest cost, or None; cost: its certified expected cost, infinite without;
    proofs: what is proved, in words; refusals: what is not, each with its reason; causes: the same, one word each.
    """

    certificate: Certificate | None
    cost: float
    proofs: tuple[str, ...]
    refusals: tuple[str, ...]
    causes: tuple[Cause, ...] = ()

    @property
    def accepted(self) -> bool:
        """Whether the candidate is certified."""
        return self.certificate is not None


def gate(plant: Plant, spec: Spec, inc: INC, budget: Budget | None = None) -> Verdict:
    """Try the exact regional proof, then, where input limits are built in or absent, the global LMI.

    The former states the exact cost, so nothing can be gained from the latter when it holds; in more than 8 dimensions it
    states the largest cost only, and the lower bound of the two is taken. The optimizer that made
    the candidate plays no part in the verdict.
    """
    posed = inc.well_posedness()
    if not posed.holds:
        return Verdict(None, np.inf, (), (f"well-posedness: {posed.test}",), (Cause.ILL_POSED,))
    proofs = (f"well posed: {posed.test}",)
    refused: list[Refused] = []
    passed: list[Passed] = []
    for attempt in (_by_pieces, _by_inequality):
        found = attempt(plant, spec, inc, budget)
        if isinstance(found, Refused):
            refused.append(found)
            continue
        passed.append(found)
        if not found.by_worst:
            break
    reasons, causes = tuple(one.reason for one in refused), tuple(one.cause for one in refused)
    if not passed:
        return Verdict(None, np.inf, proofs, reasons, causes)
    best = min(passed, key=lambda one: one.certificate.bound)
    return Verdict(best.certificate, best.certificate.bound, (*proofs, *best.words), reasons, causes)


class Passed(NamedTuple):
    """What one way of proof gave: a certificate that holds, and what it proves in words."""

    certificate: Certificate
    words: list[str]

    @property
    def by_worst(self) -> bool:
        """Whether it bounds the expected cost by the largest only, which an inequality may undercut."""
        return isinstance(self.certificate, RegionalCertificate) and not np.isfinite(self.certificate.expected)


class Refused(NamedTuple):
    """Why one way of proof gave nothing."""

    reason: str
    cause: Cause


def _by_pieces(plant: Plant, spec: Spec, inc: INC, budget: Budget | None) -> Passed | Refused:
    if not isinstance(spec.initial, Uniform) or not isinstance(spec.initial.support, Box | Polytope):
        return Refused("exact pieces: the initial distribution is not uniform over a polytope", Cause.HOPELESS)
    claim = Regional(spec.initial, spec.inputs, spec.Q, spec.R, spec.discount)
    try:
        certificate = certify_region(plant, inc, claim, budget)
        reason = certificate.reason
    except InvalidInputError as error:  # a box of many dimensions has too many simplices
        return Refused(f"exact pieces: {error}", Cause.HOPELESS)
    if reason:
        return Refused(f"exact pieces: {reason}", cause_of(certificate))
    assert certificate.walk is not None
    pieces = len(certificate.walk.arrived)
    words = [f"converges from every initial state: exact subdivision, {pieces} pieces"]
    if spec.inputs is not None:
        words.insert(0, "input limits kept on every motion: exact subdivision")
    costs = "expected and worst cost" if np.isfinite(certificate.expected) else "worst cost, which bounds the expected one"
    return Passed(certificate, [*words, f"{costs}: exact subdivision"])


def _by_inequality(plant: Plant, spec: Spec, inc: INC, _: Budget | None) -> Passed | Refused:
    unstable = float(np.max(np.abs(np.linalg.eigvals(plant.A)))) >= 1
    bounded = all(np.isfinite(float(end)) for pair in output_range(inc) for end in pair)
    if bounded and unstable:
        return Refused("global LMI: the input is bounded, and no bounded input stabilizes this unstable plant globally",
                       Cause.HOPELESS)
    if spec.inputs is not None and not within_limits(inc, spec.inputs):
        return Refused("global LMI: the input limits are not built into the controller", Cause.HOPELESS)
    try:
        certificate = certify(plant, inc, DiscountedCost(spec.Q, spec.R, spec.discount, spec.initial))
    except SolverError as error:
        return Refused(f"global LMI: {error}", Cause.HOPELESS)
    if not certificate.holds():
        return Refused(f"global LMI: {certificate.reason}", Cause.UNCERTIFIED)
    words = ["expected cost: linear matrix inequality, for every initial state"]
    if spec.inputs is not None:
        words.insert(0, "input limits kept everywhere: the range of the activations")
    return Passed(certificate, words)
