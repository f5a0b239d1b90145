"""How far hidden units can move while the state stays in an ellipsoid, and the sectors that follow; implicit W included."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from ..activations import Activation
from ..activations.stack import groups, sector_on, slopes
from ..arrays import Array
from ..blocks import exact
from ..intervals import offsets_on
from ..readings import EPS, Rounded
from .base import Setting
from .lines import Lines, lines
from .rest import Rest

PARTS = 8  # subintervals on which a unit is compared with a line
NONE = -1.0  # room of a unit whose bound does not hold for any ellipsoid
TINY = 1e-290


@dataclass(frozen=True, eq=False)
class Linearized:
    """Row i says |z~_i| <= |g_i e| + slack_i, with g = U C + through U C, for as long as no bounded unit leaves its bound.

    through: (q, q), any numbers; slack: (q,), infinite where nothing is known.
    """

    through: Array
    slack: Array

    def rows(self, direct: Any) -> Any:
        """Return g (q, n) from U C, in the arithmetic of U C."""
        return direct + self.through @ direct

    def rooms(self, r: Array) -> Array:
        """Return what the bounds r leave for |g_i e|, (q,), rounded down; -1 where they leave nothing.

        >>> Linearized(np.zeros((2, 2)), np.array([0.25, np.inf])).rooms(np.ones(2)).round(9).tolist()
        [0.75, -1.0]
        """
        left = (r - self.slack) * (1 - 2 * EPS)
        return np.where(left > 0, np.nextafter(left, 0.0), NONE)


def near_rest(rest: Rest) -> tuple[Array, Array]:
    """Return floats c and s, (q,) each, with |z* - c| <= s; s = 0 where z* is a float itself.

    >>> third = np.array([Fraction(1, 3)])
    >>> c, s = near_rest(Rest.at(third, third, third))
    >>> c.item() == 1 / 3, bool(0 < s.item() < 1e-16)
    (True, True)
    """
    known = rest.z_low is rest.z_high  # halving sums of Fractions takes time that a search can spare
    middle = np.array([float(low if known else (low + high) / 2) for low, high in zip(rest.z_low, rest.z_high, strict=True)])
    spread = np.array([0.0 if low == c == high else float(max(high - Fraction(c), Fraction(c) - low))
                       for low, high, c in zip(rest.z_low, rest.z_high, middle, strict=True)])
    return middle, np.where(spread > 0, np.nextafter(spread * (1 + EPS), np.inf), 0.0)


def local_lines(setting: Setting, r: Array, H: Array) -> Lines:
    """Return two lines around each unit: bent ones where H_i is not zero (`lines`), else its sector on |z~_i| <= r_i.

    A unit with r_i = 0 is not bounded: its lines are those of its global slopes. r: (q,); H: (q, n); floats.

    >>> from inc_casadi import INC, Plant, close_loop
    >>> from inc_casadi.claims.attraction import Attraction
    >>> from inc_casadi.local.rest import rest_of
    >>> loop = close_loop(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.0]], 1.0))
    >>> setting = Setting(loop, Attraction(), rest_of(loop))
    >>> [round(float(local_lines(setting, np.array([r]), np.zeros((1, 1))).far[0]), 9) for r in (0.5, 2.0, 0.0)]
    [1.0, 0.5, 0.0]
    """
    units, (center, spread) = setting.loop.inc.activations, near_rest(setting.rest)
    bent_lines = lines(setting)
    low, high = _interval(center, spread, r)
    lower, upper = sector_on(units, center, low, high, spread)
    ends = slopes(units)
    lower, upper = exact(np.where(r > 0, lower, ends[0])), exact(np.where(r > 0, upper, ends[1]))
    bent = (bent_lines.bend != 0) & np.any(H != 0, axis=1)
    zero = np.full(len(units), Fraction(0), dtype=object)
    return Lines(np.where(bent, bent_lines.near, upper), np.where(bent, bent_lines.far, lower),
                 np.where(bent, bent_lines.bend, zero), np.where(bent, bent_lines.room, zero))


def _interval(center: Array, spread: Array, r: Array) -> tuple[Array, Array]:
    reach = spread + r
    return np.nextafter(center - reach * (1 + EPS), -np.inf), np.nextafter(center + reach * (1 + EPS), np.inf)


def remainders(setting: Setting, r: Array, slope: Array) -> Array:
    """Return D (q,) with |eta~_i - slope_i z~_i| <= D_i whenever |z~_i| <= r_i, rounded up.

    A unit with r_i = 0 is not bounded, so its slope must be 0, and D_i is the width of its range above or below its rest.

    >>> from inc_casadi import INC, Plant, close_loop
    >>> from inc_casadi.claims.attraction import Attraction
    >>> from inc_casadi.local.rest import rest_of
    >>> loop = close_loop(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.0]], 1.0))
    >>> setting = Setting(loop, Attraction(), rest_of(loop))
    >>> [remainders(setting, np.array([r]), np.array([s])).round(9).item() for r, s in ((2.0, 0.5), (0.5, 1.0), (0.0, 0.0))]
    [0.5, 0.0, 1.0]
    """
    center, spread = near_rest(setting.rest)
    low, high = _interval(center, spread, r)
    first, last = _interval(center, spread, np.zeros_like(r))
    found = np.empty_like(r)
    for unit, rows in groups(setting.loop.inc.activations):
        ends = [part[rows] for part in (slope, low, high, first, last)]
        bounded = _departure(unit, *ends)
        at_rest = beside(unit, 0.0 * ends[0], *ends[3:])
        anywhere = np.maximum(unit.bounds[1] - at_rest[0], at_rest[1] - unit.bounds[0])
        found[rows] = np.where(r[rows] > 0, bounded, np.where(ends[0] == 0.0, anywhere, np.inf))
    return found * (1 + 4 * EPS) + TINY


def _departure(unit: Activation, slope: Array, low: Array, high: Array, first: Array, last: Array) -> Array:
    """Return the largest |phi(z) - slope z - (phi(c) - slope c)| over z in [low, high], c in [first, last]."""
    share = np.linspace(0.0, 1.0, PARTS + 1)[:, None]
    points = np.clip(low + share * (high - low), low, high)
    points[-1] = high
    below, above = beside(unit, np.broadcast_to(slope, points[1:].shape), points[:-1], points[1:])
    under, over = beside(unit, slope, first, last)
    return np.maximum(np.max(above, axis=0) - under, over - np.min(below, axis=0))


def beside(unit: Activation, slope: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return bounds on phi(z) - slope z over [low, high], for arrays of one shape; every rounding allowed for.

    >>> from inc_casadi import ReLU
    >>> below, above = beside(ReLU(), np.array([0.5]), np.array([-1.0]), np.array([1.0]))
    >>> (below.round(9) + 0.0).item(), above.round(9).item()
    (0.0, 0.5)
    """
    below, above = offsets_on(unit, slope[None], low, high)
    return below[0], above[0]


