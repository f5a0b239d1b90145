"""Intervals that surely hold the hidden vector of a controller, for every state of a cell, implicit layers included."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..activations.stack import lipschitz, slopes
from ..arrays import Array
from ..brief import Brief
from ..errors import ConvergenceError, NotWellPosedError
from ..fixed_point import feedforward_levels
from ..inc import INC
from ..intervals import EPS, product, range_on

GUARD = 1 + 1e-9  # covers the rounding of sums of nonnegative numbers
ROUNDS = 30


@dataclass(frozen=True, eq=False)
class Law:
    """A controller behind y = C x, with the products that its bounds need; sizes are those of absolute values.

    inc: the controller; C (p, n). Raises NotWellPosedError when the fixed point is not proved unique.
    """

    inc: INC
    C: Array

    def __post_init__(self) -> None:
        if not self.inc.well_posedness().holds:
            raise NotWellPosedError(f"the controller is not proved well posed: {self.inc.well_posedness().test}")

    @cached_property
    def drive(self) -> Array:
        """U C, (q, n)."""
        return self.inc.U @ self.C

    @cached_property
    def drive_size(self) -> Array:
        """|U| |C|, (q, n)."""
        return np.abs(self.inc.U) @ np.abs(self.C)

    @cached_property
    def levels(self) -> int | None:
        """How many layers follow each other, None when W has a loop."""
        levels = feedforward_levels(self.inc.W)
        return None if levels is None else len(levels)

    @property
    def steps(self) -> int:
        """More than how many roundings any term of a bound goes through."""
        return 4 * (self.C.shape[1] + self.inc.p + self.inc.q + self.inc.m) + 20

    @cached_property
    def _growth(self) -> Array:
        """(I - S|W|)^{-1} in floats, for a contraction."""
        M = lipschitz(self.inc.activations)[:, None] * np.abs(self.inc.W)
        return np.abs(np.linalg.inv(np.eye(self.inc.q) - M))

    def errors(self, residual: Array) -> Array:
        """Return e (N, q) with |eta^ - eta| <= e whenever |eta^ - phi(W eta^ + s)| <= residual (N, q), eta the solution.

        d = |eta^ - eta| satisfies d <= M d + residual, M = S|W|. With lambda_pf(M) < 1, (I - M)^{-1} >= 0, so any e with
        e >= M e + residual has d <= e; that inequality is checked for e = (I - M)^{-1} residual, a little enlarged. Where
        rounding spoils it, e = v max_i(residual_i / v_i) / (1 - rate) is taken. Where only a multiplier T proves
        well-posedness, the bound is `monotone.error_from_residual`, whose formula this repeats for N residuals at once.
        """
        inc, test = self.inc, self.inc.well_posedness()
        if test.T is not None:
            low, high = slopes(inc.activations)
            reach = 2.0 * np.eye(inc.q) + np.abs((low + high)[:, None] * inc.W)
            size = np.sqrt(np.sum(((test.T * residual) @ reach) ** 2 / test.T, axis=1)) / test.monotonicity
            return (1 + 1e-6) * size[:, None] / np.sqrt(test.T)
        M = lipschitz(inc.activations)[:, None] * np.abs(inc.W)
        e = residual @ self._growth.T
        e = e + 1e-6 * e @ self._growth.T  # so that e - M e exceeds the residual by 1e-6 e, more than rounding takes
        proved = np.all(e >= GUARD * (e @ M.T + residual), axis=1) if test.rate < 1 - 1e-6 else np.zeros(len(e), dtype=bool)
        return np.where(proved[:, None], e, self._weighted_errors(residual))

    def _weighted_errors(self, residual: Array) -> Array:
        test = self.inc.well_posedness()
        room = 1.0 - GUARD * test.rate
        if room <= 0:
            raise ConvergenceError(f"the contraction rate {test.rate:.12g} is too near 1 for bounds on eta in floats")
        return GUARD * test.weights * np.max(residual / test.weights, axis=1, initial=0.0, keepdims=True) / room


@dataclass(frozen=True, eq=False)
class Enclosure(Brief):
    """For each of N cells: a box of states [low, high] (N, n) that holds it; eta and z = W eta + U C x + b on it, (N, q)."""

    low: Array
    high: Array
    eta_low: Array
    eta_high: Array
    z_low: Array
    z_high: Array

    def within(self, z_low: Array, z_high: Array, law: Law) -> Enclosure:
        """Return the enclosure with further bounds on z, and what follows for eta = phi(z)."""
        z_low, z_high = np.maximum(self.z_low, z_low), np.minimum(self.z_high, z_high)
        eta_low, eta_high = range_on(law.inc.activations, z_low, z_high)
        return Enclosure(self.low, self.high, *_meet(self.eta_low, self.eta_high, eta_low, eta_high), z_low, z_high)


def enclose(law: Law, low: Array, high: Array) -> Enclosure:
    """Return intervals that hold eta(x) and z(x) for every x in boxes [low, high] (N, n).

    Theorem. Let e^ be any vector and s = U C x + b. The interval value of phi(W e^ + [s]) - e^ bounds the residual of e^ for
    every x of the box at once, so `Law.errors` bounds |eta(x) - e^|: a first enclosure E. If E holds eta(x), so does
    phi(W E + [s]), because eta = phi(W eta + s): intersecting E with it, as often as one likes, keeps an enclosure,
    whether or not this contracts. e^ is the controller's own solution at the middle of the box; it needs no trust.

    Raises ConvergenceError when the contraction is too weak for bounds in floats.

    >>> law = Law(INC([[0.5]], [[1.0]], [[1.0]], [[0.0]]), np.eye(1))
    >>> found = enclose(law, np.array([[0.0]]), np.array([[1.0]]))  # eta = 2 max(x, 0)
    >>> (found.eta_low.round(5) + 0.0).tolist(), found.eta_high.round(5).tolist()
    ([[0.0]], [[2.0]])
    """
    inc = law.inc
    s_low, s_high = product(law.drive, low, high, law.drive_size, law.steps)
    s_low, s_high = _plus(s_low, s_high, inc.b)
    middle = inc.solve(law.C @ ((low + high) / 2).T).eta.T
    z_low, z_high = _z(law, middle, middle, s_low, s_high)
    below, above = range_on(inc.activations, z_low, z_high)
    residual = np.maximum(np.abs(below - middle), np.abs(above - middle)) * GUARD
    e = law.errors(residual)
    eta_low, eta_high = middle - GUARD * e, middle + GUARD * e
    rounds = ROUNDS if law.levels is None else law.levels + 1
    for _ in range(rounds if inc.q else 0):
        z_low, z_high = _z(law, eta_low, eta_high, s_low, s_high)
        before = eta_high - eta_low
        eta_low, eta_high = _meet(eta_low, eta_high, *range_on(inc.activations, z_low, z_high))
        if law.levels is None and np.all(eta_high - eta_low >= 0.999 * before):
            break
    return Enclosure(low, high, eta_low, eta_high, *_z(law, eta_low, eta_high, s_low, s_high))


def _z(law: Law, eta_low: Array, eta_high: Array, s_low: Array, s_high: Array) -> tuple[Array, Array]:
    low, high = product(law.inc.W, eta_low, eta_high)
    low, high = low + s_low, high + s_high
    room = 2 * EPS * (np.abs(low) + np.abs(high) + np.abs(s_low) + np.abs(s_high))
    return low - room, high + room


def _plus(low: Array, high: Array, shift: Array) -> tuple[Array, Array]:
    room = 2 * EPS * (np.abs(low) + np.abs(high) + np.abs(shift))
    return low + shift - room, high + shift + room


def _meet(low: Array, high: Array, other_low: Array, other_high: Array) -> tuple[Array, Array]:
    """The intersection of two enclosures of the same value; they overlap."""
    return np.maximum(low, other_low), np.minimum(high, other_high)
