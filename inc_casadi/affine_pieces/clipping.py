"""Cut simplices along the faces of a polytope: what lies within it, and what lies outside."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..pieces.simplices import Simplices, cut_along

NEAR = 1e-7  # a point this close to a face, in coordinates of size one, lies on it


def clipped(parts: Simplices, parent: np.ndarray, planes: Array) -> tuple[Simplices, np.ndarray, Simplices, np.ndarray]:
    """Return the parts within {z: a z <= b for all (a, b) in planes} and those outside, each with its parents.

    parts: N simplices of any dimension in R^p; parent (N,): numbers to pass on; planes (H, p + 1), |a| = 1.

    >>> from inc_casadi.pieces.simplices import begin
    >>> edge = begin(np.array([[[-2.0], [2.0]]]), np.ones(1))
    >>> inside, _, outside, _ = clipped(edge, np.zeros(1, int), np.array([[1.0, 1.0], [-1.0, 1.0]]))
    >>> inside.now.ravel().round(9).tolist(), sorted(outside.now[:, :, 0].round(9).tolist())
    ([-1.0, 1.0], [[-2.0, -1.0], [1.0, 2.0]])
    """
    beyond: list[tuple[Simplices, np.ndarray]] = []
    for plane in planes:
        parts, origin, _ = cut_along(parts, height_over(plane, parts))
        parent = parent[origin]
        out = np.asarray((height_over(plane, parts) > 0).any(axis=1))
        beyond.append((parts.take(out), parent[out]))
        parts, parent = parts.take(~out), parent[~out]
    outside = [each for each, _ in beyond]
    return parts, parent, outside[0].joined(*outside[1:]), np.concatenate([each for _, each in beyond])


def height_over(plane: Array, parts: Simplices) -> Array:
    """Return how far vertices (N, c) lie beyond a plane (a, b), 0 where they are near it.

    >>> from inc_casadi.pieces.simplices import begin
    >>> height_over(np.array([1.0, 2.0]), begin(np.array([[[2.0], [3.0]]]), np.ones(1))).tolist()
    [[0.0, 1.0]]
    """
    height = parts.now @ plane[:-1] - plane[-1]
    return np.asarray(np.where(np.abs(height) <= NEAR, 0.0, height))


def touches(parts: Simplices, low: Array, high: Array) -> np.ndarray:
    """Return which of the parts (N,) have bounding boxes that meet the box [low, high].

    >>> from inc_casadi.pieces.simplices import begin
    >>> touches(begin(np.array([[[0.0], [1.0]], [[2.0], [3.0]]]), np.ones(2)), np.array([1.5]), np.array([2.5])).tolist()
    [False, True]
    """
    return np.asarray(((parts.now.min(axis=1) <= high + NEAR) & (parts.now.max(axis=1) >= low - NEAR)).all(axis=1))
