"""Does an ellipsoid contain all initial states? Decided at their corners, or where they fill one, by a multiplier.

Where x* is known between bounds only, |x - x*|_P <= |x - x_mid|_P + |x_mid - x*|_P in the norm |e|_P^2 = e'P e, so that
(x - x_mid)'P (x - x_mid) <= (1 - s)^2 is enough, s >= |x_mid - x*|_P; s = 0 where x* is known.
"""

from __future__ import annotations

from fractions import Fraction
from math import inf, nextafter, sqrt
from typing import Any

import numpy as np

from ..arrays import Array
from ..blocks import exact, hstack, vstack
from ..definite import smallest_eigenvalue, with_sign
from ..errors import InvalidInputError
from ..readings import Rational, Rounded
from ..sets import Distribution, Ellipsoid
from .checks import decided
from .rest import Rest

Hull = Array | Ellipsoid
"""Points (n, N) whose convex hull holds all initial states, or an ellipsoid that does."""

MOST_CORNERS = 2**14
MOST_OUTERMOST = 32
TINY = float(np.finfo(float).tiny)
APART = 1e-7  # share by which the multiplier of two ellipsoids exceeds the least one, so that it is strictly one
HALVINGS = 200  # of an interval, until its ends are neighbours


def hull_of(initial: Distribution) -> Hull | str:
    """Return what the initial states fill, or why it cannot be listed.

    >>> from inc_casadi import Box, Gaussian, Uniform
    >>> hull_of(Uniform(Box(-1, 1))).tolist(), hull_of(Gaussian([0.0], [[1.0]]))
    ([[-1.0, 1.0]], 'the initial states are unbounded, and no ellipsoid contains them')
    """
    if isinstance(initial.support, Ellipsoid):
        return initial.support
    try:
        corners = initial.vertices
    except InvalidInputError as error:
        return str(error) if initial.support is not None else ("the initial states are unbounded, and no ellipsoid contains "
                                                               "them")
    if corners.shape[1] > MOST_CORNERS:
        return f"the initial set has {corners.shape[1]} corners; up to {MOST_CORNERS} are looked at"
    return corners


def margin(hull: Hull, P: Array, rest: Rest, multiplier: float) -> float:
    """Return how far the initial states are from leaving {e'P e <= 1}: at least 0 if and only if they are proved inside.

    For corners the least 1 - e'P e less all rounding, zero being enough; the sign is decided in Fractions where rounding
    leaves it open. For an ellipsoid {(x - c)'M (x - c) <= level} and multiplier > 0 the smallest relative eigenvalue of

        1 - (x - x*)'P (x - x*) - multiplier (level - (x - c)'M (x - c)) > 0 for all x,

    a form over (x, 1); such a multiplier exists whenever the one ellipsoid lies inside the other (the S-lemma).

    >>> from fractions import Fraction
    >>> zero = np.array([Fraction(0)])
    >>> rest = Rest.at(zero, zero, zero)
    >>> [round(margin(np.array([[-1.0, 1.0]]), np.array([[p]]), rest, 0.0), 9) for p in (0.75, 1.0, 1.25)]
    [0.25, 0.0, -0.25]
    >>> margin(Ellipsoid([[1.0]]), np.array([[0.75]]), rest, 0.9) > 0
    True
    """
    if isinstance(hull, Ellipsoid):
        if not multiplier > 0:
            return -1.0
        rounded = _pair(hull, P, rest, multiplier, Rounded)
        smallest, room = smallest_eigenvalue(rounded)
        if smallest - room > 0 or not smallest + room >= 0:
            return smallest - room
        return with_sign(smallest, decided(rounded, lambda: _pair(hull, P, rest, multiplier, Rational)))
    slack = _slacks(hull, P, rest, Rounded)
    low, high = slack.value - slack.error, slack.value + slack.error
    if np.all(low >= 0) or np.any(high < 0) or not np.all(np.isfinite(low)):
        return float(np.min(low)) if np.all(np.isfinite(low)) else -inf
    least = min(_slacks(hull[:, low.ravel() < 0], P, rest, Rational).fractions().ravel())
    return float(least) if least >= 0 else min(float(least), -TINY)


def _slacks(points: Array, P: Array, rest: Rest, kind: Any) -> Any:
    """Return room - e'P e at the points as a row, e counted from the middle of the bounds on x*."""
    middle, room = _room(P, rest)
    e = kind.lift(points) - kind.lift(np.repeat(middle[:, None], points.shape[1], axis=1))
    forms = np.ones((1, len(P))) @ (e * (kind.lift(P) @ e))
    return kind.lift(np.full((1, points.shape[1]), room, dtype=object)) - forms


