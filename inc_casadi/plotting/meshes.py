"""Fine triangulations to draw functions on, and the exact cost-to-go at their nodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array

INSIDE = 1e-6  # barycentric coordinates of a point on an edge may round below zero


@dataclass(frozen=True, eq=False)
class Mesh:
    """Nodes (N, 2) and triangles (T, 3) of node numbers, counterclockwise or not."""

    nodes: Array
    triangles: np.ndarray


def grid_in_triangle(k: int) -> tuple[Array, np.ndarray]:
    """Return a triangle cut into k^2 alike: nodes by barycentric weights (N, 3), triangles (k^2, 3) of node numbers.

    >>> weights, triangles = grid_in_triangle(2)
    >>> weights.shape, triangles.shape
    ((6, 3), (4, 3))
    """
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(k + 1), np.arange(k + 1), indexing="ij"))
    inside = i + j <= k
    i, j = i[inside], j[inside]
    number = np.full((k + 2, k + 2), -1)
    number[i, j] = np.arange(i.size)
    up = np.stack([number[i, j], number[i + 1, j], number[i, j + 1]], axis=1)
    down = np.stack([number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]], axis=1)
    cells = np.concatenate([part[np.all(part >= 0, axis=1)] for part in (up, down)])
    return np.stack([k - i - j, i, j], axis=1) / k, cells


def mesh(region: Any, triangles: int) -> Mesh:
    """Return about that many triangles that fill a Box or Polytope in the plane; its corners are nodes.

    >>> from inc_casadi import Box
    >>> made = mesh(Box([-1.0, 0.0], [1.0, 1.0]), 200)
    >>> made.nodes.shape, made.triangles.shape
    ((132, 2), (200, 3))
    """
    corners = np.asarray(region.simplices())
    weights, cells = grid_in_triangle(max(1, round(np.sqrt(triangles / len(corners)))))
    nodes = np.einsum("ak,ski->sai", weights, corners).reshape(-1, 2)
    shifts = len(weights) * np.arange(len(corners))
    return Mesh(nodes, (cells[None] + shifts[:, None, None]).reshape(-1, 3))


def cost_at(walk: Any, points: Array) -> Array:
    """Return the discounted cost from starting points (N, 2) of a completed walk: l'c l on the simplex that holds each.

    l are the barycentric coordinates of the point in it. Up to rounding this is the exact cost, since the loop, and with it
    the cost, is known in closed form on every simplex. A point in none, beside the initial set, gets NaN.
    """
    start, form = walk.done.start, walk.done.cost
    which, candidate = _beside(start[:, :, 0], points[:, 0])
    weights = _barycentric(start[which], points[candidate])
    depth = weights.min(axis=1)
    held = np.flatnonzero(depth >= -INSIDE)
    held = held[np.argsort(depth[held])]  # the simplex that holds a point best is written last, and stays
    which, candidate, weights = which[held], candidate[held], weights[held]
    out = np.full(len(points), np.nan)
    out[candidate] = np.einsum("pk,pkl,pl->p", weights, form[which], weights)
    return out


def _beside(corners: Array, points: Array) -> tuple[np.ndarray, np.ndarray]:
    """The pairs (triangle, point) where the point's first coordinate (N,) lies between those of the corners (S, 3)."""
    order = np.argsort(points, kind="stable")
    room = INSIDE * float(np.ptp(corners))
    first = np.searchsorted(points[order], corners.min(axis=1) - room, "left")
    counts = np.searchsorted(points[order], corners.max(axis=1) + room, "right") - first
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.repeat(np.arange(len(corners)), counts), order[within + np.repeat(first, counts)]


def _barycentric(corners: Array, points: Array) -> Array:
    """The weights (P, 3) of points (P, 2) in triangles (P, 3, 2); those of a flat one are NaN, which holds nothing."""
    (a, b), (c, d) = (corners[:, 1:] - corners[:, :1]).transpose(1, 2, 0)
    x, y = (points - corners[:, 0]).T
    area = a * d - b * c
    area = np.where(area == 0, np.nan, area)
    second, third = (x * d - y * c) / area, (a * y - b * x) / area
    return np.stack([1 - second - third, second, third], axis=1)
