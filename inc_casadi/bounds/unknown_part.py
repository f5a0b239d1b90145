"""How far the initial state is known from y_0, ..., y_k at best: a lower bound on the mean of its conditional covariance."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations
from typing import Any

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..pieces.linear import identity, solve
from ..plant import Plant
from ..sets import Box, Distribution, Ellipsoid, Gaussian, Uniform
from .information import null_space, unseen

_MOST_PAIRED, _MOST_TRIPLED = 16, 9  # coordinates up to which all supports of so many are tried
_TRIALS = 200  # directions tried where there is a choice


@dataclass(frozen=True, eq=False)
class Chord:
    """A direction z that y_0, ..., y_k do not tell: the combination of `null_space` vectors on some coordinates.

    Parameters
    ----------
    k : moves after the first
    support : (s,) coordinates, increasing
    coefficients : (d,) of the null vectors of [C; CA; ...; CA^k] on these coordinates
    """

    k: int
    support: np.ndarray
    coefficients: Array

    def direction(self, levels: list[np.ndarray]) -> np.ndarray | None:
        """Return z (n,) in Fractions, or None where the numbers do not fit; levels: what is `unseen`."""
        support = np.asarray(self.support)
        if not (0 <= self.k < len(levels) and support.ndim == 1 and support.dtype.kind == "i" and support.size):
            return None
        if support[0] < 0 or support[-1] >= len(levels[0]) or np.any(np.diff(support) <= 0):
            return None
        Z = within(levels[self.k], support)
        if self.coefficients.shape != Z.shape[1:] or not np.all(np.isfinite(self.coefficients)):
            return None
        return Z @ exact(self.coefficients)


def within(Z: np.ndarray, support: np.ndarray) -> np.ndarray:
    """Return a basis (n, d) of what a subspace has in common with the vectors that are zero outside of a support.

    >>> within(exact(np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])), np.array([0, 2])).astype(float).tolist()
    [[1.0], [0.0], [1.0]]
    """
    outside = np.setdiff1d(np.arange(len(Z)), support)
    return Z @ null_space(Z[outside]) if outside.size else Z


def chord_variance(width: np.ndarray, z: np.ndarray) -> Any:
    """Return the mean variance of t for x + t z on the chords of a box of these widths, x uniform, in floats or Fractions.

    On a chord of length l (in t) the variance is l^2/12; over x uniform the mean is the integral of l^3/12 over the chords
    by the volume. The box and the box moved by t z have the volume prod_i (width_i - t |z_i|) in common, and the chords
    (l - t) each; as the integral of t (l - t) is l^3/6,

        mean = 1/2 integral_0^T t prod_i (1 - t |z_i| / width_i) dt,   T = min_i width_i / |z_i|.

    >>> float(chord_variance(np.array([6.0]), np.array([1.0])))
    3.0
    >>> chord_variance(exact(np.array([2.0, 2.0])), exact(np.array([1.0, 1.0])))
    Fraction(1, 6)
    """
    used = np.flatnonzero(z)
    if not used.size or np.any(width[used] == 0):
        return width[0] * 0
    rates = np.abs(z[used]) / width[used]
    T = 1 / np.max(rates)
    powers = [T * 0 + 1]
    for rate in rates:
        powers = [a - rate * b for a, b in zip([*powers, 0], [0, *powers], strict=True)]
    return sum(a * T ** (j + 2) / (j + 2) for j, a in enumerate(powers)) / 2


def unknown_part(plant: Plant, initial: Distribution, k: int, chords: tuple[Chord, ...]) -> np.ndarray | None:
    """Return M (n, n) in Fractions with E Cov(x_0 | C x_0, ..., C A^k x_0) - M >= 0, or None where nothing is known.

    * Gaussian, or uniform on an ellipsoid: the conditional mean is linear and M = Z (Z'S^-1 Z)^-1 Z' exact, S the
      covariance and Z a basis of what is not told (of the unit ball, sections of dimension d at the distance s from the
      center have the covariance (1 - s^2)/(d + 2), on average 1/(n + 2)).
    * Uniform on a box: telling the estimator more only helps it, so let it know all but the multiples of some z_j, of
      which no two have a coordinate in common. Then x_0 is uniform on a product of chords and
      M = sum_j (`chord_variance` of z_j) z_j z_j'. Exact where y_0..y_k tell coordinates and nothing else, and where one
      direction is all that they leave open.

    Raises no error for chords that do not fit: the answer is None.
    """
    if isinstance(initial, Gaussian) or (isinstance(initial, Uniform) and isinstance(initial.support, Ellipsoid)):
        return _linear(plant, initial, k)
    if not (isinstance(initial, Uniform) and isinstance(initial.support, Box)):
        return None
    width = exact(initial.support.upper) - exact(initial.support.lower)
    levels = unseen(plant)
    M, taken = np.full((plant.n, plant.n), Fraction(0), dtype=object), np.zeros(plant.n, dtype=bool)
    for chord in chords:
        if chord.k != k:
            continue
        z = chord.direction(levels)
        if z is None or np.any(taken & (z != 0)):
            return None
        taken |= z != 0
        M = M + chord_variance(width, z) * np.outer(z, z)
    return M


def _linear(plant: Plant, initial: Distribution, k: int) -> np.ndarray | None:
    levels = unseen(plant)
    if k >= len(levels):
        return None
    Z = levels[k]
    if isinstance(initial, Gaussian):
        S = exact(initial.covariance)
        try:
            weight = solve(S, identity(plant.n, S))
        except np.linalg.LinAlgError:
            return None
    else:
        region = initial.support
        assert isinstance(region, Ellipsoid)
        weight = exact(region.P) * ((plant.n + 2) / Fraction(region.level))
    within_Z = Z.T @ weight @ Z
    return Z @ solve(within_Z, Z.T)


def best_chords(plant: Plant, width: Array, k: int, weight: Array) -> tuple[Chord, ...]:
    """Return chords without common coordinates for which tr(weight M) of `unknown_part` is large; weight (n, n) >= 0.

    Of all directions on one, two or three coordinates and the best found of random ones on all, greedily that of the
    largest share first, with and without precedence for those on few coordinates, whichever adds up to more.

    >>> plant = Plant(np.eye(3), np.eye(3), C=[[1.0, 1.0, 0.0]])
    >>> sorted(chord.support.tolist() for chord in best_chords(plant, np.ones(3), 0, np.eye(3)))
    [[0, 1], [2]]
    """
    Z = unseen(plant)[k]
    used = np.flatnonzero(np.any(Z != 0, axis=1))
    most = 3 if used.size <= _MOST_TRIPLED else 2 if used.size <= _MOST_PAIRED else 1
    supports = [np.array(s) for size in range(1, most + 1) for s in combinations(used, size)] + [used]
    candidates = [found for s in supports if (found := _tried(Z, s, width, k, weight)) is not None]
    return max((_greedily(candidates, size) for size in (0, 1, 2, 3)), key=lambda found: found[1])[0]


def _greedily(candidates: list[tuple[Chord, float]], first: int) -> tuple[tuple[Chord, ...], float]:
    # Chords without common coordinates, those on up to `first` coordinates first, and the sum of their shares.
    chosen, taken, total = list[Chord](), set[int](), 0.0
    for chord, share in sorted(candidates, key=lambda pair: (pair[0].support.size > first, -pair[1])):
        if share > 0 and taken.isdisjoint(chord.support.tolist()):
            chosen.append(chord)
            taken.update(chord.support.tolist())
            total += share
    return tuple(chosen), total


def _tried(Z: np.ndarray, support: np.ndarray, width: Array, k: int, weight: Array) -> tuple[Chord, float] | None:
    # The chord on the support and its share; None where it does not use the whole of it, seen in floats first.
    outside = np.setdiff1d(np.arange(len(Z)), support)
    if outside.size and np.linalg.matrix_rank(Z[outside].astype(float), rtol=1e-10) == Z.shape[1]:
        return None
    exactly = within(Z, support)
    basis = exactly.astype(float)
    d = basis.shape[1]
    if not d or not np.all(np.any(exactly != 0, axis=1)[support]):
        return None
    if d == 1:
        trials = np.ones((1, 1))
    else:
        root = np.linalg.qr(basis / width[:, None])[1]
        trials = np.linalg.solve(root, np.random.default_rng(0).standard_normal((d, _TRIALS))).T
        _, V = np.linalg.eigh(np.linalg.solve(root.T, basis.T @ weight @ basis) @ np.linalg.inv(root))
        trials = np.vstack([np.linalg.solve(root, V).T, trials])
    shares = [float(chord_variance(width, basis @ a)) * float(a @ basis.T @ weight @ basis @ a) for a in trials]
    best = int(np.argmax(shares))
    return Chord(k, support, trials[best]), shares[best]
