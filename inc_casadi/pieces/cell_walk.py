"""The exact walk over polytopes: follow every starting point of a region until it lies in the terminal set."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from math import factorial

import numpy as np

from ..arrays import Array
from ..claims.regional import Regional
from ..sets import Box, Polytope, simplex
from .begin import Begin, begin_of
from .cells import Cells, simplices_of
from .cutting import Deadline, inputs_at, one_law_each, under_laws
from .laws import Laws, PiecewiseLoop
from .simplices import Simplices
from .terminal import TerminalSet
from .trails import Trails
from .walk import DIVERGED, Budget

CONSERVED = 1e-9
SPREAD = 1e13  # by how much neighbouring motions may have parted: beyond, rounding of their start is all that is seen
BATCH, HELD = 10_000, 200_000  # cells whose simplices are held at once: so many, and so many simplices if they were cubes
MOST_SIMPLICES = 10_000_000  # beyond which integrals are not worked out
ARRIVED = 1 - 2.0**-30  # a cell counts as arrived with this much room, so that rounding cannot turn it away again
MOST_DIMENSIONS = 8  # up to which cells are cut into simplices: a cube has n! of them


@dataclass(frozen=True, eq=False)
class CellWalk:
    """What a walk over polytopes found.

    arrived: the cells that reached the terminal set, their cost forms complete; alive: those still under way when the
    budget ended, with the cost so far; steps_taken, node (N,): for each arrived cell, the step at which it arrived and its
    place in `trails`, the tree of laws that cells went through; slack: the smallest h - H u over all visited inputs,
    infinite without limits; ended: "" when nothing is left, else the budget that ran out; volume: that of the initial set.

    With nothing left, `arrived` covers the initial set, and its forms are the discounted cost from every x0.
    """

    arrived: Cells
    alive: Cells
    steps_taken: np.ndarray
    node: np.ndarray
    trails: Trails
    slack: float
    ended: str
    seconds: float
    volume: float

    @property
    def complete(self) -> bool:
        """Whether every starting point was followed into the terminal set."""
        return self.ended == ""

    @cached_property
    def followed(self) -> float:
        """The probability of the starting points that arrived; 0 when it is not known."""
        if self.complete:
            return 1.0
        share = self._mean(self.arrived)[0]
        return 0.0 if np.isnan(share) else share

    @cached_property
    def expected(self) -> float:
        """The expected cost over the starting points that arrived; NaN in more than 8 dimensions, or where the pieces have
        more than 10 million simplices.

        The integral is exact on each simplex of a triangulation. That nothing was lost in cutting shows in the volumes,
        which is asserted.
        """
        share, cost = self._mean(self.arrived)
        assert not self.complete or not abs(share - 1) >= CONSERVED, f"the pieces hold the probability {share:.12g}"
        return cost

    @cached_property
    def at_least(self) -> float:
        """A lower bound on the expected cost over all starting points, also when some are still under way.

        Those have paid the cost so far, and no stage cost is negative. NaN in more than 8 dimensions.
        """
        return self._mean(self.arrived)[1] + self._mean(self.alive)[1]

    def _mean(self, cells: Cells) -> tuple[float, float]:
        """The probability of starting in some cells, and the integral of their cost forms over it; NaN where not known."""
        n = cells.start.shape[1]
        if n > MOST_DIMENSIONS:
            return float("nan"), float("nan")
        share, cost, simplices, batch = 0.0, 0.0, 0, max(1, min(BATCH, HELD // factorial(n)))
        for begin in range(0, len(cells), batch):
            part, _ = self._triangulated(cells.take(np.arange(begin, min(begin + batch, len(cells)))))
            share, cost = share + float(part.weight.sum()), cost + float(part.expected_cost())
            simplices += len(part)
            if simplices > MOST_SIMPLICES:
                return float("nan"), float("nan")
        return share, cost

    @property
    def worst(self) -> tuple[float, Array]:
        """The largest cost from any starting point that arrived, and where: it is convex on each cell, so at a vertex."""
        lifted = self.arrived.lifted()
        cost = ((lifted[:, None, :] @ self.arrived.cost[self.arrived.owner])[:, 0] * lifted).sum(axis=1)
        at = int(np.argmax(cost))
        return float(cost[at]), self.arrived.start[at]

    @cached_property
    def done(self) -> Simplices:
        """The arrived cells cut into simplices, with their probability and cost in barycentric coordinates."""
        return self._pulled[0]

    @cached_property
    def left(self) -> Simplices:
        """The cells still under way, likewise."""
        return self._triangulated(self.alive)[0]

    @cached_property
    def _pulled(self) -> tuple[Simplices, np.ndarray]:
        return self._triangulated(self.arrived)

    @property
    def arrival(self) -> np.ndarray:
        """The step at which each simplex of `done` arrived."""
        return self.steps_taken[self._pulled[1]]

    def _triangulated(self, cells: Cells) -> tuple[Simplices, np.ndarray]:
        corners, owner = simplices_of(cells)
        start = cells.start[corners]
        weight = simplex.volumes(start) / self.volume
        lifted = cells.lifted()[corners]
        cost = lifted @ cells.cost[owner] @ np.swapaxes(lifted, 1, 2)
        return Simplices(cells.now[corners], start, weight, cost), owner


def cell_walk(loop: PiecewiseLoop, claim: Regional, terminal: TerminalSet, budget: Budget | None = None,
              progress: Callable[[int, int], None] | None = None, begin: Begin | None = None) -> CellWalk:
    """Follow every starting point, in floats, until it lies in the terminal set.

    At each step: cells within the terminal ellipsoid (all vertices in, so by convexity all points) are done and take its
    tail cost; the others are cut until the controller is one law on each (`one_law_each`); their inputs are compared with
    the limits at the vertices, which decides for all points since u is affine there; their vertices move.

    progress: called with (step, cells alive); begin: where motions begin, by default anywhere in the claim's initial set.
    """
    budget = budget or Budget()
    deadline = Deadline(budget.pieces, budget.seconds, time.monotonic())
    region = claim.initial.support
    assert isinstance(region, Box | Polytope)
    begin = begin_of(region) if begin is None else begin
    alive = begin.cells()
    reach = DIVERGED * float(np.max(np.abs(alive.now)))
    node, trails, patterns = np.zeros(len(alive), int), Trails.begin(loop.inc.q), None
    done, arrival, nodes = [], [], []
    within = replace(terminal, level=terminal.level * ARRIVED)
    size, scale, slack, stored = np.zeros(loop.inc.q), 1.0, np.inf, 0
    for step in range(budget.steps + 1):
        inside = alive.lowest(within.contains(alive.now).astype(int)) == 1
        done.append(_with_tail(alive.take(inside), terminal, scale))
        arrival.append(np.full(int(inside.sum()), step))
        nodes.append(node[inside])
        alive, node = alive.take(~inside), node[~inside]
        patterns = None if patterns is None else patterns[~inside]
        if progress:
            progress(step, len(alive))
        deadline = replace(deadline, done=deadline.done + int(inside.sum()))
        stored += done[-1].size
        ended = _exhausted(alive, step, budget, deadline, reach, stored)
        if len(alive) == 0 or ended:
            break
        split = one_law_each(loop, alive, patterns, size, deadline)
        size, trails = split.size, trails.with_cuts(split.cuts, node)
        alive, patterns, node, ended = split.cells, split.patterns, node[split.parent], split.ended
        if ended:
            break
        trails, node = trails.stepped(node, patterns)
        distinct, which = loop.distinct(patterns)
        alive, room = stepped(loop, claim, alive, loop.laws(distinct), which, scale)
        slack, scale = min(slack, room), scale * claim.discount
    return CellWalk(Cells.joined_all(done, alive.planes), alive, np.concatenate(arrival), np.concatenate(nodes), trails,
                    slack, ended, time.monotonic() - deadline.start, begin.region.volume)


def stepped(loop: PiecewiseLoop, claim: Regional, cells: Cells, laws: Laws, which: np.ndarray,
            scale: float) -> tuple[Cells, float]:
    """Move cells by their laws and charge the stage cost; return also the smallest h - H u at the vertices."""
    slack = np.inf
    if claim.inputs is not None:
        u = inputs_at(cells, laws, which)
        slack = float(np.min(claim.inputs.h - u @ claim.inputs.H.T, initial=np.inf))
    now, input_map = cells.motion, laws.Gx[which] @ cells.motion
    input_map[:, :, -1] += laws.g[which]
    stage = np.swapaxes(now, 1, 2) @ claim.Q @ now + np.swapaxes(input_map, 1, 2) @ claim.R @ input_map
    return replace(under_laws(loop, cells, laws, which), cost=cells.cost + scale * stage), slack


def _with_tail(inside: Cells, terminal: TerminalSet, scale: float) -> Cells:
    N, n, width = inside.motion.shape
    lifted = np.zeros((N, n + 1, width))
    lifted[:, :n], lifted[:, n, -1] = inside.motion, 1.0
    lifted[:, :n, -1] -= terminal.x
    return replace(inside, cost=inside.cost + scale * np.swapaxes(lifted, 1, 2) @ terminal.tail @ lifted)


def _exhausted(alive: Cells, step: int, budget: Budget, deadline: Deadline, reach: float, stored: int) -> str:
    if len(alive) == 0:
        return ""
    if step >= budget.steps:
        return f"{len(alive)} pieces still under way after {step} steps"
    if float(np.max(np.abs(alive.now))) > reach:
        return f"a motion grew to {DIVERGED:g} times the size of the initial set"
    if float(np.max(np.abs(alive.motion[:, :, :-1]))) > SPREAD:
        return "starting points that floats can hardly tell apart part ways"
    return deadline.passed(len(alive), stored + alive.size)
