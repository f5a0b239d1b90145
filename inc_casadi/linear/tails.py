"""How much of a linear function of the initial state lies beyond a level, in expectation: bounds from moments."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..sets import Box, Distribution, Ellipsoid, Uniform

ORDERS = 30  # even moments that are tried
_UP = 1 + 1e-9  # covers the rounding of a few hundred operations on numbers that are not subtracted


def moments_known(initial: Distribution) -> int:
    """Return up to which order 2 q even moments of a'(x - mean) are known to be at most (2 q - 1)!! var^q, for every a.

    For a uniform box, whose coordinates are independent and symmetric about their means, every even moment of a sum is at
    most that of the normal sum of the same variances, since that is so for each coordinate: h^2q / (2 q + 1) against
    (2 q - 1)!! (h^2 / 3)^q. For a uniform ellipsoid, a'(x - mean) is a coordinate of a ball of some radius r, whose moments
    are (2 q - 1)!! r^2q / ((n + 2) (n + 4) ... (n + 2 q)), with var = r^2 / (n + 2). Of any distribution q = 1 is known.

    >>> from inc_casadi import Gaussian
    >>> moments_known(Uniform(Box(-1, 1))), moments_known(Gaussian([0.0], [[1.0]]))
    (30, 1)
    """
    return ORDERS if isinstance(initial, Uniform) and isinstance(initial.support, Box | Ellipsoid) else 1


def beyond(deviation: Array, level: Array, most: Array, power: int, orders: int) -> Array:
    """Return bounds on E max(|v| - level, 0)^power where |v| <= most and v has moments as `moments_known` says.

    For each q, max(|v| - t, 0)^p <= v^2q max_{t < w <= most} (w - t)^p / w^2q, the maximum at w = 2 q t / (2 q - p) or at
    the end; the least over q is taken. Rounded up. 0 where most <= level.

    Parameters
    ----------
    deviation : standard deviations of v; level : positive; most : all of one shape
    power : 1 or 2; orders : how many q may be used

    >>> normal = np.random.default_rng(0).standard_normal(10**5)
    >>> bound = beyond(np.array(1.0), np.array(2.5), np.array(9.0), 1, 30).item()
    >>> float(np.mean(np.maximum(np.abs(normal) - 2.5, 0))) < bound < 0.01
    True
    """
    q = np.arange(1, orders + 1).reshape(-1, *[1] * np.ndim(level))
    double = np.cumprod(2.0 * np.arange(1, orders + 1) - 1).reshape(q.shape)  # (2 q - 1)!!
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        turn = np.where(2 * q > power, 2 * q * level / np.maximum(2 * q - power, 1), np.inf)
        w = np.minimum(turn, most)
        found = double * (deviation / w) ** (2 * q) * np.maximum(w - level, 0.0) ** power
    least = np.min(np.where(np.isnan(found), np.inf, found), axis=0) * _UP
    return np.where(most <= level, 0.0, least)
