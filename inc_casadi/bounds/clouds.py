"""Probabilities and means of the cells of a Gaussian or an ellipsoid, which closed forms give."""

from __future__ import annotations

from math import exp, lgamma, log, pi, sqrt

import numpy as np

from ..arrays import Array
from ..sets import Distribution, Ellipsoid, Gaussian, Uniform
from ..sets.simplex import volumes


def cloud(initial: Distribution, cells: int) -> tuple[Array, Array]:
    """Return the probabilities (c,) and means (n, c) of about `cells` cells of the distribution, at least one.

    A Gaussian is cut into a grid along its principal axes; an ellipsoid by its principal planes, then each part into a fan
    of simplices and the rest. Any other distribution is one cell.

    >>> from inc_casadi import Box, Uniform
    >>> cloud(Uniform(Box([0, 0], [1, 1])), 5)[1].tolist()
    [[0.5], [0.5]]
    """
    if isinstance(initial, Gaussian):
        return _gaussian(initial, cells)
    if isinstance(initial, Uniform) and isinstance(initial.support, Ellipsoid):
        return _ball(initial.support, cells)
    return np.ones(1), initial.mean[:, None]


def intervals(widths: Array, cells: int) -> list[int]:
    """Return into how many parts to cut each axis: alike at first, then what is left to the widest axes.

    >>> intervals(np.array([1.0, 2.0]), 1600), intervals(np.array([1.0, 2.0, 0.5]), 6)
    ([40, 40], [2, 2, 1])
    """
    cut = int(np.count_nonzero(widths))
    counts = np.where(widths > 0, max(1, int(cells ** (1 / max(cut, 1)) + 1e-9)), 1)
    while True:
        least = np.min(counts[widths > 0], initial=cells)
        finer = counts[:, None] + np.eye(len(counts), dtype=int)
        allowed = np.flatnonzero((np.prod(finer, axis=0) <= cells) & (widths > 0) & (counts <= least))
        if not allowed.size:
            return [int(count) for count in counts]
        counts[allowed[np.argmax(widths[allowed])]] += 1


def _product(axes: list[Array]) -> Array:
    return np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")])


def _halved(corners: Array) -> Array:
    # Cut every simplex (N, n + 1, n) in two at the midpoint of its longest edge.
    first, second = np.triu_indices(corners.shape[1], 1)
    longest = np.argmax(np.sum((corners[:, first] - corners[:, second]) ** 2, axis=2), axis=1)
    rows, i, j = np.arange(len(corners)), first[longest], second[longest]
    middle = (corners[rows, i] + corners[rows, j]) / 2
    left, right = corners.copy(), corners.copy()
    left[rows, i], right[rows, j] = middle, middle
    return np.concatenate([left, right])


def _gaussian(gaussian: Gaussian, cells: int) -> tuple[Array, Array]:
    from scipy.special import ndtr, ndtri

    eigenvalues, V = np.linalg.eigh(gaussian.covariance)
    scales = np.sqrt(np.maximum(eigenvalues, 0.0))
    axes, weights = [], []
    for count, scale in zip(intervals(scales, cells), scales, strict=True):
        # Ends at the quantiles of a normal three times as wide in variance: the best intervals for many cells.
        # The mean of z over a < z < b is (density(a) - density(b)) / P(a < z < b).
        ends = sqrt(3) * ndtri(np.arange(count + 1) / count)
        weights.append(np.diff(ndtr(ends)))
        axes.append(scale * -np.diff(np.exp(-(ends**2) / 2)) / sqrt(2 * pi) / weights[-1])
    return np.prod(_product(weights), axis=0), gaussian.mean[:, None] + V @ _product(axes)


def _ball(ellipsoid: Ellipsoid, cells: int) -> tuple[Array, Array]:
    n = ellipsoid.dimension
    eigenvalues, V = np.linalg.eigh(ellipsoid.P)
    T = V * np.sqrt(ellipsoid.level / eigenvalues)
    if n == 1:
        places = (2 * np.arange(cells) + 1) / cells - 1
        return np.full(cells, 1 / cells), ellipsoid.center[:, None] + T @ places[None]
    if 2**n > cells:
        return np.ones(1), ellipsoid.center[:, None]
    parts, centroids = _orthant(n, cells // 2**n)
    signs = _product([np.array([-1.0, 1.0])] * n)
    points = (signs[:, :, None] * centroids[:, None, :]).reshape(n, -1)
    return np.tile(parts, 2**n) / 2**n, ellipsoid.center[:, None] + T @ points


def _orthant(n: int, cells: int) -> tuple[Array, Array]:
    # The positive orthant of the unit ball: a fan of simplices with a corner at the origin and the others on the
    # sphere, cut further, and as the last cell what lies between the fan and the sphere. Its mean is what the fan
    # leaves of the orthant's, each coordinate of which is Gamma(n/2 + 1) / (sqrt(pi) (n + 1) Gamma((n + 1)/2)).
    mean = 2 * exp(lgamma(n / 2 + 1) - lgamma((n + 1) / 2)) / (sqrt(pi) * (n + 1)) * np.ones(n)
    if cells < 2:
        return np.ones(1), mean[:, None]
    directions = np.eye(n)[None]
    while (2 * len(directions)) ** n <= cells ** (n - 1):
        directions = _halved(directions)
    directions = directions / np.linalg.norm(directions, axis=2, keepdims=True)
    corners = np.concatenate([np.zeros((len(directions), 1, n)), directions], axis=1)
    while 2 * len(corners) < cells:
        corners = _halved(corners)
    whole = exp(n / 2 * log(pi) - lgamma(n / 2 + 1)) / 2**n
    parts = volumes(corners) / whole
    centroids = corners.mean(axis=1).T
    left = 1 - parts.sum()
    return np.append(parts, left), np.column_stack([centroids, (mean - centroids @ parts) / left])
