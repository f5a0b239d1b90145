"""Whether initial states may occur, decided exactly, and how floats are moved so that they do."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..sets import Box, Distribution, Ellipsoid, Empirical, Polytope, Set

_STEPS = [0.0, *(2.0**-power for power in range(52, 8, -2))]  # how far, relative to the set, a point is drawn in


def may_occur(initial: Distribution, points: Array) -> bool:
    """Return whether all points (n, c), taken as the numbers they are, belong to the support; exact, no tolerance.

    Of finitely many points only they themselves count, not their hull. False also for a support of an unknown kind.

    >>> from inc_casadi import Uniform
    >>> may_occur(Uniform(Box(0, 0.1)), np.array([[0.1, 0.05]])), may_occur(Uniform(Box(0, 0.1)), np.array([[0.1 + 1e-16]]))
    (True, False)
    """
    if not np.all(np.isfinite(points)):
        return False
    if isinstance(initial, Empirical):
        return {tuple(point) for point in points.T} <= {tuple(point) for point in initial.vertices.T}
    return initial.support is not None and bool(np.all(_inside(initial.support, np.unique(points, axis=1))))


def drawn_in(initial: Distribution, points: Array) -> Array:
    """Return the points (n, c), those that rounding has put outside the support moved inside by a few of its units.

    Toward the middle by 2^-52, 2^-50, ... of the way until they belong to it exactly; a point that is not inside after
    2^-10 is left where it is, for `may_occur` to refuse.

    >>> from inc_casadi import Uniform
    >>> disc = Uniform(Ellipsoid(np.eye(2)))
    >>> corner = np.array([[0.6], [0.8]])
    >>> may_occur(disc, corner), may_occur(disc, drawn_in(disc, corner))
    (False, True)
    """
    support = initial.support
    if support is None or isinstance(initial, Empirical) or not points.size:
        return points
    if isinstance(support, Box):
        return np.clip(points, support.lower[:, None], support.upper[:, None])
    distinct, where = np.unique(points, axis=1, return_inverse=True)
    middle = (support.center if isinstance(support, Ellipsoid) else support.vertices.mean(axis=1))[:, None]
    moved, outside = distinct.copy(), np.arange(distinct.shape[1])
    for step in _STEPS:
        moved[:, outside] = distinct[:, outside] - step * (distinct[:, outside] - middle)
        outside = outside[~_inside(support, moved[:, outside])]
        if not outside.size:
            break
    moved[:, outside] = distinct[:, outside]
    return moved[:, where.ravel()]


def _inside(support: Set, points: Array) -> np.ndarray:
    # Exact answers (c,) on the stored floats.
    if isinstance(support, Box):
        return np.all((points >= support.lower[:, None]) & (points <= support.upper[:, None]), axis=0)
    columns = exact(points)
    if isinstance(support, Ellipsoid):
        shifted = columns - exact(support.center)[:, None]
        return np.sum(shifted * (exact(support.P) @ shifted), axis=0) <= Fraction(support.level)
    if isinstance(support, Polytope):
        return np.all(exact(support.H) @ columns <= exact(support.h)[:, None], axis=0)
    return np.zeros(points.shape[1], dtype=bool)
