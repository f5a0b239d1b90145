"""The certified cost of a law that is linear but for a few moves: what clipping adds to the cost of the linear loop."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np

from ..activations.stack import lipschitz
from ..arrays import Array, symmetric
from ..blocks import exact
from ..certificate import Certificate, Proof
from ..claims.performance import rounded_up_trace
from ..exact import contracts
from ..figures import at_most
from ..inc import INC
from ..local.containment import hull_of
from ..loop import fitting
from ..output_range import within_limits
from ..plant import Plant
from ..readings import Rounded
from ..sets import Ellipsoid
from ..spec import Spec
from .clipping_walk import Clipping, Parts, clipping
from .piece_inequalities import failing, margins_of, smallest_storages
from .piece_loop import PieceLoop, piece_loop

_UP = 1 + 1e-9  # covers the rounding of sums of a few thousand nonnegative numbers


@dataclass(frozen=True, eq=False)
class ClippedCost(Certificate):
    """A law of one layer that leaves its linear piece for a few moves only: limits, convergence, cost from all states.

    With W = 0, u = V phi(U y + b) + K y + d, and u = 0 at y = 0. Around there unit i is affine between two kinks, and what
    it does beyond is d_i: u = K_0 y - V d, |d_i| <= slope_i times how far z_i is beyond its kinks. So x+ = F x - B V d, and
    `clipping` bounds each move's d over all initial states, until no unit can leave its piece any more, by

        W > 0 and W - F'W F - O'D O > 0                                             (`UnswitchedCost`),

    which also proves that the motion converges then. With P - discount F'P F - Q - K_0'R K_0 > 0 and P > 0, and

        L = discount (B V)'P F + V'R K_0,    T = discount (B V)'P (B V) + V'R V,

    completing the square at each move and adding up shows, of every motion,

        sum_k discount^k (x_k'Q x_k + u_k'R u_k) <= x_0'P x_0 + sum_k discount^k (2 |d_k|'|L x_k| + d_k'T d_k),

    in expectation at most tr(P E x_0 x_0') + sum_k discount^k (2 first_k'along_k + second_k'|T| second_k). The input limits
    are built in, or there are none.

    Parameters
    ----------
    plant, spec, inc : what is claimed about; the initial states bounded
    P, W : (n, n), None when the loop is not stable

    Notes
    -----
    Sufficient: d is bounded move by move as if the moves did not depend on each other, which ends only where units leave
    their piece by little. The bound is above the cost by about what clipping adds, so nearly exact where that is rare.

    >>> from inc_casadi import Box
    >>> spec = Spec(Q=1.0, R=0.0, discount=0.5, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> found = clipped_cost(Plant(1.5, 1.0), spec, INC.saturated([[-1.25]], 1.0))
    >>> round(found.bound, 4), found.holds(), bool(found.prove())
    (0.3763, True, True)
    """

    plant: Plant = field(repr=False)
    spec: Spec = field(repr=False)
    inc: INC = field(repr=False)
    P: Array | None = field(repr=False)
    W: Array | None = field(repr=False)

    def __post_init__(self) -> None:
        fitting(self.plant, self.inc)
        self.spec.check(self.plant)
        for name in ("P", "W"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, symmetric(name, getattr(self, name), self.plant.n))

    @cached_property
    def loop(self) -> PieceLoop | str:
        """The loop on the linear piece, or why the certificate does not speak of such laws."""
        law = self.inc.without_idle_units()
        if not self.plant.discrete:
            return "the plant is continuous"
        if not self.inc.contraction.contracts or law.W.any():
            return "the law is not one of a single layer of hidden units, W = 0"
        if self.spec.inputs is not None and not within_limits(self.inc, self.spec.inputs):
            return "the input limits are not built into the law"
        loop = piece_loop(self.plant, self.spec, law)
        return "u is not zero at y = 0" if not isinstance(loop, str) and loop.biased else loop

    @property
    def linear(self) -> float:
        """What the linear loop costs, rounded up; the rest of the bound is for clipping. Infinite without P."""
        return np.inf if self.P is None else rounded_up_trace(self.P, self.spec.initial.second_moment)

    @property
    def bound(self) -> float:
        """The expected discounted cost at most, rounded up; infinite where clipping is not bounded."""
        if isinstance(self.clipping, str):
            return np.inf
        found = self.clipping
        added = self._added(found.first, found.along, found.second)
        return (self.linear + added) * _UP if added else self.linear

    @property
    def worst_bound(self) -> float:
        """The largest cost from any initial state at most; infinite where the corners are not listed."""
        hull = hull_of(self.spec.initial)
        if isinstance(self.clipping, str) or self.P is None or isinstance(hull, str | Ellipsoid):
            return np.inf
        forms = np.ones((1, len(hull))) @ ((self.P @ Rounded.lift(hull)) * hull)
        found = self.clipping
        return (float(np.max(forms.value + forms.error)) + self._added(found.most, found.along, found.most)) * _UP

    @cached_property
    def clipping(self) -> Clipping | str:
        """What each move may be clipped by, or why that is not bounded."""
        unfounded = self._unfounded()
        return unfounded or clipping(self._parts, self.spec.initial)

    @property
    def reason(self) -> str:
        """Why the certificate does not hold, or an empty string when it does."""
        if isinstance(self.clipping, str):
            return self.clipping
        low = next(((name, value) for name, value in self.margins().items() if not value > 0), None)
        return "" if low is None else f"the condition {low[0]!r} has the relative margin {low[1]:.3g}"

    @property
    def sentence(self) -> str:
        """What is proved, in one sentence, or that nothing is."""
        reason = self.reason
        if reason:
            return f"Not certified: {reason}."
        assert isinstance(self.clipping, Clipping)
        limits = "" if self.spec.inputs is None else "keeps the input limits, "
        worst = f" and at most {at_most(self.worst_bound)} from any of them" if np.isfinite(self.worst_bound) else ""
        return (f"From every initial state this law {limits}leaves its linear piece within the first "
                f"{len(self.clipping.most)} moves at most and converges to 0, and the discounted cost (discount "
                f"{self.spec.discount:g}) is at most {at_most(self.bound)} in expectation{worst}.")

    def margins(self) -> dict[str, float]:
        """Return the smallest eigenvalue of each condition, relative to its diagonal and with rounding taken off."""
        return {} if self._unfounded() else margins_of(self.loop, self.P, self.W)  # type: ignore[arg-type]

    def prove(self) -> Proof:
        """Settle all of it, in floats with every rounding bounded or, what these leave open, in exact arithmetic."""
        begun, method = perf_counter(), "none"
        reason = self.clipping if isinstance(self.clipping, str) else ""
        if not reason:
            name, method = failing(self.loop, self.P, self.W)  # type: ignore[arg-type]
            reason = f"the condition {name!r} is not positive definite" if name else ""
        return Proof(not reason, method, perf_counter() - begun, reason)

    def _unfounded(self) -> str:
        if isinstance(self.loop, str):
            return self.loop
        if not contracts(lipschitz(self.inc.activations), self.inc.W, self.inc.contraction.weights):
            return "the fixed point is not proved unique in exact arithmetic (thm:wellposed)"
        return "the loop on the linear piece is not stable" if self.P is None or self.W is None else ""

    @cached_property
    def _parts(self) -> Parts:
        loop, law = self.loop, self.inc.without_idle_units()
        assert isinstance(loop, PieceLoop) and self.P is not None and self.W is not None
        read, used = loop.read(Rounded), list(loop.units)
        V = Rounded.lift(exact(law.V[:, used])) if used else Rounded.lift(np.zeros((self.plant.m, 0)))
        N = self.plant.B @ V
        L = (N.T @ self.P @ read.F) * self.spec.discount + V.T @ self.spec.R @ read.inputs
        slope = np.array([_steepest(law, i, loop.slopes[k]) for k, i in enumerate(used)])
        return Parts(read.F, N, read.G, L, loop.low, loop.high, slope, self.W)

    def _added(self, first: Array, along: Array, second: Array) -> float:
        """sum_k discount^k (2 first_k'along_k + second_k'|T| second_k)."""
        assert self.P is not None
        law, used, parts = self.inc.without_idle_units(), list(self.loop.units), self._parts  # type: ignore[union-attr]
        V = Rounded.lift(law.V[:, used])
        T = (parts.N.T @ self.P @ parts.N) * self.spec.discount + V.T @ self.spec.R @ V
        sizes = np.abs(T.value) + T.error
        weights = self.spec.discount ** np.arange(len(first))
        return float(weights @ (2 * np.sum(first * along, axis=1) + np.sum((second @ sizes) * second, axis=1))) * _UP


def clipped_cost(plant: Any, spec: Spec, inc: INC) -> ClippedCost:
    """Return what a law costs that is clipped for a few moves only, with the numbers that prove it, or why there are none.

    P and W as in `unswitched_cost`.

    Raises DimensionError when spec or law do not fit the plant.
    """
    bare = ClippedCost(fitting(plant, inc), spec, inc, None, None)
    loop = bare.loop
    if isinstance(loop, str):
        return bare
    P, W = smallest_storages(loop, spec.discount)
    return replace(bare, P=P, W=W)


def _steepest(law: INC, unit: int, slope: float) -> float:
    """The most that the slope of a unit differs from the one on its piece, rounded up."""
    pieces = law.activations[unit].pieces
    assert pieces is not None
    return float(np.max(np.abs(pieces.slopes - slope))) * (1 + 1e-15)
