"""Piecewise-affine functions of one variable, and bounds on the slopes of their chords over an interval."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import InvalidInputError

EPS = float(np.finfo(float).eps)
CHORD_ROUNDING = 16.0  # a chord's slope errs by less than this times (pieces) eps times the largest slope


@dataclass(frozen=True, eq=False)
class Pieces:
    """A continuous piecewise-affine function of one variable, phi(z) = slopes[j] z + intercepts[j] on piece j.

    Piece j reaches from kinks[j - 1] to kinks[j]; the first and last pieces are unbounded.

    kinks: (k,) increasing; slopes: (k + 1,); intercepts: (k + 1,).

    >>> Pieces(np.array([0.0]), np.array([0.0, 1.0]), np.array([0.0, 0.0])).index(np.array([-1.0, 2.0]))
    array([0, 1])
    """

    kinks: Array
    slopes: Array
    intercepts: Array

    def index(self, z: ArrayLike) -> np.ndarray:
        """Return the piece of each z; a z on a kink belongs to the piece on its right."""
        return np.searchsorted(self.kinks, z, side="right")

    @property
    def joined(self) -> bool:
        """Whether neighbouring pieces meet exactly at their kink, in rational arithmetic: what rigorous proofs rest on.

        >>> Pieces(np.array([0.7]), np.array([0.3, 0.0]), np.array([0.0, 0.3 * 0.7])).joined
        False
        """
        line = [(Fraction(float(s)), Fraction(float(c))) for s, c in zip(self.slopes, self.intercepts, strict=True)]
        kinks = [Fraction(float(kink)) for kink in self.kinks]
        return all(line[j][0] * kink + line[j][1] == line[j + 1][0] * kink + line[j + 1][1] for j, kink in enumerate(kinks))


def as_interval(low: ArrayLike, high: ArrayLike) -> tuple[Array, Array]:
    """Return the ends of intervals as finite float arrays of one shape.

    Raises InvalidInputError for an end that is not finite, and when low > high.

    >>> as_interval(0.0, [1.0, 2.0])[0].tolist()
    [0.0, 0.0]
    """
    ends = np.broadcast_arrays(np.asarray(low, dtype=float), np.asarray(high, dtype=float))
    wrong = ~(np.isfinite(ends[0]) & np.isfinite(ends[1]) & (ends[0] <= ends[1]))
    if np.any(wrong):
        raise InvalidInputError(f"[{ends[0][wrong][0]:g}, {ends[1][wrong][0]:g}] is not an interval with finite ends")
    return ends[0], ends[1]


def around(center: ArrayLike, spread: ArrayLike) -> tuple[Array, Array]:
    """Return floats first <= center - spread and last >= center + spread; spread 0 leaves the center as it is.

    Raises InvalidInputError when spread < 0.

    >>> around(1.0, 0.0)
    (array(1.), array(1.))
    """
    center, spread = np.asarray(center, dtype=float), np.asarray(spread, dtype=float)
    if np.any(spread < 0):
        raise InvalidInputError(f"spread = {float(np.min(spread)):g} is negative")
    first, last = np.nextafter(center - spread, -np.inf), np.nextafter(center + spread, np.inf)
    return as_interval(np.where(spread > 0, first, center), np.where(spread > 0, last, center))


def slopes_between(pieces: Pieces, low: Array, high: Array) -> tuple[Array, Array]:
    """Return the smallest and the largest slope of the pieces within [low, high]; exact, since nothing is computed.

    A chord's slope is a mean of the slopes of the pieces it crosses, weighted with the lengths crossed. For low = high: of
    the pieces that meet there.

    >>> relu = Pieces(np.array([0.0]), np.array([0.0, 1.0]), np.zeros(2))
    >>> slopes_between(relu, np.array([-1.0, 1.0]), np.array([2.0, 2.0]))
    (array([0., 1.]), array([1., 1.]))
    """
    left, right = np.append(-np.inf, pieces.kinks), np.append(pieces.kinks, np.inf)
    a, b = low[..., None], high[..., None]
    met = np.where(a < b, (left < b) & (right > a), (left <= b) & (right >= a))
    return (np.min(np.where(met, pieces.slopes, np.inf), axis=-1), np.max(np.where(met, pieces.slopes, -np.inf), axis=-1))


def sector_between(pieces: Pieces, first: Array, last: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return bounds on the slopes of the chords from any c in [first, last] to any z != c in [low, high], rounded outward.

    With one end fixed, the chord's slope s_j + const / (z - c) is monotone in the other while that moves on one piece. So
    the extremes are attained with both ends at a kink or at an end of their interval, or in the limit z -> c, where the
    slope is that of a piece that meets [first, last]. No bound need be wider than the slopes met by the whole range.

    >>> saturation = Pieces(np.array([-1.0, 1.0]), np.array([0.0, 1.0, 0.0]), np.array([-1.0, 0.0, 1.0]))
    >>> low, high = sector_between(saturation, np.zeros(1), np.zeros(1), np.array([-1.0]), np.array([2.0]))
    >>> 0.499999 < low.item() <= 0.5, high.item()
    (True, 1.0)
    """
    first, last, low, high = np.broadcast_arrays(first, last, low, high)
    z, c = _corners(pieces, low, high)[..., :, None], _corners(pieces, first, last)[..., None, :]
    slope = _chord(pieces, c, z)
    meets = (np.maximum(first, low) <= np.minimum(last, high))
    near = slopes_between(pieces, first, last)
    hull = slopes_between(pieces, np.minimum(first, low), np.maximum(last, high))
    room = CHORD_ROUNDING * EPS * pieces.slopes.size * np.max(np.abs(pieces.slopes))
    lowest = np.nanmin(np.append(slope.reshape(*low.shape, -1), hull[1][..., None], axis=-1), axis=-1) - room
    highest = np.nanmax(np.append(slope.reshape(*low.shape, -1), hull[0][..., None], axis=-1), axis=-1) + room
    lowest = np.where(meets, np.minimum(lowest, near[0]), lowest)
    highest = np.where(meets, np.maximum(highest, near[1]), highest)
    return np.clip(lowest, *hull), np.clip(highest, *hull)


def _corners(pieces: Pieces, low: Array, high: Array) -> Array:
    """Return low, high and the kinks between them, those outside moved to an end: (..., k + 2)."""
    kinks = np.clip(pieces.kinks, low[..., None], high[..., None])
    return np.concatenate([low[..., None], kinks, high[..., None]], axis=-1)


def _chord(pieces: Pieces, c: Array, z: Array) -> Array:
    """Return the slopes of the chords, NaN where z = c, as means over pieces: without cancellation between values."""
    a, b = np.minimum(c, z)[..., None], np.maximum(c, z)[..., None]
    ends = np.clip(pieces.kinks, a, b)
    crossed = np.diff(np.concatenate([a, ends, b], axis=-1), axis=-1)
    total = (b - a)[..., 0]
    return np.where(total > 0, (crossed @ pieces.slopes) / np.where(total > 0, total, 1.0), np.nan)
