"""Which constraints on affine moves to list: at all vertices of the initial states, or at few and then the violated ones."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..sets import Box, Ellipsoid
from ..sets.farthest import farthest
from ..spec import Spec
from .affine_problem import Cuts
from .occurring import drawn_in

MOST_CUTS = 20_000  # constraints listed at once; the violated ones are added otherwise


def first_cuts(spec: Spec, N: int, most: int = MOST_CUTS) -> tuple[Array, Cuts]:
    """Return anchors (n, a), initial states that occur and span all that do, and the limits on N moves at each of them.

    The anchors are all vertices when at most `most` constraints result, and else few points far apart.

    >>> from inc_casadi import Box
    >>> spec = Spec(Q=1.0, R=0.0, discount=1.0, initial=Box(0, 2), inputs=Box(-1, 1))
    >>> anchors, cuts = first_cuts(spec, 3)
    >>> anchors.tolist(), cuts.move.size
    ([[0.0, 2.0]], 12)
    """
    assert spec.inputs is not None
    facets = len(spec.inputs.h)
    anchors = drawn_in(spec.initial, _anchors(spec, N * facets, most))
    points = anchors.shape[1]
    move, facet, point = np.meshgrid(np.arange(N), np.arange(facets), np.arange(points), indexing="ij")
    return anchors, Cuts(move.ravel(), facet.ravel(), anchors[:, point.ravel()])


def violated(spec: Spec, U: Array, tol: float = 1e-7) -> Cuts:
    """Return for every move and half-space of the limits the initial state that violates it most, where one does.

    U: (N, m, n + 1); tol: what does not count, relative to the size of the limits.

    >>> spec = Spec(Q=1.0, R=0.0, discount=1.0, initial=Box(0, 2), inputs=Box(-1, 1))
    >>> violated(spec, np.array([[[1.0, 0.0]], [[0.1, 0.2]]])).point.tolist()
    [[2.0]]
    """
    assert spec.inputs is not None
    H, h = spec.inputs.H, spec.inputs.h
    N, _, size = U.shape
    rows = (H @ U).reshape(-1, size)
    points = drawn_in(spec.initial, farthest(spec.initial, rows[:, :-1].T))
    excess = np.sum(rows[:, :-1] * points.T, axis=1) + rows[:, -1] - np.tile(h, N)
    sizes = np.max(np.abs(H), axis=1) * np.max(np.abs(spec.inputs.vertices))
    worse = np.flatnonzero(excess > tol * np.tile(sizes, N))
    return Cuts(worse // len(h), worse % len(h), points[:, worse])


def _anchors(spec: Spec, constraints: int, most: int) -> Array:
    # At each anchor there will be so many constraints.
    support = spec.initial.support
    if isinstance(support, Ellipsoid):
        eigenvalues, V = np.linalg.eigh(support.P)
        return _star(support.center, V * np.sqrt(support.level / eigenvalues))
    if isinstance(support, Box) and 2**support.dimension * constraints > most:
        return _star(support.center, np.diag((support.upper - support.lower) / 2))
    points = (spec.initial if support is None else support).vertices
    return _spanning(points) if points.shape[1] * constraints > most else points


def _star(center: Array, axes: Array) -> Array:
    return np.hstack([center[:, None] + axes, center[:, None] - axes])


def _spanning(points: Array) -> Array:
    # The farthest points along the axes and against them, and along random directions: few, and spanning the hull.
    n = len(points)
    directions = np.hstack([np.eye(n), -np.eye(n), np.random.default_rng(0).standard_normal((n, 2 * n))])
    scaled = points / np.maximum(np.ptp(points, axis=1, keepdims=True), np.finfo(float).tiny)
    return points[:, np.unique(np.argmax(directions.T @ scaled, axis=1))]
