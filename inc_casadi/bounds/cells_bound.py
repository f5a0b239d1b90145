"""Lower bounds on expected costs that are put together from those of cells of initial states."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..spec import Spec
from .bound import Bound
from .cell_bounds import Trials, cell_bounds
from .cells import Cells
from .exact_cells import exact_bounds
from .exact_moments import is_semidefinite
from .exact_steps import unproved_steps
from .moves import UNIT
from .price import Price
from .shapes import Shapes
from .value_iteration import value_iteration, weighed

_EXACT_BATCH = 500  # cells at a time


@dataclass(frozen=True, eq=False)
class CellsBound(Bound):
    """A bound with the cells and the trial inputs that prove it.

    Parameters
    ----------
    steps : of value iteration from zero, the horizon T of the trial inputs included
    cells : partition of the initial distribution
    trials : one group for each horizon
    """

    steps: int
    cells: Cells = field(repr=False)
    trials: tuple[Trials, ...] = field(repr=False)

    def dual(self) -> tuple[float, float]:
        """Return the value proved by the stored trial inputs, and the rounding allowance."""
        P, _ = value_iteration(self.plant, self.spec, self.steps)
        values = np.full(self.cells.probabilities.size, -np.inf)
        for group in self.trials:
            shapes, tail = self.cells.shapes.take(group.members), P[self.steps - len(group.u)]
            values[group.members] = cell_bounds(self.plant, self.spec, tail, shapes, group, self._price(group.members))
        return expected(self.spec, P[self.steps], self.cells, values, self.priced)

    @property
    @abstractmethod
    def priced(self) -> bool:
        """Whether the inputs have a price besides, which cancels out over all cells together."""

    @abstractmethod
    def _price(self, which: np.ndarray, exactly: bool = False) -> Price | None:
        """Return what the first inputs cost besides on cells of the partition, in floats or exactly."""

    def holds(self) -> bool:
        """Return whether the stored numbers prove the value: NumPy only, no solver.

        The cells must be a partition of the initial distribution, and each group of trial inputs must be about some.
        """
        return self._fits() and super().holds()

    def _fits(self) -> bool:
        if not self.cells.divide(self.spec.initial):
            return False
        n, m, cells = self.plant.n, self.plant.m, self.cells.probabilities.size
        return all(group.fits(n, m, cells) and len(group.u) <= self.steps for group in self.trials)

    def exact_value(self) -> Fraction | str:
        """Return the value in exact rational arithmetic, or in words why there is none.

        Value iteration is settled step by step (`unproved_steps`), the cells are taken in Fractions from the stored
        parameters of the distribution, of a polytope from its stored triangulation, and `exact_bounds` does the rest.
        """
        if not self._fits():
            return "the cells are no partition of the initial distribution, or the trial inputs are not about them"
        cells = self.cells.exact()
        if isinstance(cells, str):
            return cells
        P, _ = value_iteration(self.plant, self.spec, self.steps)
        trouble = unproved_steps(self.plant, self.spec, P)
        if trouble:
            return trouble
        without = smooth(cells, exact(P[self.steps]))
        values = without.copy()
        for group in self.trials:
            found = self._exactly(P[self.steps - len(group.u)], cells, group)
            if isinstance(found, str):
                return found
            values[group.members] = found if self.priced else np.maximum(found, without[group.members])
        total: Any = np.sum(cells.probabilities * values)
        return Fraction(total)

    def _exactly(self, tail: Array, cells: Shapes, group: Trials) -> np.ndarray | str:
        # The bounds of the cells of a group in Fractions; tail (n, n) weighs the last state.
        if not is_semidefinite(exact(tail)):
            return "the weight of the last state has a negative eigenvalue, if only by rounding"
        values = np.empty(group.members.size, dtype=object)
        for rows in np.array_split(np.arange(values.size), -(-values.size // _EXACT_BATCH) or 1):
            part = group.take(rows)
            which = part.members
            found = exact_bounds(self.plant, self.spec, tail, self.cells.shapes.take(which), cells.take(which), part,
                                 self._price(which, exactly=True))
            if isinstance(found, str):
                return found
            values[rows] = found
        return values


def expected(spec: Spec, Pi: Array, cells: Cells, values: Array, priced: bool = False) -> tuple[float, float]:
    """Return the bound from those of the cells (c,), and its rounding allowance; Pi (n, n) is a bound without limits.

    A cell whose own bound is less, or -inf, counts with Pi, and so does what is unknown of the covariance inside the cells:
    no controller costs less from x than x'Pi x. With a price on the inputs, which cancels out only over all cells
    together, that is not a bound on a cell.

    >>> from inc_casadi import Box, Uniform
    >>> from inc_casadi.bounds.partition import partition
    >>> expected(Spec(1.0, 0.0, 1.0, Box(-1, 1)), np.eye(1), partition(Uniform(Box(-1, 1)), 2), np.array([2.0, -np.inf]))[0]
    1.1666666666666667
    """
    shapes, c = cells.shapes, cells.centroids
    without = smooth(shapes, Pi)
    known = values if priced else np.maximum(values, without)
    sizes = np.abs(known) + smooth(replace(shapes, centers=np.abs(c), spans=np.abs(shapes.spans)), np.abs(Pi))
    allowance = float(np.sum((4 * UNIT * (len(Pi) + 32) + shapes.doubt) * shapes.probabilities * sizes))
    if cells.complete:
        return float(np.sum(shapes.probabilities * known)), allowance
    mean, more = weighed(Pi, spec.initial)
    return mean + float(np.sum(shapes.probabilities * (known - without))), allowance + more


def smooth(shapes: Shapes, Pi: Array) -> Array:
    """Return E[x'Pi x] given each cell, (c,), in floats or Fractions.

    >>> from inc_casadi import Box, Uniform
    >>> from inc_casadi.bounds.partition import partition
    >>> smooth(partition(Uniform(Box(-1, 1)), 1).shapes, np.eye(1)).round(6).tolist()
    [0.333333]
    """
    at = np.sum(shapes.centers * (Pi @ shapes.centers), axis=0)
    n, q, c = shapes.spans.shape
    spans = shapes.spans.reshape(n, -1)
    return np.asarray(at + np.sum(spans * (Pi @ spans), axis=0).reshape(q, c).sum(axis=0) / shapes.divisor)
