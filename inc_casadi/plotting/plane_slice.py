"""The plane that a portrait is drawn in: two coordinates of the state, the others held at stated values."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, vector
from ..errors import EmptySetError, InvalidInputError
from ..inc import INC
from ..sets import Box, Ellipsoid, Polytope
from .outlines import hull
from .plane_panels import ellipse
from .style import name_of


@dataclass(frozen=True, eq=False)
class PlaneSlice:
    """The plane {x: x_k = at_k for k not in axes} in R^n; axes: the indices of its two coordinates; at (n,).

    Sets, laws and arrows are those of the slice. Motions leave it, so of them the projection along the other coordinates
    is drawn.
    """

    axes: tuple[int, int]
    at: Array

    @property
    def n(self) -> int:
        """Number of states."""
        return self.at.size

    def lift(self, points: Array) -> Array:
        """Return points (2, N) of the plane as states (n, N).

        >>> PlaneSlice((2, 0), np.array([0.0, 5.0, 0.0])).lift(np.array([[1.0], [2.0]])).ravel().tolist()
        [2.0, 5.0, 1.0]
        """
        states = np.repeat(self.at[:, None], points.shape[1], axis=1)
        states[list(self.axes)] = points
        return states

    def project(self, states: Array) -> Array:
        """Return the two coordinates (2, ...) of states (n, ...)."""
        return states[list(self.axes)]

    def law(self, inc: INC, C: Array) -> tuple[INC, Array]:
        """Return the law and the output matrix (p, 2) of the slice: y = C x = C_2 s + C at_0 with s in the plane.

        The constant C at_0, at_0 without the coordinates of the plane, moves into the biases b and d.
        """
        rest = self.at.copy()
        rest[list(self.axes)] = 0.0
        y = C @ rest
        return replace(inc, b=inc.b + inc.U @ y, d=inc.d + inc.K @ y), C[:, list(self.axes)]

    def outline(self, body: Any) -> Array | None:
        """Return the outline (N, 2) of the slice of a Box, Polytope or Ellipsoid, None where it misses the plane.

        Raises InvalidInputError for another kind of set.

        >>> PlaneSlice((0, 1), np.zeros(3)).outline(Box([-1, -2, -3], [1, 2, 3])).tolist()
        [[-1.0, -2.0], [1.0, -2.0], [1.0, 2.0], [-1.0, 2.0]]
        """
        if isinstance(body, Ellipsoid):
            return self._of_ellipsoid(body)
        if isinstance(body, Box):
            inside = np.all((body.lower <= self.at) & (self.at <= body.upper) | np.isin(np.arange(self.n), self.axes))
            ends = self.project(np.stack([body.lower, body.upper], axis=1))
            return _corners(ends) if inside else None
        if isinstance(body, Polytope):
            return hull(body.vertices.T) if self.is_whole else self._of_polytope(body)
        raise InvalidInputError(f"a {type(body).__name__} has no outline: a Box, Polytope or Ellipsoid is needed")

    def around(self, window: Box, states: Array) -> Box:
        """Return the window of the plane as a box in R^n that in the other coordinates holds states (n, N), and is as wide
        as the window is at least."""
        width = float(np.max(window.upper - window.lower))
        low = np.minimum(states.min(axis=1), self.at - width)
        high = np.maximum(states.max(axis=1), self.at + width)
        low[list(self.axes)], high[list(self.axes)] = window.lower, window.upper
        return Box(low, high)

    @property
    def is_whole(self) -> bool:
        """Whether the plane is the state space itself, in its own order."""
        return self.n == 2 and self.axes == (0, 1)

    @property
    def words(self) -> str:
        """The slice in words, empty where the plane is the whole space."""
        others = [k for k in range(self.n) if k not in self.axes]
        held = ", ".join(f"{name_of('x', k, self.n)} = {self.at[k]:.4g}" for k in others)
        return f"slice {held}; motions are projected" if others else ""

    def _of_ellipsoid(self, body: Ellipsoid) -> Array | None:
        # With e = S s + r, r off the plane: e'P e = (s - c)'P_2 (s - c) + r'P r - c'P_2 c, where P_2 c = -S'P r.
        S = np.eye(self.n)[:, list(self.axes)]
        rest = self.at - S @ self.project(self.at) - body.center
        P = S.T @ body.P @ S
        center = -np.linalg.solve(P, S.T @ body.P @ rest)
        level = float(body.level - rest @ body.P @ rest + center @ P @ center)
        return ellipse(center, P, level).T if level > 0 else None

    def _of_polytope(self, body: Polytope) -> Array | None:
        rest = self.at.copy()
        rest[list(self.axes)] = 0.0
        try:
            return hull(Polytope(body.H[:, list(self.axes)], body.h - body.H @ rest).vertices.T)
        except EmptySetError:
            return None


def plane_slice(n: int, axes: tuple[int, int] = (0, 1), at: ArrayLike | None = None) -> PlaneSlice:
    """Return the slice of R^n along two coordinates, numbered from 0; at (n,): the values of the others, 0 by default.

    Raises InvalidInputError when the coordinates are not two of the n, DimensionError when `at` has another size.

    >>> plane_slice(3, (0, 2), [0.0, 0.5, 0.0]).words
    'slice $x_{2}$ = 0.5; motions are projected'
    """
    pair = tuple(axes)
    if len(pair) != 2 or len(set(pair)) != 2 or not all(isinstance(k, int) and 0 <= k < n for k in pair):
        raise InvalidInputError(f"axes is {axes!r}, but must be two different coordinates among 0 to {n - 1}")
    return PlaneSlice((pair[0], pair[1]), vector("at", np.zeros(n) if at is None else at, n))


def rim(window: Box) -> Array:
    """Return eight points (2, 8) just within a rectangle: its corners and the middles of its sides.

    >>> rim(Box([-1.0, -1.0], [1.0, 1.0]))[:, 0].tolist()
    [-0.96, -0.96]
    """
    turn = np.array([[-1, 0, 1, 1, 1, 0, -1, -1], [-1, -1, -1, 0, 1, 1, 1, 0]])
    return window.center[:, None] + 0.96 * ((window.upper - window.lower) / 2)[:, None] * turn


def _corners(ends: Array) -> Array:
    (left, right), (low, high) = ends
    return np.array([[left, low], [right, low], [right, high], [left, high]])
