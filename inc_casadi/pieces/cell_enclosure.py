"""The errors of a whole walk over polytopes, followed cell by cell, and what they do to its verdicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..claims.regional import Regional
from .cell_errors import GUARD, next_errors, slopes_of
from .cell_steps import OUTWARD, Passage, Passages
from .cutting import Deadline
from .enclosure import Step
from .fixed import PLACES, RESOLUTION
from .laws import PiecewiseLoop
from .places import Places, floats, placed, times
from .terminal import TerminalSet

GROWN = 1e30  # a bound on an error beyond this says nothing more
LEAST_ROOM = 2.0**-42  # the terminal level is lowered by a share 2^-40, so every arrived state keeps this much of its root
MOST_SLOPES = 16_000_000  # slopes of all laws are worked out once when they are no more than so many


@dataclass(frozen=True, eq=False)
class CellEnclosure:
    """Bounds on the difference between a rounded walk over N cells and the true motions from the same starting points.

    state (k + 1, n), inputs (k, m): of states at the start of each step and of inputs, the largest over the cells; final
    (N, n): of each cell's state where it arrives; room (N,): the share of the root of the terminal level that is surely
    left there; spare: the smallest h - H u that is left after the error of u; cost: what all this can change in the
    expected cost and in the discounted cost from any starting point; rounding: what one value h - H u or e'P e is off by.
    """

    state: Array
    inputs: Array
    final: Array
    room: Array
    spare: float
    cost: float
    rounding: float

    def keeps_limits(self, claim: Regional, steps: Sequence[Step] = ()) -> bool:
        """Whether every h - H u found leaves room for the error of u; steps: not needed, the same verdict of all walks."""
        return claim.inputs is None or self.spare >= GUARD * self.rounding

    def arrives(self, terminal: TerminalSet) -> bool:
        """Whether every state that arrived within the lowered terminal level is within the level whatever the error.

        The root of e'P e changes by at most sqrt(E'|P|E), and a cell is left the share `room` of the level's root.
        """
        size = np.einsum("ki,ij,kj->k", self.final, np.abs(terminal.P.astype(float)), self.final) + self.rounding
        return bool(np.all(GUARD * size <= self.room**2 * float(terminal.level)))


@dataclass(frozen=True)
class Magnitudes:
    """The largest magnitudes, at least 1 each, of vertices V, maps F, laws G, and of the entries of B, of the limits' H,
    of the weights C and of P, in n states and m inputs: what rounding is relative to."""

    n: int
    m: int
    V: float
    F: float
    G: float
    B: float
    H: float
    C: float
    P: float

    def formula(self, X: float) -> float:
        """Return what rounding does to z, u or the next state where states are at most X >= 1.

        The laws and the matrices A + B Gx are off by at most 2 + m B + m G roundings, and x -> F x0 + f is rounded once in
        each step, so a step is off by (2 + m B + m G)(n X + 1) + n V + 2 roundings; z and u by n X + 2, and where they are
        taken as planes in x0 by n V + 2 more.
        """
        return 8 * RESOLUTION * (self.n + self.m + 2) * (2 + self.m * self.B) * (X + self.V + self.G) * self.G

    def verdict(self, X: float) -> float:
        """Return what h - H u or e'P e is off by: m H or 2 n^2 P X times a formula, and as many roundings of its own."""
        return 8 * (self.n + self.m) ** 2 * self.H * self.P * X * self.formula(X)

    def costs(self, X: float, steps: int) -> float:
        """Return what a cost form is off by at the vertices after so many steps.

        It comes from products of two maps with a form of entries C, each off by a rounding of the map, in each step.
        """
        stage = 64 * RESOLUTION * (self.n + self.m + 1) ** 4 * self.G**2 * self.C * (self.F + X) ** 2 * self.V**2
        return stage * (steps + 2) ** 2


def magnitudes(loop: PiecewiseLoop, claim: Regional, terminal: TerminalSet, passages: Passages) -> Magnitudes:
    """Return the magnitudes of a walk."""
    laws, moved, plant = passages.laws, passages.moved, loop.plant
    limits = () if claim.inputs is None else (claim.inputs.H, claim.inputs.h)
    return Magnitudes(plant.n, plant.m, largest(floats(passages.points)), largest(floats(moved.F), floats(moved.f)),
                      largest(floats(laws.Gx), floats(laws.g), floats(laws.Zx), floats(laws.z0)), largest(plant.B),
                      largest(*limits), largest(claim.Q, claim.R, terminal.tail), largest(terminal.P, terminal.x))


def largest(*arrays: Array) -> float:
    """Return the largest magnitude in all arrays, at least 1.

    >>> largest(np.array([0.5, -3.0]), np.zeros((0, 2)))
    3.0
    """
    return max([1.0] + [float(np.max(np.abs(np.asarray(array).astype(float)), initial=1.0)) for array in arrays])


