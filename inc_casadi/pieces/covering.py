"""Simplices that surely cover a region {x: H x <= h}, though its corners are known only to rounding."""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..sets import Box, Polytope
from .linear import determinant

ENLARGED = (0.0, 1e-13, 1e-11)  # relative to the distance from the centre; tried in turn
Facet = tuple[tuple[float, ...], ...]


def covering(region: Box | Polytope) -> Array | None:
    """Return simplices (N, n+1, n) in floats that cover the region, proved by `covers`; None when that fails.

    A box is covered by Kuhn's triangulation, whose corners are the box's own floats. The corners of a polytope are
    rounded, so they are moved away from the centre by as little as makes the proof succeed: not at all when they are
    floats, else by 1e-13 or 1e-11 of their distance.

    >>> covering(Polytope([[3.0, 0.0], [-7.0, 0.1], [0.0, 1.0], [0.3, -1.0]], [1.0, 1.0, 1.0, 1.0])).shape
    (2, 3, 2)
    """
    simplices = region.simplices()
    if isinstance(region, Box):
        return simplices
    for share in ENLARGED:
        enlarged = region.center + (1.0 + share) * (simplices - region.center) if share else simplices
        if covers(enlarged, region.H, region.h):
            return enlarged
    return None


def covers(simplices: Array, H: Array, h: Array) -> bool:
    """Return whether it is proved, in Fractions, that simplices (N, n+1, n) cover {x: H x <= h}; sufficient.

    Proved means: no simplex is flat; each facet of each is either shared with a simplex on its other side, or has a row i
    with H_i v >= h_i at all its corners v; and a simplex's centroid p has H p < h. Then let x be a point of the region
    such that the segment from p to x meets no face of dimension n - 2 or less (such x are dense, and the union is
    closed). The segment leaves a simplex through a facet. If that is shared, it enters the next. If not, then H_i y >= h_i
    at the point y of leaving, while H_i p < h_i, so H_i x > h_i unless y = x. As x lies in the region, it is y: covered.

    >>> triangle = np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]])
    >>> H, h = np.array([[-1.0, 0.0], [0.0, -1.0], [1.0, 1.0]]), np.array([0.0, 0.0, 1.0])
    >>> covers(triangle, H, h), covers(triangle, H, h + [0.0, 0.0, 1e-300])
    (True, True)
    >>> covers(triangle, H, h + [0.0, 0.0, 1e-15])
    False
    """
    rows, limits = exact(H), exact(h)
    sides: dict[Facet, list[Fraction]] = {}
    for corners in simplices:
        numbers = exact(corners)
        size = determinant(numbers[1:] - numbers[0])
        if size == 0:
            return False
        for k in range(len(corners)):
            facet, sign = _facet(corners, k)
            sides.setdefault(facet, []).append(size * sign)
    if not any(np.all(rows @ (exact(corners).sum(axis=0) / len(corners)) < limits) for corners in simplices):
        return False
    return all(_shared(found) or _outside(facet, rows, limits) for facet, found in sides.items())


def _facet(corners: Array, k: int) -> tuple[Facet, int]:
    """The facet opposite to corner k with its corners in order, and the sign by which the ordering turns the simplex."""
    kept = [tuple(float(entry) for entry in corner) for i, corner in enumerate(corners) if i != k]
    order = sorted(range(len(kept)), key=lambda i: kept[i])
    swaps = sum(order[i] > order[j] for i, j in combinations(range(len(order)), 2))
    return tuple(kept[i] for i in order), (-1) ** (k + swaps)


def _shared(turns: list[Fraction]) -> bool:
    """Whether simplices lie on both sides: with the facet's corners in one order, they are turned oppositely."""
    return min(turns) < 0 < max(turns)


def _outside(facet: Facet, rows: Array, limits: Array) -> bool:
    values = rows @ exact(np.array(facet)).T
    return bool(np.any(np.all(values >= limits[:, None], axis=1)))
