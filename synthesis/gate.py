"""The gate: a candidate passes only on a certificate that holds (prop:certification_gate) or a regional proof."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inc_casadi import INC, Box, Plant, Polytope, Spec, Uniform
from inc_casadi.activations.stack import groups
from inc_casadi.arrays import Array
from inc_casadi.certificate import Certificate
from inc_casadi.certify import certify
from inc_casadi.claims import DiscountedCost, Regional
from inc_casadi.errors import InvalidInputError, SolverError
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
    """Try the exact regional proof and, where input limits are built in or absent, the global LMI; keep the better.

    The optimizer that made the candidate plays no part in the verdict.
    """
    posed = inc.well_posedness()
    if not posed.holds:
        return Verdict(None, np.inf, (), (f"well-posedness: {posed.test}",))
    proofs = [f"well posed: {posed.test}"]
    accepted: list[tuple[Certificate, list[str]]] = []
    refusals: list[str] = []
    for attempt in (_by_pieces, _by_inequality):
        certificate, words, why = attempt(plant, spec, inc, budget, bool(accepted))
        if certificate is not None:
            accepted.append((certificate, words))
        elif why:
            refusals.append(why)
    if not accepted:
        return Verdict(None, np.inf, tuple(proofs), tuple(refusals))
    best, words = min(accepted, key=lambda pair: pair[0].bound)
    return Verdict(best, best.bound, tuple(proofs + words), tuple(refusals))


Attempted = tuple[Certificate | None, list[str], str]


def _by_pieces(plant: Plant, spec: Spec, inc: INC, budget: Budget | None, _: bool) -> Attempted:
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
    pieces = len(certificate.walk.done)  # type: ignore[attr-defined]
    words = [f"converges from every initial state: exact subdivision, {pieces} pieces"]
    if spec.inputs is not None:
        words.insert(0, "input limits kept on every motion: exact subdivision")
    return certificate, [*words, "expected and worst cost: exact subdivision"], ""


def _by_inequality(plant: Plant, spec: Spec, inc: INC, _: Budget | None, proved: bool) -> Attempted:
    unstable = float(np.max(np.abs(np.linalg.eigvals(plant.A)))) >= 1
    low, high = output_range(inc)
    bounded = bool(np.all(np.isfinite(low)) and np.all(np.isfinite(high)))
    if proved:
        return None, [], ""
    if bounded and unstable:
        return None, [], "global LMI: the input is bounded, and no bounded input stabilizes this unstable plant globally"
    if spec.inputs is not None and not _within(spec.inputs, low, high):
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


def output_range(inc: INC) -> tuple[Array, Array]:
    """Return bounds (m,), (m,) on u = K y + V eta + d over all y, from the range of the activations; may be infinite.

    >>> low, high = output_range(INC.saturated([[2.0]], 3.0))
    >>> low.tolist(), high.tolist()
    ([-3.0], [3.0])
    """
    ends = np.zeros((inc.q, 2))
    for unit, rows in groups(inc.activations):
        ends[rows] = unit.bounds
    used = np.any(inc.V != 0, axis=0)
    V = inc.V[:, used]
    products = V[:, :, None] * ends[used][None]
    free = np.any(inc.K != 0, axis=1)
    low = np.where(free, -np.inf, inc.d + _sum(products, V, np.min))
    high = np.where(free, np.inf, inc.d + _sum(products, V, np.max))
    return low, high


def _sum(products: Array, V: Array, pick: object) -> Array:
    picked = pick(np.where((V == 0)[:, :, None], 0.0, products), axis=2)  # type: ignore[operator]
    return picked.sum(axis=1)


def _within(inputs: Box | Polytope, low: Array, high: Array) -> bool:
    """Whether the whole box [low, high] lies in the input set: each half-space at its worst corner, up to rounding."""
    if not (np.all(np.isfinite(low)) and np.all(np.isfinite(high))):
        return False
    worst = np.where(inputs.H > 0, inputs.H * high, inputs.H * low).sum(axis=1)
    return bool(np.all(worst <= inputs.h + 1e-12 * np.maximum(1.0, np.abs(inputs.h))))