def enclose_cells(loop: PiecewiseLoop, claim: Regional, terminal: TerminalSet, passages: Passages, start: float,
                  deadline: Deadline) -> tuple[CellEnclosure, tuple[Step, ...], bool] | str:
    """Return the errors of a walk's cells, what its steps did, and whether all vertices arrive; or why that is not known.

    start: how far starting points can be off already. A step changes the errors by `cell_errors.next_errors`. With E the
    error of a state, x'Q x changes by at most 2 |x|'|Q| E + E'|Q| E, and so for inputs; a cell's costs are summed along its
    way. The mean over the starting points changes by no more than the largest of these.
    """
    size, N = magnitudes(loop, claim, terminal, passages), len(passages.walk.arrived)
    E, cost = np.full((N, loop.plant.n), start + size.formula(size.V)), np.zeros(N)
    states, inputs, steps, spare = [E.max(axis=0)], [], [], np.inf
    answer = _answers(loop, passages)
    for k in range(passages.steps):
        parts = []
        for cells in passages.blocks(k):
            late = deadline.passed(0)
            if late:
                return late
            passage, before = passages.passage(k, cells), E[cells]
            E[cells], error = answer(passage, before, size.formula(largest(passage.x)))
            if not np.all(E[cells] < GROWN):
                return "rounding errors grow too large"
            cost[cells] += GUARD * (_change(claim.Q, passage.x, before) + _change(claim.R, passage.u, error))
            spare = min(spare, _spare(claim, passage, error))
            parts.append((_told(passage), error.max(axis=0), E[cells].max(axis=0)))
        told, wrong, after = zip(*parts, strict=True)
        steps.append(_joined(told))
        inputs.append(np.max(wrong, axis=0))
        states.append(np.max(after, axis=0))
    arrived, room, last = _arrival(terminal, passages)
    X = largest(last, *(step.x for step in steps))
    lifted = np.column_stack([GUARD * (last + np.abs(terminal.x.astype(float))), np.ones(N)])
    tail = _change(terminal.tail.astype(float), lifted, np.column_stack([E + size.formula(X), np.zeros(N)]))
    total = GUARD * (float(np.max(cost + GUARD * tail)) + GUARD * size.costs(X, len(steps)))
    off = np.array(inputs).reshape(len(steps), loop.plant.m)
    return CellEnclosure(np.array(states), off, E, room, spare, total, size.verdict(X)), tuple(steps), arrived


def _answers(loop: PiecewiseLoop, passages: Passages) -> Callable[[Passage, Array, float], tuple[Array, Array]]:
    """What turns the errors before a step into those after it: slopes of all laws are worked out first if they are few."""
    test, laws, patterns = loop.inc.well_posedness(), passages.laws, passages.walk.trails.patterns
    every = slopes_of(loop, laws, patterns) if laws.z0.size * loop.inc.q <= MOST_SLOPES else None

    def answer(passage: Passage, E: Array, r: float) -> tuple[Array, Array]:
        if every is not None:
            return next_errors(loop, test, every, passage.law, E, passage.beyond, r)
        distinct, which = np.unique(passage.law, return_inverse=True)
        return next_errors(loop, test, slopes_of(loop, laws, patterns, distinct), which.reshape(-1), E, passage.beyond, r)

    return answer


def _spare(claim: Regional, passage: Passage, error: Array) -> float:
    """The smallest h - H u that is left at the vertices of a block of cells after the error of u."""
    if claim.inputs is None:
        return np.inf
    return float(np.min(passage.slack - GUARD * (error @ np.abs(claim.inputs.H).T).max(axis=1)))


def _change(weight: Array, size: Array, error: Array) -> Array:
    return np.einsum("ki,ij,kj->k", 2 * size + error, np.abs(weight), error)


def _told(passage: Passage) -> Step:
    """A block of cells as an error bound over all of them would need it."""
    beyond = float(np.max(passage.beyond, initial=0.0))
    return Step(0, beyond, passage.x.max(axis=0), passage.u.max(axis=0), float(passage.slack.min()), 1.0, len(passage.cells))


def _joined(parts: Sequence[Step]) -> Step:
    x, u = (np.max([getattr(part, name) for part in parts], axis=0) for name in ("x", "u"))
    return Step(0, max(part.beyond for part in parts), x, u, min(part.slack for part in parts), 1.0,
                sum(part.pieces for part in parts))


def _arrival(terminal: TerminalSet, passages: Passages) -> tuple[bool, Array, Array]:
    """Whether every vertex arrives, the share of the level's root left to each cell (N,), the magnitudes (N, n) there.

    With s >= e'P e / level at all vertices of a cell, by convexity at all points, 1 - sqrt(s) >= (1 - s) / 2 is left.
    """
    walk, level = passages.walk, float(terminal.level)
    vertex, cell, x, reach, first = passages.ends(np.arange(len(walk.arrived)))
    center, P = terminal.x.astype(float), terminal.P.astype(float)
    e, terms = x - center, reach + np.abs(center)
    share = (np.einsum("ki,ij,kj->k", e, P, e) + OUTWARD * np.einsum("ki,ij,kj->k", terms, np.abs(P), terms)) / level
    near = np.flatnonzero(share > 1 - OUTWARD)
    room = np.maximum((1 - OUTWARD - np.maximum.reduceat(share, first)) / 2, LEAST_ROOM)
    arrived = bool(np.all(_sizes(terminal, passages, vertex[near], walk.node[cell[near]]) <= placed(terminal.level)))
    return arrived, room, np.maximum.reduceat(np.abs(x) + OUTWARD * reach, first, axis=0)


def _sizes(terminal: TerminalSet, passages: Passages, vertex: np.ndarray, node: np.ndarray) -> Places:
    """e'P e with 256 places where vertices arrive."""
    moved = passages.moved
    e = times(moved.F[node], passages.points[vertex][:, :, None])[:, :, 0] + moved.f[node] - placed(terminal.x)
    return (e * times(placed(terminal.P), e[:, :, None])[:, :, 0] >> PLACES).sum(axis=1)
