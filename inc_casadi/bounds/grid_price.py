"""A price on foreseeing: affine on every part of a grid, with the mean zero given what has been measured."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..plant import Plant
from ..sets import Box
from .halved_cells import Boxes
from .information import first_shown
from .moves import UNIT
from .price import Price


@dataclass(frozen=True, eq=False)
class GridPrice:
    """Prices pi_k(x_0)'u_k, k < r, with E[pi_k(x_0) | y_0, ..., y_k] = 0, for x_0 uniform on a box.

    A controller that measures y = C x chooses u_k from y_0, ..., y_k alone, so that E pi_k'u_k = 0 and

        E cost = E [cost + sum_k pi_k(x_0)'u_k],

    while a controller that foresees x_0 has to pay. Whatever the numbers stored, the price has this property, because it is

        pi_k(x) = a_k + S_k (x - center of the part that x is in).

    The coordinates of x_0 are independent. `first_shown` says which of them y_0..y_k do not depend on; given all others,
    which tell y_0..y_k, these are as before, uniform on the box, and inside a part of the grid on the part. So S_k has
    columns for these only, and S_k (x - center) has the mean zero; a_k is the stored offset less its mean over the parts
    along these coordinates.

    Parameters
    ----------
    plant : whose y = C x is measured
    box : of the initial states
    counts : (n,) powers of two, into how many equal parts each axis is cut; G parts in all, the last axis counted first
    offsets : (r, m, G)
    slopes : (r, m, n, G)

    Notes
    -----
    Source: multipliers of nonanticipativity (Rockafellar and Wets, Math. Programming Study 6, 1976); the dual bound of
    Brown, Smith and Sun, Operations Research 58, 2010.
    """

    plant: Plant
    box: Box
    counts: np.ndarray
    offsets: Array
    slopes: Array

    def fits(self, plant: Plant, box: Box) -> bool:
        """Return whether these are numbers for inputs of this plant on a grid of this box."""
        n, m, r = plant.n, plant.m, len(self.offsets)
        counts = np.asarray(self.counts)
        if counts.shape != (n,) or counts.dtype.kind != "i" or np.any(counts < 1) or np.any(counts & (counts - 1)):
            return False
        G = int(np.prod(counts))
        finite = bool(np.all(np.isfinite(self.offsets)) and np.all(np.isfinite(self.slopes)))
        same = all(np.array_equal(one, other) for one, other in ((plant.A, self.plant.A), (plant.C, self.plant.C),
                   (box.lower, self.box.lower), (box.upper, self.box.upper)))
        return same and finite and self.offsets.shape == (r, m, G) and self.slopes.shape == (r, m, n, G)

    @cached_property
    def hidden(self) -> np.ndarray:
        """Whether (r, n) y_0, ..., y_k do not depend on each coordinate."""
        return np.arange(len(self.offsets))[:, None] < first_shown(self.plant)

    def centered(self, offsets: Array) -> Array:
        """Return the a_k (r, m, G) of offsets (r, m, G), in floats or Fractions.

        >>> plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.0], [1.0]], C=[[1.0, 0.0]])
        >>> price = GridPrice(plant, Box([0, 0], [1, 1]), np.array([1, 2]), np.zeros((1, 1, 2)), np.zeros((1, 1, 2, 2)))
        >>> price.centered(np.array([[[1.0, 3.0]]])).tolist()
        [[[-1.0, 1.0]]]
        """
        grid = offsets.reshape(*offsets.shape[:2], *self.counts)
        found = np.empty_like(grid)
        for k, each in enumerate(grid):
            found[k] = each - _mean(each, self.hidden[k])
        return found.reshape(offsets.shape)

    def on(self, cells: Boxes, which: np.ndarray) -> Price:
        """Return the price on the boxes numbered `which`, each of which is inside a part of the grid."""
        part, away = self.parts(cells, which), self._away(cells, which)
        width = self.box.upper - self.box.lower
        slopes = np.where(self.hidden[:, None, :, None], self.slopes[..., part], 0.0)
        at = self.centered(self.offsets)[..., part] + np.einsum("rmnc,nc->rmc", slopes, away * width[:, None])
        most = np.max(np.abs(self.offsets), axis=2, initial=0.0)[:, :, None]
        sizes = 3 * most + np.einsum("rmnc,n->rmc", np.abs(slopes), width)
        return Price(at, slopes, 4 * UNIT * (len(width) + self.offsets.shape[2] + 8) * sizes)

    def exactly(self, cells: Boxes, which: np.ndarray) -> Price:
        """Return the same in Fractions, but for the slopes, which are floats taken as they are."""
        part, away = self.parts(cells, which), self._away(cells, which)
        width = exact(self.box.upper) - exact(self.box.lower)
        slopes = np.where(self.hidden[:, None, :, None], self.slopes[..., part], 0.0)
        shift = np.sum(exact(slopes) * (exact(away) * width[:, None]), axis=2)
        at = self.centered(exact(self.offsets))[..., part] + shift
        return Price(at, slopes, np.zeros(at.shape))

    def divides(self, cells: Boxes) -> bool:
        """Return whether every box of the partition is inside a part of the grid."""
        return bool(np.all(cells.shares[cells.leaves, 1] * self.counts <= 1))

    def parts(self, cells: Boxes, which: np.ndarray) -> np.ndarray:
        """Return the number (c,) of the part that each of these boxes is in."""
        return np.ravel_multi_index(tuple(self._steps(cells, which)), tuple(self.counts))

    def _steps(self, cells: Boxes, which: np.ndarray) -> np.ndarray:
        return np.floor(cells.shares[which, 0] * self.counts).astype(int).T

    def _away(self, cells: Boxes, which: np.ndarray) -> Array:
        # The centers less those of their parts, as shares (n, c) of the box, without rounding.
        low, size = cells.shares[which, 0].T, cells.shares[which, 1].T
        return np.asarray(low + size / 2 - (self._steps(cells, which) + 0.5) / self.counts[:, None])


def _mean(grid: Array, along: np.ndarray) -> Array:
    # The mean of (m, *counts) over some of the axes, repeated along them.
    axes = tuple(1 + np.flatnonzero(along))
    if not axes:
        return grid
    count = int(np.prod([grid.shape[axis] for axis in axes]))
    return np.broadcast_to(grid.sum(axis=axes, keepdims=True) / count, grid.shape)
