"""Are the listed vertices all there are of each polytope? Positions with 256 places, and a proof that none is missing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cells import Cells, paired
from .fixed import PLACES
from .places import Places, floats, placed, times

ITERATIONS = 12
GUARD = 1 + 1e-6


@dataclass(frozen=True, eq=False)
class Vertices:
    """Positions (M, n) of the vertices of cells as multiples of 2^-256; error: how far a coordinate can be off at most."""

    points: Places
    error: float


def refined(cells: Cells, a: Places, b: Places) -> Vertices | str:
    """Return where the planes of each vertex's facets meet, with a bound on the error, or a reason.

    The n planes G x = g of a vertex meet in one point x* when an approximate inverse R has |I - R G| <= d < 1 in the
    largest row sum, and then |x - x*| <= |R| |G x - g| / (1 - d) for every x. Newton's method x -> x - R (G x - g) brings
    the residual down to the last places.
    """
    rows, which = np.unique(cells.facets // 2, axis=0, return_inverse=True)
    G, g = a[rows], b[rows]
    rough, start = floats(G), np.empty((len(rows), rows.shape[1]))
    size = np.abs(rough).max(axis=2, keepdims=True)
    if not np.all(size > 0):
        return "a cutting plane has no direction"
    start[which.reshape(-1)] = cells.start
    try:
        R = np.linalg.inv(rough / size) / np.swapaxes(size, 1, 2)
    except np.linalg.LinAlgError:
        return "the planes of a vertex are parallel"
    product = np.abs(np.eye(rows.shape[1]) - R @ rough) + 1e-14 * (np.abs(R) @ np.abs(rough))
    d = product.sum(axis=2).max(axis=1)
    if not np.all(d < 0.5):
        return "the planes of a vertex are too nearly parallel"
    shift = placed(R)
    x, g = placed(start), g[:, :, None]
    x = x[:, :, None]
    for _ in range(ITERATIONS):
        step = times(shift, g - times(G, x))
        x = x + step
        if np.max(np.abs(step), initial=0) <= 1 << (PLACES // 8):
            break
    residual = (np.abs(floats(g - times(G, x)))[:, :, 0] + 2.0**-PLACES).max(axis=1)
    error = GUARD * np.abs(R).sum(axis=2).max(axis=1) * residual / (1 - d)
    return Vertices(x[which.reshape(-1), :, 0], float(np.max(error, initial=0.0)) + 2.0**-PLACES)


def trouble(cells: Cells, a: Places, b: Places, vertices: Vertices) -> str:
    """Why the listed vertices might not be all vertices of each polytope {x0: every listed half-space}; "" when they are.

    If every listed point, the meeting of n facets, lies strictly within all other half-spaces of its cell, then it is a
    vertex and its n edges leave along n - 1 of its facets each. If each of these (n - 1)-sets of facets belongs to a
    second listed vertex, this is the other end of the edge. So no edge leads out of the list or to infinity, and since the
    vertices and edges of a polyhedron form a connected graph, the list is complete and the polyhedron bounded.
    """
    if not paired(cells)[2]:
        return "the listed vertices do not close up to polytopes"
    n = a.shape[1]
    pairs = np.unique(np.column_stack([np.repeat(cells.owner, n), cells.facets.reshape(-1)]), axis=0)
    counts = np.bincount(pairs[:, 0], minlength=len(cells))
    begin = np.concatenate([[0], np.cumsum(counts)[:-1]])
    vertex = np.repeat(np.arange(len(cells.owner)), counts[cells.owner])
    place = np.arange(len(vertex)) - np.repeat(np.cumsum(counts[cells.owner]) - counts[cells.owner], counts[cells.owner])
    facet = pairs[begin[cells.owner[vertex]] + place, 1]
    other = ~(cells.facets[vertex] == facet[:, None]).any(axis=1)
    vertex, facet = vertex[other], facet[other]
    plane, sign = facet // 2, np.where(facet % 2 == 0, 1, -1)
    rough_a, rough_b, x = floats(a), floats(b), floats(vertices.points)
    slack = sign * (rough_b[plane] - (rough_a[plane] * x[vertex]).sum(axis=1))
    terms = np.abs(rough_b[plane]) + (np.abs(rough_a[plane]) * np.abs(x[vertex])).sum(axis=1)
    need = 4 * (vertices.error * (1 + np.abs(rough_a[plane]).sum(axis=1)) + 2.0**-PLACES)
    near = np.flatnonzero(slack <= 1e-9 * terms + need)
    if near.size:
        fine = b[plane[near]] - times(a[plane[near]][:, None, :], vertices.points[vertex[near]][:, :, None])[:, 0, 0]
        room = sign[near] * floats(fine)
        if np.any(room <= need[near]):
            return "a vertex lies on, or to rounding on, a facet that it is not counted to"
    return ""
