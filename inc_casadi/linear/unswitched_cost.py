"""The certified cost of a law that stays on one affine piece from every initial state, so that its loop is affine."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np

from ..activations.stack import lipschitz
from ..arrays import Array, symmetric
from ..certificate import Certificate, Proof
from ..claims.performance import rounded_up_trace
from ..errors import InvalidInputError
from ..exact import contracts
from ..figures import at_most
from ..inc import INC
from ..local.containment import hull_of, largest
from ..loop import fitting
from ..plant import Plant
from ..readings import Rounded
from ..sets import Ellipsoid
from ..spec import Spec
from .input_limits import limits_broken
from .lyapunov import discounted_sum
from .piece_inequalities import failing, margins_of, smallest_storages
from .piece_loop import PieceLoop, piece_loop

SETTLED = 1e-9  # share of the cost up to which a bound counts as the cost itself
_CONTINUOUS = "the cost is a sum over steps, but the plant is continuous (dt = 0): use plant.sampled(dt)"


@dataclass(frozen=True, eq=False)
class UnswitchedCost(Certificate):
    """A law that never leaves its affine piece around y = 0: limits, convergence and cost from every initial state.

    On the piece (`linear_piece`) u = u_0 + K y, so that e+ = F e for e = x - x*, x* the rest, and O e must stay within
    limits: the pre-activations of the hidden units between their kinks, and, unless the range of the law keeps them, the
    inputs. With the limits l_i of O e and D = diag(1 / l_i^2),

        W - F'W F - O'D O > 0 and W > 0      the loop is stable, and sum_{j >= k} |D^(1/2) O e_j|^2 <= e_k'W e_k,

    by which `limits_broken` shows that O e stays within its limits for ever, so that no unit switches on any motion. For the
    cost, s = x and s+ = F s, or where u_0 is not zero s = (x, 1) and s+ = F_s s; u = G s, and Q padded:

        P - discount F_s'P F_s - Q - G'R G > 0 and P > 0      the discounted cost from x_0 is at most s_0'P s_0,

    in expectation tr(P E s_0 s_0'), which is the cost up to rounding.

    Parameters
    ----------
    plant, spec, inc : what is claimed about
    P : (n, n), or (n + 1, n + 1) where u_0 is not zero; None when the loop is not stable in the discounted sense
    W : (n, n), None when the loop is not stable

    Notes
    -----
    Sufficient; of laws that switch it says nothing. Source: thm:performance, for a loop without hidden units.

    >>> from inc_casadi import Box
    >>> spec = Spec(Q=1.0, R=0.0, discount=0.5, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> found = unswitched_cost(Plant(1.5, 1.0), spec, INC.saturated([[-1.0]], 1.0))
    >>> round(found.bound, 9), found.holds(), bool(found.prove())  # 1 / (3 (1 - beta / 4)), thm:lsof_sep
    (0.380952381, True, True)
    >>> unswitched_cost(Plant(1.5, 1.0), spec, INC.saturated([[-1.2]], 1.0)).reason
    'at k = 0 unit 0 leaves its affine piece by 20 % of the way to there'
    """

    plant: Plant = field(repr=False)
    spec: Spec = field(repr=False)
    inc: INC = field(repr=False)
    P: Array | None = field(repr=False)
    W: Array | None = field(repr=False)

    def __post_init__(self) -> None:
        if not self.plant.discrete:
            raise InvalidInputError(_CONTINUOUS)
        fitting(self.plant, self.inc)
        self.spec.check(self.plant)
        n = self.plant.n
        if self.P is not None:
            object.__setattr__(self, "P", symmetric("P", self.P, n + (np.shape(self.P) == (n + 1, n + 1))))
        if self.W is not None:
            object.__setattr__(self, "W", symmetric("W", self.W, n))

    @cached_property
    def loop(self) -> PieceLoop | str:
        """The loop on the affine piece, or why there is none."""
        if not self.inc.contraction.contracts:
            return f"the fixed point is not proved unique by Perron-Frobenius: {self.inc.contraction.test} (thm:wellposed)"
        return piece_loop(self.plant, self.spec, self.inc)

    @property
    def bound(self) -> float:
        """The expected discounted cost at most, rounded up; infinite without P."""
        return np.inf if self._unfounded() else rounded_up_trace(self.P, self.loop.moment)  # type: ignore[union-attr,arg-type]

    @property
    def cost(self) -> float:
        """The expected cost itself, up to rounding; infinite when it does not converge."""
        if isinstance(self.loop, str):
            return np.inf
        P = discounted_sum(self.loop.read(Rounded).step.value, self.loop.stage, self.spec.discount)
        return np.inf if P is None else float(np.sum(P * self.loop.moment))

    @property
    def gap(self) -> float:
        """What the bound exceeds the cost by; 0 where that is rounding."""
        gap = self.bound - self.cost
        return 0.0 if gap <= SETTLED * self.bound < np.inf else gap

    @property
    def worst(self) -> tuple[float, Array]:
        """The largest cost from a corner of the initial set, rounded up, and that corner; NaN where they are not listed."""
        hull = hull_of(self.spec.initial)
        if isinstance(hull, str | Ellipsoid) or self._unfounded():
            return self.worst_bound, np.full(self.plant.n, np.nan)
        assert self.P is not None
        s = np.vstack([hull, np.ones((len(self.P) - len(hull), hull.shape[1]))])
        forms = np.ones((1, len(s))) @ ((self.P @ Rounded.lift(s)) * s)
        highest = (forms.value + forms.error)[0]
        return float(np.max(highest)), hull[:, int(np.argmax(highest))]

    @property
    def worst_bound(self) -> float:
        """The largest cost from any initial state at most, rounded up; infinite without P or where none is."""
        hull = hull_of(self.spec.initial)
        if isinstance(hull, str) or self.P is None or self._unfounded():
            return np.inf
        return _largest(hull, self.P) if isinstance(hull, Ellipsoid) else self.worst[0]

    @property
    def reason(self) -> str:
        """Why the certificate does not hold, or an empty string when it does."""
        unfounded = self._unfounded()
        if unfounded:
            return unfounded
        low = next(((name, value) for name, value in self.margins().items() if not value > 0), None)
        return f"the condition {low[0]!r} has the relative margin {low[1]:.3g}" if low is not None else self._switches()

    @property
    def sentence(self) -> str:
        """What is proved, in one sentence, or that nothing is."""
        reason = self.reason
        if reason:
            return f"Not certified: {reason}."
        limits = "" if self.spec.inputs is None else "keeps the input limits, "
        worst = f" and at most {at_most(self.worst_bound)} from any of them" if np.isfinite(self.worst_bound) else ""
        return (f"From every initial state this law {limits}stays on one affine piece, so that the motion is that of a "
                f"stable linear loop, and the discounted cost (discount {self.spec.discount:g}) is at most "
                f"{at_most(self.bound)} in expectation{worst}.")

    def margins(self) -> dict[str, float]:
        """Return the smallest eigenvalue of each condition, relative to its diagonal and with rounding taken off."""
        return {} if self._unfounded() else margins_of(self.loop, self.P, self.W)  # type: ignore[arg-type]

    def prove(self) -> Proof:
        """Settle all of it, in floats with every rounding bounded or, what these leave open, in exact arithmetic."""
        begun, method = perf_counter(), "none"
        reason = self._unfounded()
        if not reason:
            name, method = failing(self.loop, self.P, self.W)  # type: ignore[arg-type]
            reason = f"the condition {name!r} is not positive definite" if name else self._switches()
        return Proof(not reason, method, perf_counter() - begun, reason)

    def _unfounded(self) -> str:
        """What stands in the way before any inequality: no unique fixed point, no affine piece, no stable loop."""
        if isinstance(self.loop, str):
            return self.loop
        if not contracts(lipschitz(self.inc.activations), self.inc.W, self.inc.contraction.weights):
            return "the fixed point is not proved unique in exact arithmetic (thm:wellposed)"
        if self.P is None or self.W is None:
            radius = float(np.max(np.abs(np.linalg.eigvals(self.loop.read(Rounded).F.value))))
            return f"on its affine piece the loop has the spectral radius {radius:.9g}, and one well below 1 is needed"
        size = len(self.loop.Q)
        return "" if len(self.P) == size else f"P is {len(self.P)} x {len(self.P)}, but must be {size} x {size}"

    def _switches(self) -> str:
        """How a motion leaves the piece or the limits, in words."""
        loop = self.loop
        assert not isinstance(loop, str) and self.W is not None
        if not loop.names:
            return ""
        shift = loop.rest if loop.biased else None
        return limits_broken(loop, loop.facets, self.spec.initial, np.zeros(0), self.W, loop.names, shift)


def unswitched_cost(plant: Any, spec: Spec, inc: INC) -> UnswitchedCost:
    """Return what a law costs that never leaves its affine piece, with the numbers that prove it, or the reason against it.

    P = sum_k discount^k (F_s^k)'(Q + G'RG) F_s^k, raised by the least share from 1e-13 on that rounding allows to prove;
    likewise W = sum_k (F^k)'O'D O F^k.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    spec : Spec
    inc : the law; one without hidden units is affine everywhere

    Raises
    ------
    InvalidInputError : a continuous plant
    DimensionError : spec or law do not fit the plant
    """
    bare = UnswitchedCost(fitting(plant, inc), spec, inc, None, None)
    loop = bare.loop
    if isinstance(loop, str):
        return bare
    P, W = smallest_storages(loop, spec.discount)
    return replace(bare, P=P, W=W)


def _largest(hull: Ellipsoid, P: Array) -> float:
    """The largest s'P s over an ellipsoid, too large by 1e-7 at most: a form about its center where s = (x, 1)."""
    n = hull.dimension
    center = -np.linalg.solve(P[:n, :n], P[:n, n:].sum(axis=1))
    rest = float(P[n:, n:].sum() - center @ P[:n, :n] @ center)
    return largest(hull, P[:n, :n], center)[0] + rest + 1e-9 * abs(rest)
