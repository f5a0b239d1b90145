"""The second moment of a distribution as exact fractions of its stored parameters, and exact semidefiniteness."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from ..blocks import exact
from ..pieces.linear import determinant, identity, solve
from ..sets import Box, Distribution, Ellipsoid, Empirical, Moments, Polytope, Uniform
from .exact_polytope import corners, tiling

ONE = 1 << 200  # rounding of what is known of a polytope


def extended_moment(initial: Distribution) -> np.ndarray | str:
    """Return M = E [x; 1][x; 1]' (n + 1, n + 1) in Fractions, or why there is none.

    Every stored parameter is taken as the number it is: the ends of a box, P and level of an ellipsoid, the half-spaces of
    a polytope (`corners`), points and weights of finitely many points (the weights divided by their sum), the moments
    themselves where only these are known. Of a polytope, whose vertices have too many denominators to add up, it is a
    matrix M- with M - M- >= 0 that differs by less than 2^-190 of its size, and is semidefinite too: a quadratic cost
    tr(W X M X'), W >= 0, is only lowered.

    >>> extended_moment(Uniform(Box(0, 2))).tolist()
    [[Fraction(4, 3), Fraction(1, 1)], [Fraction(1, 1), Fraction(1, 1)]]
    """
    if isinstance(initial, Empirical):
        weights = exact(initial.weights)
        return _mixture(exact(initial.points), weights / weights.sum())
    if isinstance(initial, Moments):
        covariance = exact(initial.covariance)
        if not is_semidefinite(covariance):
            return "the stored covariance has a negative eigenvalue, if only by rounding"
        return _joined(exact(initial.mean), covariance)
    if isinstance(initial, Uniform) and isinstance(initial.support, Box):
        lower, upper = exact(initial.support.lower), exact(initial.support.upper)
        return _joined((lower + upper) / 2, identity(len(lower), lower) * (upper - lower) ** 2 / 12)
    if isinstance(initial, Uniform) and isinstance(initial.support, Ellipsoid):
        P, n = exact(initial.support.P), initial.dimension
        shape = Fraction(initial.support.level) * solve(P, identity(n, P))
        return _joined(exact(initial.support.center), shape / (n + 2))
    if isinstance(initial, Uniform) and isinstance(initial.support, Polytope):
        return _polytope(initial.support)
    return f"the moments of a {type(initial).__name__} are not stated as fractions"


def is_semidefinite(matrix: np.ndarray) -> bool:
    """Return whether a symmetric matrix of Fractions is positive semidefinite; necessary and sufficient.

    Elimination along the diagonal: a negative pivot refuses, and so does a zero one whose row is not zero (its 2 x 2
    minors would be negative); a positive one leaves its Schur complement.

    >>> is_semidefinite(exact(np.ones((2, 2)))), is_semidefinite(exact(np.array([[0.0, 1.0], [1.0, 5.0]])))
    (True, False)
    """
    rest = matrix
    while len(rest):
        pivot, row = rest[0, 0], rest[0, 1:]
        if pivot < 0 or (pivot == 0 and np.any(row != 0)):
            return False
        rest = rest[1:, 1:] if pivot == 0 else rest[1:, 1:] - np.outer(row, row / pivot)
    return True


def _joined(mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    vector = np.concatenate([mean, identity(1, mean)[0]])
    M = np.outer(vector, vector)
    M[:-1, :-1] += covariance
    return M


def _mixture(points: np.ndarray, weights: np.ndarray) -> np.ndarray:
    lifted = np.vstack([points, identity(1, points).repeat(points.shape[1], axis=1)])
    return (lifted * weights) @ lifted.T


def _polytope(region: Polytope) -> np.ndarray | str:
    """A matrix below M in the order of semidefinite matrices, by less than 2^-190 of its size; see `extended_moment`.

    With z = [x; 1] and s the sum of the n + 1 vertices, E z z' = (sum v v' + s s') / ((n + 1)(n + 2)) on a simplex. Shares
    of the simplices that are rounded down give less, as each part is semidefinite. Vertices that are off by e in each
    coordinate, of sizes up to c >= 1, move E z z' by at most 4 (n + 1) c e, which is subtracted from the diagonal.
    """
    found = corners(region)
    if isinstance(found, str):
        return found
    n, simplices = region.dimension, tiling(found)
    edges = found.points[simplices[:, 1:]] - found.points[simplices[:, :1]]
    sizes = np.array([abs(determinant(each)) for each in edges], dtype=object)
    shares = sizes / sizes.max() * ONE // 1
    shares = shares * Fraction(1, int(shares.sum()) + len(shares))
    c = Fraction(2) ** max(0, int(np.max(np.abs(found.points))).bit_length())
    points = found.points / c * ONE // 1 * (c / ONE)
    lifted = np.hstack([points, identity(1, points).repeat(len(points), axis=0)])
    weights, sums = np.full(len(points), Fraction(0), dtype=object), lifted[simplices].sum(axis=1)
    np.add.at(weights, simplices, shares[:, None])
    M = ((lifted.T * weights) @ lifted + (sums.T * shares) @ sums) / ((n + 1) * (n + 2))
    M = M - identity(n + 1, M) * (4 * (n + 1) * c * c / ONE)
    return M if is_semidefinite(M) else "a polytope of initial states is too thin"
