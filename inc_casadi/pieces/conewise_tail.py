"""Terminal sets around equilibria on kinks: an ellipsoid from which a matrix certificate answers for all that follows."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import sqrt

import numpy as np

from ..activations import Activation
from ..activations.stack import slopes
from ..arrays import Array
from ..blocks import exact
from ..certificate import MatrixCertificate
from ..claims.performance import DiscountedCost
from ..claims.regional import Regional
from ..errors import InvalidInputError
from ..exact import is_positive_definite
from ..inc import INC
from ..plant import Plant
from ..well_posed import is_proved
from .conewise import ConewiseLaw, rooms
from .laws import PiecewiseLoop
from .terminal import TerminalSet

LEAST_SHARE = 2.0**-60


@dataclass(frozen=True, eq=False)
class ConewiseProof:
    """Two costs, certified for every motion of the conewise linear loop around an equilibrium: why a terminal set is one.

    settling: a `DiscountedCost` without discount, with M > 0 in place of Q. It says e_0'P e_0 >= sum_k e_k'M e_k. So from
    {e'P e <= level} every motion stays within {e'M e <= level} for ever, and converges. Where that set keeps the room of
    every kink and input limit (`conewise.rooms`), the conewise linear loop is the loop itself, step by step. P may be that
    of any multiplier: the Lyapunov function behind it need not be a quadratic form in e.
    cost: a `DiscountedCost` with the weights and the discount of the claim, e_0'P e_0 at least the discounted cost of the
    deviations; or None, where M >= Q and the same R make `settling` answer for that too.

    Raises InvalidInputError when they are not certificates of discounted costs.
    """

    settling: MatrixCertificate
    cost: MatrixCertificate | None = None

    def __post_init__(self) -> None:
        for name, part in (("settling", self.settling), ("cost", self.cost)):
            expected = isinstance(part, MatrixCertificate) and isinstance(part.claim, DiscountedCost)
            if not expected and not (name == "cost" and part is None):
                raise InvalidInputError(f"{name} is {part!r}, but must be a certificate of a DiscountedCost")

    @property
    def P(self) -> Array:
        """The matrix of the ellipsoids that motions settle from."""
        return _bounding(self.settling)

    @property
    def M(self) -> Array:
        """The matrix of the ellipsoids that they stay in."""
        return self.settling.claim.Q  # type: ignore[attr-defined]

    @property
    def parts(self) -> tuple[MatrixCertificate, ...]:
        """The certificates there are."""
        return (self.settling,) if self.cost is None else (self.settling, self.cost)


def _bounding(certificate: MatrixCertificate) -> Array:
    """The matrix whose form bounds the cost: P, or P_0 where the Lyapunov function depends on hidden vectors."""
    return certificate.values.get("P_0", certificate.values["P"])


def terminal_set(loop: PiecewiseLoop, claim: Regional, local: ConewiseLaw, proof: ConewiseProof,
                 level: float) -> TerminalSet | None:
    """Return the set {e'P e <= level} with a bound on the cost from there, or None when resting costs for ever.

    With p bounding the discounted cost of deviations, c = x*'Q x* + u*'R u* and 2 ab <= t a^2 + b^2 / t (t in (0, 1]),

        (1 - t) c / (1 - beta) - (1 / t - 1) e'p e  <=  cost from x* + e  <=  (1 + t) c / (1 - beta) + (1 + 1/t) e'p e,

    of which the right side is `tail` and the difference `excess`. Where resting costs nothing, the cost is between 0 and
    e'p e. t is about the square root of the largest ratio of the two terms. In the numbers of the loop: exact in Fractions.
    """
    form = _tail(claim, local, proof, level)
    if form is None:
        return None
    number = loop.numbers
    pattern = np.array([_piece(unit, z) for unit, z in zip(loop.inc.activations, local.z, strict=True)], dtype=int)
    tail, excess = (number(part) for part in form)
    return TerminalSet(pattern, number(local.x), number(proof.P), number(np.array(level)).item(), tail, excess)


def _piece(unit: Activation, level: Fraction) -> int:
    assert unit.pieces is not None, "exact pieces are asked of piecewise-affine units only"
    return sum(bool(level >= kink) for kink in exact(unit.pieces.kinks))


def _tail(claim: Regional, local: ConewiseLaw, proof: ConewiseProof, level: float) -> tuple[np.ndarray, np.ndarray] | None:
    """The tail and what it may be too much by, as forms (n + 1, n + 1) in (e, 1), in Fractions."""
    n, beta = len(local.x), Fraction(claim.discount)
    costs = bool(claim.Q.any() or claim.R.any())
    p = exact(_bounding(proof.cost or proof.settling)) * Fraction(int(costs))
    rest = local.x @ exact(claim.Q) @ local.x + local.u @ exact(claim.R) @ local.u
    tail, excess = (np.full((n + 1, n + 1), Fraction(0), dtype=object) for _ in range(2))
    if rest == 0:
        tail[:n, :n] = excess[:n, :n] = p
        return tail, excess
    if beta == 1:
        return None
    for_ever = rest / (1 - beta)
    t = Fraction(min(1.0, max(LEAST_SHARE, sqrt(level / float(for_ever)))))
    tail[:n, :n], tail[n, n] = (1 + 1 / t) * p, (1 + t) * for_ever
    excess[:n, :n], excess[n, n] = 2 / t * p, 2 * t * for_ever
    return tail, excess


def refusal(loop: PiecewiseLoop, claim: Regional, local: ConewiseLaw, proof: ConewiseProof, level: float,
            built_in: bool, prove: bool) -> str | None:
    """Return why the set {e'P e <= level} is not a terminal set, or None.

    built_in: whether the law cannot leave the input limits at all, so that these need no room; prove: whether the matrix
    certificates are to be proved (`MatrixCertificate.prove`) or to hold. All else is decided in Fractions either way.
    """
    wrong = _mismatch(loop.plant, claim, local, proof)
    if wrong:
        return wrong
    for part in proof.parts:
        reason = part.prove().reason if prove else part.reason
        if reason:
            return f"for the conewise linear loop around the equilibrium: {reason}"
    if prove and not is_proved(local.inc.well_posedness(), local.inc.W, slopes(local.inc.activations)):
        return f"the law around the equilibrium is not proved well posed: {local.inc.well_posedness().test}"
    for room in rooms(loop.plant, loop.inc, local, None if built_in else claim.inputs, proof.M):
        if not room.holds(Fraction(level)):
            return f"the terminal ellipsoid is too large to stay away from {room.name}"
    if _tail(claim, local, proof, level) is None:
        return "resting at the exact equilibrium costs something at every step, and discount = 1"
    return None


def _mismatch(plant: Plant, claim: Regional, local: ConewiseLaw, proof: ConewiseProof) -> str:
    """What the certificates speak of that is not this loop or this claim."""
    for part in proof.parts:
        if not (_same_plant(part.plant, plant) and _same_law(part.inc, local.inc)):
            return "the matrix certificate speaks of another loop than the one around the equilibrium"
    settling = proof.settling.claim
    assert isinstance(settling, DiscountedCost)
    if settling.discount != 1.0 or not is_positive_definite(exact(settling.Q)) or not is_semidefinite(exact(settling.R)):
        return "the settling certificate does not bound the sum of a positive definite form"
    moved = local.x.any() or local.u.any()
    if moved and not (is_semidefinite(exact(claim.Q)) and is_semidefinite(exact(claim.R))):
        return "Q or R of the claim is positive semidefinite up to rounding only, and resting costs something"
    if proof.cost is None:
        if not _covers(settling.Q, claim.Q) or not _covers(settling.R, claim.R):
            return "the settling certificate does not cover the cost of the claim"
        return ""
    cost = proof.cost.claim
    assert isinstance(cost, DiscountedCost)
    same = np.array_equal(cost.Q, claim.Q) and np.array_equal(cost.R, claim.R) and cost.discount == claim.discount
    return "" if same else "the cost certificate has other weights or another discount than the claim"


def _covers(larger: Array, smaller: Array) -> bool:
    """Whether the difference is positive definite, or zero."""
    return np.array_equal(larger, smaller) or is_positive_definite(exact(larger) - exact(smaller))


def is_semidefinite(matrix: np.ndarray) -> bool:
    """Return whether a symmetric matrix of Fractions is positive semidefinite, by symmetric elimination.

    A zero on the diagonal of what is left needs zeros in its row, since every 2 x 2 minor must be nonnegative.

    >>> is_semidefinite(exact(np.ones((2, 2)))), is_semidefinite(exact(np.array([[0.0, 1.0], [1.0, 1.0]])))
    (True, False)
    """
    left = matrix
    while len(left):
        pivot, row = left[0, 0], left[0, 1:]
        if pivot < 0 or (pivot == 0 and row.any()):
            return False
        left = left[1:, 1:] if pivot == 0 else left[1:, 1:] - np.outer(row, row) / pivot
    return True


def _same_plant(one: Plant, other: Plant) -> bool:
    return one.discrete and other.discrete and all(np.array_equal(getattr(one, name), getattr(other, name))
                                                   for name in "ABC")


def _same_law(one: INC, other: INC) -> bool:
    return one.activations == other.activations and all(np.array_equal(getattr(one, name), getattr(other, name))
                                                        for name in "WUVKbd")