def linearized(setting: Setting, r: Array, P: Array | None) -> Linearized:
    """Return, for each unit, the best of a few linear bounds on |z~_i| over the ellipsoid, given bounds r on all units.

    z~ = U C e + W eta~ and eta~ = M z~ + delta, M diagonal, |delta| <= D (`remainders`). So, for every row j,

        z~_i = (U C)_i e + W_i eta~ + j (U C e + W eta~ - z~) = g_i e + [(W_i + jW) M - j] z~ + (W_i + jW) delta,

    |z~_i| <= |g_i e| + |(W_i + jW) M - j| r + |W_i + jW| D =: |g_i e| + slack_i. With j = W_i M (I - W M)^-1 the middle term
    is zero but for rounding, and contributions that cancel along the way are taken as they are; with M = 0 and j = 0 this is
    interval arithmetic. Both are true, whatever j is; the one with the larger (r_i - slack_i) / |g_i| is taken.

    Why |g_i e| + slack_i < r_i for all bounded i and all e with e'Pe <= 1 proves the bounds r: along the segment t e the
    solution z~(t) of the well-posed fixed point is continuous and starts at 0. As long as |z~(t)| <= r the bounds hold
    strictly, so the first t at which one of them is attained does not exist. No Perron-Frobenius radius is needed.

    r: (q,), zero for units that are not bounded; P: (n, n), or None to compare by the Euclidean norm of g.

    >>> from inc_casadi import INC, Plant, close_loop
    >>> from inc_casadi.claims.attraction import Attraction
    >>> from inc_casadi.local.rest import rest_of
    >>> loop = close_loop(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.0]], 1.0))
    >>> setting = Setting(loop, Attraction(), rest_of(loop))
    >>> linearized(setting, np.array([2.0]), None).rooms(np.array([2.0])).round(9).tolist()   # nothing feeds back
    [2.0]
    """
    loop = setting.loop
    direct, W = Rounded.lift(loop.inc.U) @ loop.plant.C, Rounded.lift(loop.inc.W)
    root = _root(P, loop.n)
    best, through, slack = np.full(loop.q, -np.inf), np.zeros((loop.q, loop.q)), np.full(loop.q, np.inf)
    for slope in _slopes_to_try(setting, r):
        j = _through(W.value, slope)
        tail, middle = W + j @ W, (W + j @ W) * slope - j
        total = _above(middle) @ r + _finite_product(_above(tail), remainders(setting, r, slope))
        total = total * (1 + 4 * (loop.q + 8) * EPS) + TINY
        size = np.linalg.norm((direct.value + j @ direct.value) @ root, axis=1)
        better = (merit := (r - total) / np.maximum(size, TINY)) > best
        best, slack = np.where(better, merit, best), np.where(better, total, slack)
        through[better] = j[better]
    return Linearized(through, slack)


def _slopes_to_try(setting: Setting, r: Array) -> list[Array]:
    """Return zero, the lower end of each local sector, and its middle; zero where a unit is not bounded."""
    units, (center, spread) = setting.loop.inc.activations, near_rest(setting.rest)
    lower, upper = sector_on(units, center, *_interval(center, spread, r), spread)
    return [np.where(r > 0, slope, 0.0) for slope in (0.0 * r, lower, (lower + upper) / 2)]


def _through(W: Array, slope: Array) -> Array:
    """Return W M (I - W M)^-1 = W (I - M W)^-1 M in floats, or zeros when that is singular."""
    try:
        return W @ np.linalg.solve(np.eye(len(W)) - slope[:, None] * W, np.diag(slope))
    except np.linalg.LinAlgError:
        return np.zeros_like(W)


def _above(M: Rounded) -> Array:
    return (np.abs(M.value) + M.error) * (1 + EPS)


def _finite_product(M: Array, v: Array) -> Array:
    """Return M v with 0 times infinity read as 0."""
    unknown = ~np.isfinite(v)
    total = M @ np.where(unknown, 0.0, v)
    return np.where(np.any(M[:, unknown] > 0, axis=1), np.inf, total)


def _root(P: Array | None, n: int) -> Array:
    """Return T with T T' = P^-1, or the identity."""
    if P is None:
        return np.eye(n)
    values, vectors = np.linalg.eigh(P)
    return vectors / np.sqrt(np.maximum(values, TINY))
