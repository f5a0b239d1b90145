"""Follow cells until they reach a goal, giving up those that run away, shrink to nothing or break an input limit."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from ..sets import Box, Polytope
from .cells import Cells, cut, in_start, volumes
from .cutting import TOLERANCE, Deadline, one_law_each, under_laws
from .laws import Laws, PiecewiseLoop
from .terminal import TerminalSet
from .walk import Budget

STALE = 100  # steps without a new arrival after which the rest is taken to be hopeless
LOST = 1e3  # a cell whose points are all this many times the initial size away is given up


@dataclass(frozen=True, eq=False)
class Goal:
    """Two convex sets from which every motion is known to converge: a terminal ellipsoid, and a core or None."""

    terminal: TerminalSet
    core: Polytope | None = None

    def holds(self, cells: Cells) -> np.ndarray:
        """Which cells (N,) lie in one of the two sets now: all vertices do, and the sets are convex."""
        inside = cells.lowest(self.terminal.contains(cells.now).astype(int)) == 1
        if self.core is not None and len(cells):
            inside |= cells.lowest(np.asarray(self.core.contains(cells.now.T)).astype(int)) == 1
        return inside


@dataclass(frozen=True, eq=False)
class Followed:
    """Cells that reached the goal, and the vertices (k, n) of starting points that were given up or are still under way.

    ended: "" or the budget that ran out.
    """

    done: Cells
    failed: Array
    steps: int
    ended: str


def follow(loop: PiecewiseLoop, cells: Cells, inputs: Box | Polytope | None, goal: Goal, budget: Budget, smallest: float,
           progress: Callable[[int, int, float], None] | None = None, patient: bool = True) -> Followed:
    """Follow cells into a goal, as far as the budget reaches.

    A cell is given up when its volume is below `smallest`, when all its points are 1000 times the initial size away, and
    where it breaks an input limit, where it is cut off. patient: whether to go on after something was given up; if not,
    `failed` holds what was given up first.
    """
    deadline = Deadline(budget.pieces, budget.seconds, time.monotonic())
    alive, patterns, size = cells, None, np.zeros(loop.inc.q)
    reach, total = LOST * float(np.max(np.abs(cells.start))), float(volumes(cells).sum())
    done: list[Cells] = []
    certified, failed, ended, step, last = 0.0, [cells.start[:0]], "", 0, 0
    for step in range(budget.steps + 1):
        inside = goal.holds(alive)
        done.append(alive.take(inside))
        certified += float(volumes(done[-1]).sum())
        last = step if len(done[-1]) else last
        size_of = volumes(alive)
        lost = ~inside & ((size_of <= smallest) | (alive.lowest(np.abs(alive.now).max(axis=1)) > reach))
        failed.append(alive.start[lost[alive.owner]])
        keep = ~inside & ~lost
        alive, patterns = alive.take(keep), None if patterns is None else patterns[keep]
        if progress:
            progress(step, len(alive), certified / total)
        if not len(alive) or (lost.any() and not patient):
            alive = alive.take(np.zeros(0, int))
            break
        deadline = replace(deadline, done=deadline.done + len(done[-1]))
        ended = deadline.passed(len(alive), alive.size) or (f"{step} steps" if step in (budget.steps, last + STALE) else "")
        if ended:
            break
        split = one_law_each(loop, alive, patterns, size, deadline)
        alive, patterns, size, ended = split.cells, split.patterns, split.size, split.ended
        if ended:
            break
        before = alive.start
        alive, patterns = _one_step(loop, alive, patterns, inputs)
        if inputs is not None and len(alive.start) < len(before) and not patient:
            failed.append(before)
    return Followed(Cells.joined_all(done, alive.planes), np.concatenate([*failed, alive.start]), step, ended)


def _one_step(loop: PiecewiseLoop, cells: Cells, patterns: np.ndarray,
              inputs: Box | Polytope | None) -> tuple[Cells, np.ndarray]:
    """Cut off what breaks an input limit, and move the rest."""
    distinct, which = loop.distinct(patterns)
    laws = loop.laws(distinct)
    if inputs is not None:
        cells, which, patterns = _within_limits(inputs, cells, laws, which, patterns)
    return under_laws(loop, cells, laws, which), patterns


def _within_limits(inputs: Box | Polytope, cells: Cells, laws: Laws, which: np.ndarray,
                   patterns: np.ndarray) -> tuple[Cells, np.ndarray, np.ndarray]:
    for row, limit in zip(inputs.H, inputs.h, strict=True):
        tolerance = TOLERANCE * max(1.0, abs(float(limit)))
        gradient, offset = row @ laws.Gx[which], laws.g[which] @ row - limit
        height = (gradient[cells.owner] * cells.now).sum(axis=1) + offset[cells.owner]
        top, bottom = cells.highest(height), cells.lowest(height)
        crossed = (top > tolerance) & (bottom < -tolerance)
        kept = top <= tolerance
        parts, table = [(cells.take(kept), which[kept], patterns[kept])], cells.planes
        if crossed.any():
            lower = _lower_halves(cells, crossed, height, gradient, offset, tolerance)
            parts, table = [*parts, (lower, which[crossed], patterns[crossed])], lower.planes
        cells = Cells.joined_all([part for part, _, _ in parts], table)
        which, patterns = (np.concatenate([part[i] for part in parts]) for i in (1, 2))
    return cells, which, patterns


def _lower_halves(cells: Cells, crossed: np.ndarray, height: Array, gradient: Array, offset: Array,
                  tolerance: float) -> Cells:
    rows = cells.take(crossed)
    planes = in_start(rows, gradient[crossed], offset[crossed])
    halves, _, _ = cut(rows, height[crossed[cells.owner]], planes, np.full(len(rows), tolerance))
    return halves.take(np.arange(len(halves)) < len(rows))
