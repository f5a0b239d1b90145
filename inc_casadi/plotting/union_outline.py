"""The boundary of a union of convex polygons, as line segments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import Array
from .outlines import hull

ASIDE = 1e-7  # of the union's size: how far outside an edge one looks for other polygons
SHORTEST = 1e-5  # of the union's size: a piece of boundary below this is the corner of looking aside


def boundary(polygons: Sequence[Array]) -> Array:
    """Return the boundary (S, 2, 2) of a union of convex polygons (N, 2), as segments from point to point.

    A point of an edge is on it when no other polygon holds the point just outside the edge. On the line just outside, a
    convex polygon holds an interval; what all these leave of the edge remains. So T-junctions and overlaps are no special
    case. Flat polygons are drawn as the segments that they are.

    >>> square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    >>> float(np.linalg.norm(np.diff(boundary([square, square + [1.0, 0.5]]), axis=1), axis=2).sum().round(4))
    7.0
    """
    outlines = [corners for corners in map(hull, polygons) if len(corners) > 1]
    if not outlines:
        return np.zeros((0, 2, 2))
    start = np.concatenate(outlines)
    along = np.concatenate([np.roll(corners, -1, axis=0) - corners for corners in outlines])
    size = float(np.max(np.ptp(start, axis=0)))
    length = np.linalg.norm(along, axis=1)
    outside = start + ASIDE * size * np.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
    covered = _covered(outside, along, [corners for corners in outlines if len(corners) > 2])
    pieces = [(a + low * d, a + high * d) for a, d, intervals, whole in zip(start, along, covered, length, strict=True)
              for low, high in _left(intervals) if (high - low) * whole > SHORTEST * size]
    return np.array(pieces).reshape(-1, 2, 2)


def _covered(start: Array, along: Array, outlines: list[Array]) -> list[list[tuple[float, float]]]:
    """The intervals of t in [0, 1] on which start + t along lies in some polygon, for each of the lines."""
    found: list[list[tuple[float, float]]] = [[] for _ in start]
    low, high = np.minimum(start, start + along), np.maximum(start, start + along)
    for corners in outlines:
        near = np.flatnonzero(np.all((high >= corners.min(axis=0)) & (low <= corners.max(axis=0)), axis=1))
        first, last = _held(start[near], along[near], corners)
        for i in np.flatnonzero(first < last):
            found[near[i]].append((float(first[i]), float(last[i])))
    return found


def _held(start: Array, along: Array, corners: Array) -> tuple[Array, Array]:
    """First and last t (N,) in [0, 1] for which start + t along lies in one polygon; first >= last when none does."""
    sides = np.roll(corners, -1, axis=0) - corners
    offset = start[:, None, :] - corners
    height = sides[:, 0] * offset[:, :, 1] - sides[:, 1] * offset[:, :, 0]  # positive to the left, that is inside
    climb = sides[:, 0] * along[:, None, 1] - sides[:, 1] * along[:, None, 0]
    at = -height / np.where(climb == 0, 1.0, climb)
    first = np.max(np.where(climb > 0, at, 0.0), axis=1, initial=0.0)
    last = np.min(np.where(climb < 0, at, 1.0), axis=1, initial=1.0)
    return first, np.where(np.any((climb == 0) & (height < 0), axis=1), first, last)


def _left(covered: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """What intervals leave of [0, 1].

    >>> _left([(0.5, 1.0), (0.0, 0.25)])
    [(0.25, 0.5)]
    """
    pieces, reached = [], 0.0
    for first, last in sorted(covered):
        if first > reached:
            pieces.append((reached, first))
        reached = max(reached, last)
    return [*pieces, (reached, 1.0)] if reached < 1.0 else pieces
