"""Activations and affine maps on intervals, from below and from above, with every rounding allowed for.

What an activation is on an interval follows from the facts it states: its pieces where it has some, else the range of its
slopes. Arrays are (N, k), N intervals side by side for each of k units or coordinates.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from .activations.base import Activation, Pieces
from .activations.stack import Units, groups
from .arrays import Array

EPS = float(np.finfo(float).eps)
CURVED = 8.0  # exp, tanh and what is made of them are computed within this many eps of 1 + |phi|: libraries keep to 1 or 2
PARTS = 8  # a curved activation is bounded on so many parts of an interval
TINY = 1e-290  # more than underflow takes


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines above and below the units on their intervals: rise z + offset, each field (N, q)."""

    upper_rise: Array
    upper_offset: Array
    lower_rise: Array
    lower_offset: Array


def offsets_on(unit: Activation, rises: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return (below, above) with rise z + below <= phi(z) <= rise z + above for all z in [low, high], for several rises.

    g(z) = phi(z) - rise z. With pieces, g is extreme at an end or at a kink between. Otherwise on each of 8 parts [a, b]
    the slopes of g lie in some [l, s], so g(z) <= min(g(a) + s (z - a), g(b) + l (z - b)), whose maximum is at an end or,
    when l < 0 < s, where both are equal; likewise from below. l and s come from the slopes of phi on the part, as the
    activation states them.

    low, high: arrays of one shape, finite, low <= high; rises: (c, ...), and so are below and above.

    >>> from inc_casadi.activations import ReLU
    >>> below, above = offsets_on(ReLU(), np.array([[0.5]]), np.array([-1.0]), np.array([1.0]))
    >>> (below.round(12) + 0.0).tolist(), above.round(12).tolist()
    ([[0.0]], [[0.5]])
    """
    found = list(_offsets_of_pieces(unit, unit.pieces, rises, low, high) if unit.pieces is not None
                 else _offsets_of_curve(unit, rises, low, high))
    return np.stack([below for below, _ in found]), np.stack([above for _, above in found])


def _offsets_of_pieces(unit: Activation, pieces: Pieces, rises: Array, low: Array,
                       high: Array) -> Iterator[tuple[Array, Array]]:
    points = np.stack([low, high, *(np.clip(kink, low, high) for kink in pieces.kinks)])
    value = unit(points)
    for rise in rises:
        g, room = value - rise * points, 4 * EPS * (np.abs(value) + np.abs(rise * points)) + TINY
        yield (g - room).min(axis=0), (g + room).max(axis=0)


def _offsets_of_curve(unit: Activation, rises: Array, low: Array, high: Array) -> Iterator[tuple[Array, Array]]:
    share = np.linspace(0.0, 1.0, PARTS + 1).reshape(-1, *(1,) * low.ndim)
    points = np.clip(low + share * (high - low), low, high)
    points[-1] = high
    value, w = unit(points), points[1:] - points[:-1]
    lower, upper = unit.slopes_on(points[:-1], points[1:])
    reach = np.maximum(np.abs(low), np.abs(high))
    room = CURVED * EPS * (1 + np.abs(value).max(axis=0)) + TINY
    steepest = np.maximum(np.abs(lower), np.abs(upper)).max(axis=0)
    for rise in rises:
        g, l, s = value - rise * points, lower - rise, upper - rise
        turns = (l < 0) & (s > 0)
        gap, slope = g[1:] - g[:-1], np.where(turns, s - l, 1.0)
        rising, falling = np.where(turns, s * (gap - l * w) / slope, 0.0), np.where(turns, l * (s * w - gap) / slope, 0.0)
        above = np.maximum(np.maximum(g[:-1], g[1:]), g[:-1] + rising).max(axis=0)
        below = np.minimum(np.minimum(g[:-1], g[1:]), g[:-1] + falling).min(axis=0)
        extra = 4 * room + 32 * EPS * ((np.abs(rise) + steepest) * (high - low) + np.abs(rise) * reach)
        yield below - extra, above + extra


def range_on(units: Units, low: Array, high: Array) -> tuple[Array, Array]:
    """Return bounds (N, q) on phi over the intervals [low, high] (N, q), within the bounds that the units state.

    >>> from inc_casadi.activations import Saturation
    >>> ends = range_on((Saturation(),), np.array([[-3.0]]), np.array([[0.25]]))
    >>> [end.round(12).tolist() for end in ends]
    [[[-1.0]], [[0.25]]]
    """
    below, above = np.empty_like(low), np.empty_like(high)
    for unit, rows in groups(units):
        ends = offsets_on(unit, np.zeros_like(low[None, :, rows]), low[:, rows], high[:, rows])
        below[:, rows], above[:, rows] = np.maximum(ends[0][0], unit.bounds[0]), np.minimum(ends[1][0], unit.bounds[1])
    return below, above


def lines_on(units: Units, low: Array, high: Array) -> tuple[Lines, Lines]:
    """Return two pairs of lines around phi on [low, high] (N, q): parallel ones, and ones that are close in the middle.

    Any slope gives true lines (`offsets_on`); a few are tried. Parallel: the pair nearest to each other. Close: the
    upper line lowest at the middle of the interval and the lower line highest there, which is least area between them.

    >>> from inc_casadi.activations import ReLU
    >>> _, close = lines_on((ReLU(),), np.array([[-1.0]]), np.array([[3.0]]))
    >>> close.upper_rise.tolist(), close.lower_rise.tolist()
    ([[0.75]], [[1.0]])
    """
    parallel = Lines(*(np.empty_like(low) for _ in range(4)))
    close = Lines(*(np.empty_like(low) for _ in range(4)))
    for unit, rows in groups(units):
        a, b = low[:, rows], high[:, rows]
        rises = np.stack(list(_candidates(unit, a, b)))
        below, above = offsets_on(unit, rises, a, b)
        middle = (a + b) / 2
        for pair, up, down in ((parallel, above - below, above - below), (close, rises * middle + above,
                                                                        -(rises * middle + below))):
            top, bottom = up.argmin(axis=0)[None], down.argmin(axis=0)[None]
            pair.upper_rise[:, rows] = np.take_along_axis(rises, top, 0)[0]
            pair.upper_offset[:, rows] = np.take_along_axis(above, top, 0)[0]
            pair.lower_rise[:, rows] = np.take_along_axis(rises, bottom, 0)[0]
            pair.lower_offset[:, rows] = np.take_along_axis(below, bottom, 0)[0]
    return parallel, close


def _candidates(unit: Activation, low: Array, high: Array) -> Iterator[Array]:
    """Slopes to try: of chords between ends and kinks, or, where there are no pieces, of the chord and of tangents."""
    pieces = unit.pieces
    if pieces is None:
        yield _chord(unit, low, high)
        for share in (0.0, 0.25, 0.5, 0.75, 1.0):
            yield unit.derivative(low + share * (high - low))
        return
    points = [low, *(np.clip(kink, low, high) for kink in pieces.kinks), high]
    for a, b in combinations(points, 2):
        yield _chord(unit, a, b)


def _chord(unit: Activation, a: Array, b: Array) -> Array:
    wide = b - a > 1e-12 * (1 + np.abs(a) + np.abs(b))
    return np.where(wide, (unit(b) - unit(a)) / np.where(wide, b - a, 1.0), unit.derivative((a + b) / 2))


def product(M: Array, low: Array, high: Array, size: Array | None = None, terms: int = 0) -> tuple[Array, Array]:
    """Return bounds (N, r) on M v over low <= v <= high; M (r, k), low and high (N, k).

    With centre c and radius r of the interval: M c +- (|M| r + 4 (k + 4) eps |M| (|c| + r)), which covers every rounding,
    those of c and r included. When M itself is a rounded product, size (r, k) replaces |M| in the last term, the same
    product of absolute values, and terms counts its roundings, which are added to k.

    >>> [end.round(12).tolist() for end in product(np.array([[1.0, -2.0]]), np.zeros((1, 2)), np.ones((1, 2)))]
    [[[-2.0]], [[1.0]]]
    """
    c, r = (low + high) / 2, (high - low) / 2
    size = np.abs(M) if size is None else size
    rounding = 4 * (M.shape[1] + terms + 4) * EPS * ((np.abs(c) + r) @ size.T) + TINY
    middle, spread = c @ M.T, r @ np.abs(M).T
    return middle - spread - rounding, middle + spread + rounding