def _pair(hull: Ellipsoid, P: Array, rest: Rest, multiplier: float, kind: Any) -> Any:
    """Return the form over (x, 1) that is positive when the one ellipsoid lies inside the other."""
    middle, room = _room(P, rest)
    c, x = kind.lift(hull.center[:, None]), kind.lift(middle[:, None])
    outer, inner = kind.lift(P), kind.lift(hull.P) * multiplier
    edge = outer @ x - inner @ c
    end = c.T @ inner @ c - x.T @ outer @ x + kind.lift(np.array([[room - Fraction(multiplier) * Fraction(hull.level)]]))
    return vstack(hstack(inner - outer, edge), hstack(edge.T, end))


def _room(P: Array, rest: Rest) -> tuple[np.ndarray, Fraction]:
    """Return the middle of the bounds on x* and (1 - s)^2, s >= |x_mid - x*|_P; in Fractions."""
    middle = np.array([(low + high) / 2 for low, high in zip(rest.x_low, rest.x_high, strict=True)], dtype=object)
    half = np.array([(high - low) / 2 for low, high in zip(rest.x_low, rest.x_high, strict=True)], dtype=object)
    s = Fraction(norm_above(P, half))
    return middle, (1 - s) ** 2 if s < 1 else Fraction(-1)


def norm_above(P: Array, half: np.ndarray) -> float:
    """Return a float that |e|_P does not exceed for any |e_i| <= half_i, Fractions (n,); 0.0 when these are zero.

    >>> 0.0 < norm_above(np.array([[4.0]]), np.array([Fraction(1, 2)])) - 1.0 < 1e-11
    True
    """
    if not any(half):
        return 0.0
    square = half @ np.abs(exact(P)) @ half
    found = nextafter(sqrt(float(square)) * (1 + 1e-12), inf)
    while Fraction(found) ** 2 < square:
        found = 2 * found + 5e-324
    return found


def largest(hull: Hull, P: Array, center: Array) -> tuple[float, float]:
    """Return the largest (x - center)'P (x - center) over the hull in floats, and the multiplier that shows it or 0.

    For an ellipsoid, x = c + A d with |d| <= 1: the least over t > max w of t + g'(t - w)^-1 g + |c - center|_P^2, w the
    eigenvalues of A'P A, g = A'P (c - center) in their coordinates; the multiplier is t / level. Too large by 1e-7 at most.

    >>> round(largest(Ellipsoid([[1.0]], center=[1.0]), np.array([[1.0]]), np.zeros(1))[0], 6)
    4.0
    """
    if not isinstance(hull, Ellipsoid):
        e = hull - center[:, None]
        return float(np.max(np.sum(e * (P @ e), axis=0))), 0.0
    w, g, base, _ = _in_axes(hull, P, center)
    t = (1 + APART) * _secular(w, g)
    return float(t + np.sum(g**2 / (t - w)) + base), float(t / hull.level)


def outermost(hull: Hull, P: Array, center: Array) -> Array:
    """Return some deviations x - center (n, k), up to their sign, that an ellipsoid about the center finds hard to contain.

    >>> outermost(np.array([[-1.0, 1.0, 0.5]]), np.array([[1.0]]), np.zeros(1)).tolist()
    [[1.0, 0.5]]
    """
    if isinstance(hull, Ellipsoid):
        w, g, _, axes = _in_axes(hull, P, center)
        t = _secular(w, g)
        d = np.divide(g, t - w, out=np.zeros_like(g), where=(g != 0) & (t > w))
        far = axes @ (d / np.linalg.norm(d)) if d.any() else axes[:, -1]
        e = (hull.center - center)[:, None] + np.hstack([far[:, None], axes, -axes])
    else:
        e = hull - center[:, None]
    first = np.sign(e[np.argmax(e != 0, axis=0), np.arange(e.shape[1])])
    e = np.unique((e * first)[:, first != 0], axis=1)
    order = np.argsort(-np.sum(e * (P @ e), axis=0), kind="stable")
    return e[:, order[:MOST_OUTERMOST]]


def _in_axes(hull: Ellipsoid, P: Array, center: Array) -> tuple[Array, Array, float, Array]:
    """Return w, g, |c - center|_P^2 and the axes A V (n, n), the longest in the norm of P last."""
    A = np.sqrt(hull.level) * np.linalg.inv(np.linalg.cholesky(hull.P).T)
    a = hull.center - center
    w, V = np.linalg.eigh(A.T @ P @ A)
    return w, V.T @ (A.T @ P @ a), float(a @ P @ a), A @ V


def _secular(w: Array, g: Array) -> float:
    """Return the t >= max w where |g / (t - w)| = 1, or max w where none is."""
    low = high = float(w[-1])
    high += float(np.linalg.norm(g))
    for _ in range(HALVINGS):
        t = low + (high - low) / 2
        if not low < t < high:
            break
        low, high = (t, high) if np.sum((g / (t - w)) ** 2) > 1 else (low, t)
    return high
