"""A price on the first inputs, affine in the initial state on every cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from .moves import UNIT
from .shapes import Shapes


@dataclass(frozen=True, eq=False)
class Price:
    """What the first r inputs cost besides on c cells, sum_k pi_k(x)'u_k with pi_k(x) = at_k + slopes_k (x - center).

    Parameters
    ----------
    at : (r, m, c), in floats or Fractions
    slopes : (r, m, n, c), floats
    rounding : (r, m, c) how far `at` may be from what it stands for
    """

    at: Array
    slopes: Array
    rounding: Array

    @classmethod
    def none(cls, m: int, n: int, c: int) -> Price:
        """Return the price of nothing on c cells."""
        return cls(np.zeros((0, m, c)), np.zeros((0, m, n, c)), np.zeros((0, m, c)))

    def take(self, which: np.ndarray) -> Price:
        """Return the price on some of the cells."""
        return Price(self.at[..., which], self.slopes[..., which], self.rounding[..., which])

    def of(self, u: Array) -> Array:
        """Return (c,) what inputs u (T, m, c) cost besides at the centers.

        >>> Price(np.array([[[2.0]]]), np.zeros((1, 1, 1, 1)), np.zeros((1, 1, 1))).of(np.full((3, 1, 1), 4.0)).tolist()
        [8.0]
        """
        return np.asarray(np.sum(self.at * u[:len(self.at)], axis=(0, 1)))

    def onto(self, g: Array, shapes: Shapes, limit: Array) -> Array:
        """Add the price to slopes g (T, m, 1 + q, c) at the centers and along the spans; return (c,) what rounding may cost.

        limit (m,) bounds the inputs.
        """
        r, q = len(self.at), shapes.spans.shape[1]
        g[:r, :, 0] += self.at
        g[:r, :, 1:] += np.einsum("rmnc,nqc->rmqc", self.slopes, shapes.spans)
        unit = 4 * UNIT * (len(shapes.centers) + 4)
        sizes = unit * np.abs(shapes.spans).sum(axis=1) + (1 + q) * shapes.rounding[:, None]
        off = self.rounding + 4 * UNIT * np.abs(self.at) + np.einsum("rmnc,nc->rmc", np.abs(self.slopes), sizes)
        return np.asarray(np.einsum("rmc,m->c", off, limit))
