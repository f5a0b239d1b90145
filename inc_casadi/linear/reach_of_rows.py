"""Whether affine functions of the initial state stay below limits at every initial state, in floats or exactly."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..definite import is_surely_positive
from ..exact import solve
from ..readings import EPS, Rounded
from ..sets import Box, Distribution, Ellipsoid
from ..sets.farthest import farthest

_WIDER = (1 + 1e-9, 1 + 1e-6, 1.001, 1.1, 2.0)
YES, OPEN, NO = 1, 0, -1


def enclosing_box(initial: Distribution) -> tuple[Array, Array]:
    """Return centre and half-widths (n,) of a box that holds every initial state, rounding included.

    Half-widths r_i of an ellipsoid are those with r_i^2 P / level - e_i e_i' > 0, which is proved.

    Raises
    ------
    InvalidInputError : no bounded set carries the distribution, or it has too many vertices to list

    >>> from inc_casadi import Ellipsoid, Uniform
    >>> enclosing_box(Uniform(Ellipsoid([[1.0, 0.0], [0.0, 4.0]])))[1].round(6).tolist()
    [1.0, 0.5]
    """
    n, support = initial.dimension, initial.support
    if isinstance(support, Box):
        low, high = support.lower, support.upper
    elif isinstance(support, Ellipsoid):
        axes = np.sqrt(support.level * np.diag(np.linalg.inv(support.P)))
        return support.center, np.array([_half_width(support, i, float(axes[i])) for i in range(n)])
    else:
        low, high = initial.vertices.min(axis=1), initial.vertices.max(axis=1)
    center = (low + high) / 2
    return center, np.maximum(high - center, center - low) * (1 + 4 * EPS)


def verdicts(initial: Distribution, rows: Array, room: Array, spread: Array, reach: Array) -> np.ndarray:
    """Return for each row YES, OPEN or NO: is row'x <= room at every initial state x?

    With a rounding allowance on both sides; a point of an ellipsoid that breaks the limit is left to `is_below`.

    Parameters
    ----------
    rows : (f, n) floats, taken as they are
    room, spread : (f,), what is asked is meant for every number within `spread` of `room`
    reach : (n,) bounds |x_i|

    >>> from inc_casadi import Box, Uniform
    >>> rows, room = np.array([[2.0], [2.0], [2.0]]), np.array([1.9, 2.0, 2.1])
    >>> verdicts(Uniform(Box(-1, 1)), rows, room, np.zeros(3), np.ones(1)).tolist()
    [-1, 0, 1]
    """
    allowance = 8 * (rows.shape[1] + 4) * EPS * (np.abs(rows) @ reach + np.abs(room)) + (1 + 8 * EPS) * spread
    if isinstance(initial.support, Ellipsoid):
        ellipsoid = initial.support
        left = room - rows @ ellipsoid.center - allowance
        return np.array([YES if _is_inside(ellipsoid, row, slack) else OPEN for row, slack in zip(rows, left, strict=True)])
    left = room - np.sum(rows * farthest(initial, rows.T).T, axis=1)
    return np.where(left >= allowance, YES, np.where(left < -allowance, NO, OPEN))


def is_below(initial: Distribution, row: np.ndarray, room: Fraction) -> bool:
    """Return whether row'x <= room at every initial state, decided in Fractions: row (n,).

    Of a polytope, and of whatever is no box and no ellipsoid, the initial states are the hull of the stored vertices.

    >>> from inc_casadi import Box, Uniform
    >>> is_below(Uniform(Box(-1, 1)), exact(np.array([2.0])), Fraction(2))
    True
    """
    support = initial.support
    if isinstance(support, Ellipsoid):
        left = room - row @ exact(support.center)
        along = solve(exact(support.P), row)
        return left >= 0 and along is not None and bool(Fraction(support.level) * (row @ along) <= left * left)
    if isinstance(support, Box):
        return bool(np.sum(np.maximum(row * exact(support.lower), row * exact(support.upper))) <= room)
    return bool(np.max(row @ exact(initial.vertices)) <= room)


def _half_width(ellipsoid: Ellipsoid, i: int, guess: float) -> float:
    row = np.eye(len(ellipsoid.P))[i]
    found = next((guess * factor for factor in _WIDER if _is_inside(ellipsoid, row, guess * factor)), None)
    return np.inf if found is None else found


def _is_inside(ellipsoid: Ellipsoid, row: Array, slack: float) -> bool:
    # row'(x - center) <= slack on the ellipsoid if slack^2 P > level row row'.
    if not (slack > 0 and np.isfinite(slack)):
        return False
    column = Rounded.lift(row[:, None])
    widened = (Rounded.lift(np.array([[slack]])) * slack) * ellipsoid.P
    return is_surely_positive(widened - (column @ column.T) * ellipsoid.level)
