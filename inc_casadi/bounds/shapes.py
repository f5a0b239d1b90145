"""Cells as mean and spans, which is all that the expectation of an affine or quadratic function over them needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array

MOST_CORNERS = 6  # spans of boxes up to which all corners are listed


@dataclass(frozen=True, eq=False)
class Shapes:
    """c cells of a distribution: x = center + spans xi, with E xi = 0 and covariance spans spans' / divisor.

    A box has its half-widths as spans, xi in [-1, 1]^n and the divisor 3. A simplex has its vertices less their mean, xi
    mixing them with weights of sum 1, and the divisor (n + 1)(n + 2). A point has no spans.

    Parameters
    ----------
    probabilities : (c,)
    centers : (n, c) conditional means
    spans : (n, q, c)
    divisor : of the covariance
    symmetric : whether -spans belong to the cell as well, as in boxes
    rounding : (n,) how far centers and spans may be from what they stand for
    doubt : (c,) the same of the probabilities, as a share of them
    """

    probabilities: Array
    centers: Array
    spans: Array
    divisor: int
    symmetric: bool
    rounding: Array
    doubt: Array

    def take(self, which: np.ndarray) -> Shapes:
        """Return some of the cells."""
        return Shapes(self.probabilities[which], self.centers[:, which], self.spans[:, :, which], self.divisor,
                      self.symmetric, self.rounding, self.doubt[which])

    @property
    def reach(self) -> Array:
        """Bounds (n, c) on |x| over each cell."""
        return np.abs(self.centers) + np.abs(self.spans).sum(axis=1)

    def moment(self) -> Array:
        """Return sum_i p_i E[x x' | cell i], (n, n).

        >>> none = np.zeros(1)
        >>> Shapes(np.ones(1), np.ones((1, 1)), np.full((1, 1, 1), 3.0), 3, True, none, none).moment().tolist()
        [[4.0]]
        """
        p, n = self.probabilities, len(self.centers)
        spread = (self.spans * p).reshape(n, -1) @ self.spans.reshape(n, -1).T
        return (self.centers * p) @ self.centers.T + spread / self.divisor

    def ends(self, mean: Array, slopes: Array) -> tuple[Array, int]:
        """Return points (..., e, c) and a divisor d: E f >= sum of f(points) / d over each cell, for f(g) concave and
        positively homogeneous, g the affine function with these values.

        A concave function lies above its chord: on a box that between the least and the greatest g, at the same distance
        from the mean; on a simplex above the affine function with the same values at the k vertices, which weigh alike and
        where k g = k mean + k slopes_j - sum of slopes. Exact where f is linear on the cell. No division: integers will do.

        Parameters
        ----------
        mean : (..., c) g at the centers
        slopes : (..., q, c) g along the spans
        """
        if self.symmetric:
            room = np.abs(slopes).sum(axis=-2)
            return np.stack([mean - room, mean + room], axis=-2), 2
        k = max(slopes.shape[-2], 1)
        if k == 1:
            return mean[..., None, :], 1
        return k * (mean[..., None, :] + slopes) - slopes.sum(axis=-2)[..., None, :], k**2

    def corners(self, mean: Array, slopes: Array) -> tuple[Array, int]:
        """Return what `ends` does, for f concave in several affine functions at once.

        On a box a concave function lies above its chords along each axis in turn, so above the average of 2^q corners.
        Where these are too many: center + s is the average of center + q s_j for s = s_1 + ... + s_q, s_j on the axes, so
        the average over the 2 q points center +- q span_j is below as well.
        """
        q = slopes.shape[-2]
        if not self.symmetric:
            return self.ends(mean, slopes)
        if q > MOST_CORNERS:
            return mean[..., None, :] + q * np.concatenate([slopes, -slopes], axis=-2), 2 * q
        signs = 1 - 2 * (np.arange(2**q)[:, None] >> np.arange(q) & 1)
        return mean[..., None, :] + signs @ slopes, 2**q

    def depth(self, slopes: Array) -> Array:
        """Return how far (..., c) affine functions with these slopes (..., q, c) fall below their mean on each cell.

        >>> none = np.zeros(1)
        >>> Shapes(np.ones(1), none[None], np.ones((1, 1, 1)), 3, True, none, none).depth(np.array([[-2.0]])).tolist()
        [2.0]
        """
        return np.abs(slopes).sum(axis=-2) if self.symmetric else np.max(-slopes, axis=-2, initial=0.0)

    @property
    def ways(self) -> Array:
        """The lines (n, w, c) along which a cell may be halved: of a box its spans, both ways, of a simplex its edges."""
        return self._along_ways(self.spans)

    def changes(self, slopes: Array) -> Array:
        """Return by how much (..., w, c) affine functions with slopes (..., q, c) along the spans change on each way."""
        return np.abs(self._along_ways(slopes))

    def _along_ways(self, spans: Array) -> Array:
        if self.symmetric:
            return 2 * spans
        first, second = np.triu_indices(spans.shape[-2], 1)
        return spans[..., first, :] - spans[..., second, :]
