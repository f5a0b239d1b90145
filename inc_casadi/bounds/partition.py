"""Cut the initial distribution into cells of known probability and mean, for Jensen's inequality."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, lgamma, log, pi, sqrt

import numpy as np

from ..arrays import Array
from ..sets import Box, Distribution, Ellipsoid, Empirical, Gaussian, Polytope, Uniform
from ..sets.simplex import volumes


@dataclass(frozen=True, eq=False)
class Cells:
    """The probabilities (c,) of the cells of a partition and the conditional means, columns (n, c)."""

    probabilities: Array
    centroids: Array

    def within(self, second_moment: Array) -> Array:
        """Return the expected covariance inside a cell, E[x x'] - sum_i p_i c_i c_i'.

        >>> Cells(np.ones(1), np.ones((1, 1))).within(np.array([[4.0]])).tolist()
        [[3.0]]
        """
        return second_moment - (self.centroids * self.probabilities) @ self.centroids.T

    def divide(self, initial: Distribution, tol: float = 1e-9) -> bool:
        """Return whether mass and mean are those of the distribution, and no covariance inside the cells is negative.

        Necessary for a partition, not sufficient.

        >>> from inc_casadi import Box, Uniform
        >>> Cells(np.ones(1), np.ones((1, 1))).divide(Uniform(Box(0, 2)))
        True
        """
        size = float(np.max(np.abs(self.centroids))) + float(np.sqrt(np.trace(initial.second_moment)))
        off = np.max(np.abs(self.centroids @ self.probabilities - initial.mean))
        inside = np.linalg.eigvalsh(self.within(initial.second_moment))[0]
        whole = np.all(self.probabilities >= 0) and abs(float(np.sum(self.probabilities)) - 1) <= tol
        return bool(whole and off <= tol * size and inside >= -tol * size**2)


def partition(initial: Distribution, cells: int) -> Cells:
    """Return about `cells` cells of the distribution, at least one.

    A box is cut into a grid and a polytope into simplices, halved again and again at their longest edges; a Gaussian
    into a grid along its principal axes; an ellipsoid by its principal planes, then each part into a fan of simplices
    and the rest; of finitely many points each is its own cell. Any other distribution is one cell.

    Parameters
    ----------
    cells : >= 1; finitely many points all count, however many

    >>> from inc_casadi import Box, Uniform
    >>> partition(Uniform(Box([0, 0], [1, 1])), 5).centroids.tolist()
    [[0.25, 0.25, 0.75, 0.75], [0.25, 0.75, 0.25, 0.75]]
    """
    if isinstance(initial, Empirical):
        kept = initial.weights > 0
        return Cells(initial.weights[kept], initial.points[:, kept])
    if isinstance(initial, Gaussian):
        return _gaussian(initial, cells)
    if isinstance(initial, Uniform) and isinstance(initial.support, Box):
        return _grid(initial.support, cells)
    if isinstance(initial, Uniform) and isinstance(initial.support, Polytope):
        return _simplices(initial.support.simplices(), cells)
    if isinstance(initial, Uniform) and isinstance(initial.support, Ellipsoid):
        return _ball(initial.support, cells)
    return Cells(np.ones(1), initial.mean[:, None])


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


def _grid(box: Box, cells: int) -> Cells:
    counts = intervals(box.upper - box.lower, cells)
    spans = zip(box.lower, box.upper, counts, strict=True)
    centroids = _product([low + (high - low) * (np.arange(count) + 0.5) / count for low, high, count in spans])
    number = centroids.shape[1]
    return Cells(np.full(number, 1 / number), centroids)


def _simplices(corners: Array, cells: int) -> Cells:
    while 2 * len(corners) <= cells:
        corners = _halved(corners)
    sizes = volumes(corners)
    return Cells(sizes / sizes.sum(), corners.mean(axis=1).T)


def _halved(corners: Array) -> Array:
    # Cut every simplex (N, n + 1, n) in two at the midpoint of its longest edge.
    first, second = np.triu_indices(corners.shape[1], 1)
    longest = np.argmax(np.sum((corners[:, first] - corners[:, second]) ** 2, axis=2), axis=1)
    rows, i, j = np.arange(len(corners)), first[longest], second[longest]
    middle = (corners[rows, i] + corners[rows, j]) / 2
    left, right = corners.copy(), corners.copy()
    left[rows, i], right[rows, j] = middle, middle
    return np.concatenate([left, right])


def _gaussian(gaussian: Gaussian, cells: int) -> Cells:
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
    return Cells(np.prod(_product(weights), axis=0), gaussian.mean[:, None] + V @ _product(axes))


def _ball(ellipsoid: Ellipsoid, cells: int) -> Cells:
    n = ellipsoid.dimension
    eigenvalues, V = np.linalg.eigh(ellipsoid.P)
    T = V * np.sqrt(ellipsoid.level / eigenvalues)
    if n == 1:
        radius = float(np.abs(T[0, 0]))
        return _grid(Box(ellipsoid.center - radius, ellipsoid.center + radius), cells)
    if 2**n > cells:
        return Cells(np.ones(1), ellipsoid.center[:, None])
    part = _orthant(n, cells // 2**n)
    signs = _product([np.array([-1.0, 1.0])] * n)
    points = (signs[:, :, None] * part.centroids[:, None, :]).reshape(n, -1)
    return Cells(np.tile(part.probabilities, 2**n) / 2**n, ellipsoid.center[:, None] + T @ points)


def _orthant(n: int, cells: int) -> Cells:
    # The positive orthant of the unit ball: a fan of simplices with a corner at the origin and the others on the
    # sphere, cut further, and as the last cell what lies between the fan and the sphere. Its mean is what the fan
    # leaves of the orthant's, each coordinate of which is Gamma(n/2 + 1) / (sqrt(pi) (n + 1) Gamma((n + 1)/2)).
    mean = 2 * exp(lgamma(n / 2 + 1) - lgamma((n + 1) / 2)) / (sqrt(pi) * (n + 1)) * np.ones(n)
    if cells < 2:
        return Cells(np.ones(1), mean[:, None])
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
    return Cells(np.append(parts, left), np.column_stack([centroids, (mean - centroids @ parts) / left]))
