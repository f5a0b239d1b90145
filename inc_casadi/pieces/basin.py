"""Regions of attraction by exact pieces: which starting points surely converge, grown until the true boundary is near."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, columns
from ..brief import Brief
from ..claims.regional import Regional
from ..errors import InvalidInputError
from ..inc import INC
from ..loop import close_loop
from ..output_range import within_limits
from ..plant import as_plant
from ..sets import Box, Polytope
from . import conewise_search, conewise_tail
from .cells import Cells, volumes, whole
from .conewise import conewise_law
from .core import converges, grow
from .follow import Goal, follow
from .laws import PiecewiseLoop
from .terminal import TerminalSet, find
from .walk import Budget

SAMPLES = 10_000  # simulated motions that the certified share is compared with
SMALLEST = 1e-7  # a cell with less than this share of the region's volume is given up


@dataclass(frozen=True, eq=False)
class Basin(Brief):
    """The part of a region from which every motion is known to converge to the equilibrium, within the input limits.

    cells: polytopes of starting points, all of whose motions reach the `goal`, a terminal ellipsoid around x* and a convex
    core all of whose motions reach the ellipsoid; share: their share of the region's volume; ended: "" when nothing was
    left to follow, else the budget that ran out; the cells found by then are certified all the same.

    Each cell is exact up to the rounding of floats.
    """

    cells: Cells
    region: Box | Polytope
    goal: Goal
    share: float
    simulated: float
    steps: int
    ended: str
    seconds: float

    @property
    def equilibrium(self) -> Array:
        """The equilibrium x* (n,)."""
        return self.goal.terminal.x

    @property
    def volume(self) -> float:
        """The volume of the certified part."""
        return self.share * self.region.volume

    @property
    def fraction(self) -> float:
        """The certified volume relative to what simulation says converges; NaN when no simulated motion does."""
        return self.share / self.simulated if self.simulated else float("nan")

    def polytopes(self) -> list[Array]:
        """Return the vertices (k, n) of each polytope of starting points."""
        return np.split(self.cells.start, self.cells.first[1:])

    def contains(self, x: ArrayLike, tol: float = 0.0) -> bool | np.ndarray:
        """Return whether points, (n,) or columns (n, N), lie in the certified part; tol: allowance in units of x.

        A point lies in a polytope when it is on the right side of all planes of its facets.
        """
        points, single = columns("x", x, self.region.dimension)
        inside = np.zeros(points.shape[1], dtype=bool)
        facets = np.split(self.cells.facets, self.cells.first[1:])
        for listed in facets:  # as many as there are polytopes; each line is one product over all points
            names = np.unique(listed)
            plane, sign = self.cells.planes[names // 2], np.where(names % 2 == 0, 1.0, -1.0)[:, None]
            beyond = sign * (plane[:, :-1] @ points - plane[:, -1:])
            inside |= np.all(beyond <= tol * np.linalg.norm(plane[:, :-1], axis=1)[:, None], axis=0)
        return bool(inside[0]) if single else inside

    def sentence(self) -> str:
        """Say what is certified."""
        rest = np.round(self.equilibrium, 6).tolist()
        return (f"From {100 * self.share:.4g} % of the region, {len(self.cells)} polytopes, every motion converges to x* = "
                f"{rest} within the input limits (in floating point); of {SAMPLES} simulated motions "
                f"{100 * self.simulated:.4g} % do.")



def region_of_attraction(plant: Any, inc: INC, region: Box | Polytope, inputs: Box | Polytope | None = None, *,
                         budget: Budget | None = None, smallest: float = SMALLEST, seed: int = 0,
                         progress: Callable[[int, int, float], None] | None = None) -> Basin:
    """Return the part of a region from which all motions converge within input limits, as far as the budget reaches.

    First a convex core is grown (`core.grow`), inside which everything is certified. Then the region's motions are followed
    as for a `Regional` claim, but a cell is done when all of it lies in the core or in the terminal ellipsoid; one that runs
    away, becomes tiny or breaks an input limit is given up, while the others go on. With steps and pieces the certified
    part grows to the true region of attraction.

    budget: half its seconds go to each part; smallest: a cell is given up when it has less than this share of the region's
    volume; seed: of the sampled motions that the core's shape and `simulated` are taken from; progress: called with (step,
    polytopes under way, certified share of the region's volume).

    Raises InvalidInputError when exact pieces do not apply or there is no terminal set, DimensionError, NotWellPosedError.

    >>> from inc_casadi import Plant
    >>> loop = Plant([[1.5]], [[1.0]]), INC.saturated([[-1.0]], 1.0)
    >>> basin = region_of_attraction(*loop, Box([-4.0], [4.0]))
    >>> round(basin.share, 5), basin.contains([[1.9, 2.1]]).tolist()
    (0.5, [True, False])
    """
    loop, terminal = _prepared(plant, inc, region, inputs)
    budget = budget or Budget()
    start = time.monotonic()
    core = grow(loop, region, inputs, terminal, replace(budget, seconds=budget.seconds / 2), seed)
    rest = replace(budget, seconds=budget.seconds - (time.monotonic() - start))
    goal = Goal(terminal, core)
    found = follow(loop, whole(region), inputs, goal, rest, smallest * region.volume, progress)
    certified = float(volumes(found.done).sum())
    points = region.sample(SAMPLES, np.random.default_rng(seed))
    simulated = float(converges(loop, points, inputs, terminal).mean())
    return Basin(found.done, region, goal, certified / region.volume, simulated, found.steps, found.ended,
                 time.monotonic() - start)


def _prepared(plant: Any, inc: INC, region: Box | Polytope,
              inputs: Box | Polytope | None) -> tuple[PiecewiseLoop, TerminalSet]:
    plant = as_plant(plant)
    close_loop(plant, inc)
    claim = Regional(region, inputs, np.zeros((plant.n, plant.n)), np.zeros((plant.m, plant.m)))
    claim.check(plant)
    inc(plant.C @ region.center)  # refuses what is not well posed
    loop = PiecewiseLoop(plant, inc.without_idle_units())
    terminal, why = find(loop, claim)
    if terminal is None:
        terminal = _on_kinks(loop, claim)
    if terminal is None:
        raise InvalidInputError(f"no region of attraction can be certified: {why}")
    return loop, terminal


def _on_kinks(loop: PiecewiseLoop, claim: Regional) -> TerminalSet | None:
    """The terminal set of a loop whose equilibrium rests on kinks, or None."""
    built_in = claim.inputs is None or within_limits(loop.inc, claim.inputs)
    found, local = conewise_search.find(loop, claim, built_in), conewise_law(loop.plant, loop.inc)
    if isinstance(found, str) or isinstance(local, str):
        return None
    return conewise_tail.terminal_set(loop, claim, local, *found)
