"""Exact reachable sets of a piecewise-affine loop, step by step, as unions of polytopes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..brief import Brief
from ..errors import InvalidInputError
from ..inc import INC
from ..loop import close_loop
from ..plant import Plant, as_plant
from ..sets import Box, Polytope, Uniform, rules
from .cells import Cells, whole
from .cutting import Deadline, inputs_at, one_law_each, under_laws
from .laws import PiecewiseLoop
from .walk import Budget


@dataclass(frozen=True, eq=False)
class ReachableSets(Brief):
    """Where the motions from a set are at steps 0, 1, ..., and what their inputs are on the way.

    The set at step k is the union of the images of the cells of `stages[k]`, each the convex hull of its vertices `now`.
    It is exact up to the rounding of floats: nothing is over-approximated, and every vertex is reached.

    inputs (N, 2, m): the smallest and largest u_k; ended: "" or the budget that ran out before all steps were done.
    """

    stages: tuple[Cells, ...]
    inputs: Array
    ended: str
    seconds: float

    @property
    def steps(self) -> int:
        """The last step that is known."""
        return len(self.stages) - 1

    @property
    def pieces(self) -> tuple[int, ...]:
        """The number of polytopes at each step."""
        return tuple(len(stage) for stage in self.stages)

    @property
    def boxes(self) -> Array:
        """The smallest boxes around the sets, (steps + 1, 2, n): lower and upper ends."""
        return np.array([[stage.now.min(axis=0), stage.now.max(axis=0)] for stage in self.stages])

    def box(self, k: int) -> Box:
        """Return the smallest box around the set at step k.

        Raises EmptySetError when it is flat.
        """
        return Box(*self.boxes[self._step(k)])

    def polytopes(self, k: int) -> list[Array]:
        """Return the vertices (N, n) of each polytope of the set at step k; flat images are among them."""
        stage = self.stages[self._step(k)]
        return np.split(stage.now, stage.first[1:])

    def hull(self, k: int) -> Polytope:
        """Return the convex hull of the set at step k.

        Raises EmptySetError when it is flat.
        """
        return Polytope.from_vertices(self.stages[self._step(k)].now.T)

    def origins(self, k: int) -> list[Array]:
        """Return the starting points (N, n) of the same polytopes' vertices: together they fill the initial set."""
        stage = self.stages[self._step(k)]
        return np.split(stage.start, stage.first[1:])

    def support(self, direction: Any, k: int) -> float:
        """Return the largest value of direction'x over the set at step k."""
        return float(np.max(self.stages[self._step(k)].now @ np.asarray(direction, dtype=float)))

    def _step(self, k: int) -> int:
        if not 0 <= k <= self.steps:
            raise InvalidInputError(f"k = {k}, but the sets are known for steps 0 to {self.steps}"
                                    + (f": {self.ended}" if self.ended else ""))
        return k


def reachable(plant: Any, inc: INC, initial: Box | Polytope | Uniform, steps: int, *, budget: Budget | None = None,
              progress: Callable[[int, int], None] | None = None) -> ReachableSets:
    """Return the exact sets of states that the closed loop reaches from `initial` after 0, 1, ..., `steps` steps.

    The initial set is cut into polytopes until the loop is one affine map on each, these move, and so on. For a controller
    whose activations are piecewise affine, W != 0 included, in discrete time.

    progress: called with (step, polytopes). When the budget of pieces or seconds runs out, the sets known by then are
    returned and `ended` says so.

    Raises InvalidInputError when a unit is not piecewise affine or time is continuous, DimensionError when sizes do not
    fit, NotWellPosedError when the fixed point is not proved unique.

    >>> sets = reachable(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0), Box([-1.0], [1.2]), 2)
    >>> sets.boxes.round(12).tolist(), sets.pieces
    ([[[-1.0], [1.2]], [[-0.5], [0.8]], [[0.0], [0.2]]], (1, 3, 4))
    """
    plant = as_plant(plant)
    close_loop(plant, inc)
    region = initial.support if isinstance(initial, Uniform) else initial
    region = _checked(plant, region)
    inc(plant.C @ region.center)  # refuses what is not well posed
    budget = budget or Budget()
    deadline = Deadline(budget.pieces, budget.seconds, time.monotonic())
    loop = PiecewiseLoop(plant, inc.without_idle_units())
    stages, inputs, patterns, size, ended = [whole(region)], [], None, np.zeros(loop.inc.q), ""
    for step in range(rules.whole("steps", steps, 0)):
        cells, patterns, size, u, ended = _advanced(loop, stages[-1], patterns, size, deadline)
        if ended:
            break
        stages.append(cells)
        inputs.append(u)
        if progress:
            progress(step + 1, len(cells))
    return ReachableSets(tuple(stages), np.array(inputs).reshape(-1, 2, plant.m), ended, time.monotonic() - deadline.start)


def _advanced(loop: PiecewiseLoop, cells: Cells, patterns: np.ndarray | None, size: Array,
              deadline: Deadline) -> tuple[Cells, np.ndarray, Array, Array, str]:
    split = one_law_each(loop, cells, patterns, size, deadline)
    if split.ended:
        return cells, split.patterns, size, np.zeros((2, loop.plant.m)), split.ended
    distinct, which = loop.distinct(split.patterns)
    laws = loop.laws(distinct)
    u, after = inputs_at(split.cells, laws, which), under_laws(loop, split.cells, laws, which)
    return after, split.patterns, split.size, np.array([u.min(axis=0), u.max(axis=0)]), ""


def _checked(plant: Plant, region: Any) -> Box | Polytope:
    if not isinstance(region, Box | Polytope):
        raise InvalidInputError(f"initial must be a Box, a Polytope or a Uniform over one, not {region!r}")
    if region.dimension != plant.n:
        raise InvalidInputError(f"initial has dimension {region.dimension}, but the plant has {plant.n} states")
    return region
