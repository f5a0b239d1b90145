"""Simplices, as an array (N, n + 1, n) of vertices: volumes, moments, draws, quadrature, and triangulations."""

from __future__ import annotations

from itertools import permutations
from math import factorial

import numpy as np

from ..arrays import Array
from ..errors import SolverError
from . import rules


def volumes(simplices: Array) -> Array:
    """Return the volumes (N,) of simplices (N, n + 1, n): |det(v_k - v_0)| / n!.

    >>> volumes(np.array([[[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]]])).round(12).tolist()
    [1.0]
    """
    edges = simplices[:, 1:] - simplices[:, :1]
    return np.abs(np.linalg.det(edges)) / factorial(simplices.shape[2])


def moments(simplices: Array, weights: Array) -> tuple[Array, Array]:
    """Return mean (n,) and covariance (n, n) of the mixture of uniform distributions on simplices.

    On one simplex with vertices v_0..v_n, E[x x'] = (sum v_i v_i' + s s') / ((n + 1) (n + 2)) with s = sum v_i. The
    vertices are taken relative to the mean, so that an offset far from the origin costs no digits.

    Parameters
    ----------
    simplices : (N, n + 1, n)
    weights : (N,) probabilities of the simplices, sum 1

    >>> mean, covariance = moments(np.array([[[0.0], [1.0]]]), np.ones(1))
    >>> mean.tolist(), covariance.round(6).tolist()
    ([0.5], [[0.083333]])
    """
    n = simplices.shape[2]
    mean = weights @ simplices.mean(axis=1)
    shifted = simplices - mean
    sums = shifted.sum(axis=1)
    squares = np.einsum("s,ski,skj->ij", weights, shifted, shifted) + np.einsum("s,si,sj->ij", weights, sums, sums)
    return mean, (squares + squares.T) / (2 * (n + 1) * (n + 2))


def sample(simplices: Array, weights: Array, N: int, rng: np.random.Generator) -> Array:
    """Return N draws (n, N): a simplex by its weight, then a uniform point by Dirichlet(1, ..., 1) coordinates.

    >>> sample(np.array([[[0.0], [1.0]]]), np.ones(1), 3, np.random.default_rng(1)).shape
    (1, 3)
    """
    chosen = rng.choice(len(weights), size=N, p=weights / weights.sum())
    barycentric = rng.dirichlet(np.ones(simplices.shape[1]), size=N)
    return np.einsum("sk,ski->is", barycentric, simplices[chosen])


def quadrature(simplices: Array, weights: Array, order: int) -> tuple[Array, Array]:
    """Return nodes (n, M) and weights (M,) of the conical product rule, order^n nodes on each simplex.

    Exact for polynomials of degree 2 order - 1.

    >>> nodes, weights = quadrature(np.array([[[0.0], [1.0]]]), np.ones(1), 2)
    >>> round(float(weights @ nodes[0] ** 3), 12)
    0.25
    """
    n = simplices.shape[2]
    rules.refuse_many([len(weights)] + [rules.whole("order", order, 1)] * n)
    barycentric, rule_weights = rules.simplex(n, order)
    nodes = np.einsum("kr,ski->isr", barycentric, simplices).reshape(n, -1)
    return nodes, np.multiply.outer(weights, rule_weights).ravel()


def kuhn(lower: Array, upper: Array) -> Array:
    """Return Kuhn's triangulation (n!, n + 1, n) of the box [lower, upper].

    One simplex for each order in which the coordinates rise from lower to upper. The vertices are the corners of the
    box to the last bit, so shared vertices are equal.

    >>> kuhn(np.zeros(2), np.ones(2)).tolist()
    [[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], [[0.0, 0.0], [0.0, 1.0], [1.0, 1.0]]]
    """
    n = len(lower)
    turn = np.array(list(permutations(range(n))))
    raised = turn[:, None, :] < np.arange(n + 1)[:, None]
    return np.where(raised, upper, lower)


def delaunay(vertices: Array, origin: Array, widths: Array) -> Array:
    """Return a triangulation (N, n + 1, n) of the convex hull of `vertices` (n, M), by Delaunay (Qhull).

    Cocircular vertices make Qhull add simplices without volume; they are dropped. In one dimension it is the interval.

    Parameters
    ----------
    vertices : (n, M)
    origin, widths : (n,) Qhull works in the coordinates (x - origin) / widths, of size about 1

    Raises
    ------
    SolverError : Qhull fails, or what it returns does not fill the hull

    >>> delaunay(np.array([[0.0, 1.0]]), np.zeros(1), np.ones(1)).tolist()
    [[[0.0], [1.0]]]
    """
    if vertices.shape[0] == 1:
        return np.array([[[vertices.min()], [vertices.max()]]])
    from scipy.spatial import ConvexHull, Delaunay, QhullError

    points = ((vertices - origin[:, None]) / widths[:, None]).T
    try:
        hull = ConvexHull(points).volume
        corners = Delaunay(points).simplices
    except QhullError as error:
        raise SolverError(f"Qhull did not triangulate {points.shape[0]} vertices: {error}") from error
    parts = volumes(points[corners])
    corners = corners[parts > 1e-13 * hull]
    if abs(parts.sum() - hull) > 1e-9 * hull:
        raise SolverError(f"the triangulation has volume {parts.sum():.12g}, but the hull has {hull:.12g} (scaled)")
    return vertices.T[corners]
