"""The exact walk: cut a polytope of starting points until the loop is affine on every simplex, step, repeat."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from ..arrays import Array
from ..claims.regional import Regional
from ..sets import Box
from .laws import Laws, PiecewiseLoop
from .simplices import Simplices, begin, levelled, steepest_crossing_edge
from .terminal import TerminalSet

KINK_TOLERANCE = 1e-12


@dataclass(frozen=True)
class Budget:
    """How far a walk may go: simplices alive at once, steps, seconds."""

    pieces: int = 200_000
    steps: int = 2_000
    seconds: float = 60.0


@dataclass(frozen=True, eq=False)
class Walk:
    """What a walk found.

    done: the simplices that reached the terminal set, their cost forms complete; left: those still under way when
    the budget ended, with the cost so far; arrival (N,): the step at which each done simplex arrived; first (N,): the row
    of `patterns` that was its first law, -1 when it began in the terminal set; slack: the smallest h - H u over all visited inputs, infinite without limits; cuts: how many
    cuts were made; ended: "" when nothing is left, else the budget that ran out.

    With nothing left, `done` covers the initial set, and its cost forms are the discounted cost from every x0.
    """

    done: Simplices
    left: Simplices
    arrival: np.ndarray
    first: np.ndarray
    patterns: np.ndarray
    slack: object
    cuts: int
    ended: str
    seconds: float

    @property
    def complete(self) -> bool:
        """Whether every starting point was followed into the terminal set."""
        return self.ended == ""


def walk(loop: PiecewiseLoop, claim: Regional, terminal: TerminalSet, budget: Budget | None = None,
         progress: Callable[[int, int], None] | None = None) -> Walk:
    """Follow every starting point of the claim's initial set until it lies in the terminal set.

    At each step: simplices within the terminal ellipsoid (all vertices in, so by convexity all points) are done
    and take its tail cost; the others are cut until each carries one pattern (`one_pattern_each`); their inputs are
    compared with the limits at the vertices, which decides for all points since u is affine there; their vertices move.

    In Fractions nothing is rounded. In floats a pre-activation within 1e-12 (relative to the largest one) of a kink
    counts as on it; there the two laws agree to that accuracy.

    progress: called with (step, simplices alive).
    """
    budget = budget or Budget()
    clock = time.monotonic()
    alive = _initial(loop, claim, terminal)
    total = alive.weight.sum()
    done, arrival, first, tags = alive.take(np.zeros(0, int)), [], [], np.full(len(alive), -1)
    firsts = np.zeros((0, loop.inc.q), int)
    slack: object = np.inf
    cuts, ended, scale = 0, "", loop.numbers(np.array(1.0)).item()
    beta = loop.numbers(np.array(claim.discount)).item()
    for step in range(budget.steps + 1):
        inside = terminal.contains(alive.now).all(axis=1)
        done = done.joined(_with_tail(alive.take(inside), terminal, scale))
        arrival.append(np.full(int(inside.sum()), step))
        first.append(tags[inside])
        alive, tags = alive.take(~inside), tags[~inside]
        if progress:
            progress(step, len(alive))
        ended = _exhausted(alive, step, budget, clock)
        if len(alive) == 0 or ended:
            break
        alive, tags, patterns, which, new_cuts = one_pattern_each(loop, alive, tags, budget, clock)
        cuts += new_cuts
        ended = _exhausted(alive, 0, budget, clock)
        if ended:
            break
        if step == 0:
            firsts, tags = patterns, which.copy()
        alive, slack = _moved(loop, claim, alive, loop.laws(patterns), which, scale, slack)
        scale = scale * beta
    _assert_conserved(total, done, alive, loop.rational)
    first_index = np.concatenate(first) if first else np.zeros(0, int)
    return Walk(done, alive, np.concatenate(arrival), first_index, firsts, slack, cuts, ended, time.monotonic() - clock)


def one_pattern_each(loop: PiecewiseLoop, alive: Simplices, tags: np.ndarray, budget: Budget, clock: float,
                     ) -> tuple[Simplices, np.ndarray, np.ndarray, np.ndarray, int]:
    """Cut simplices until the controller is one affine law on each; return them with patterns and which is whose.

    The law of the pattern at a simplex's centroid holds on all of it exactly when its z lies within the piece at
    every vertex. If some vertex lies beyond a bound, another lies strictly within it, because their mean does; the
    simplex is cut where its steepest edge across the hyperplane z = bound of that law meets it. There are finitely many
    such hyperplanes. (In floats a vertex beyond a bound without one strictly within is beyond it by at most n + 1
    tolerances, and counts as on it.)
    """
    ready, ready_tags, ready_patterns, cuts = alive.take(np.zeros(0, int)), [], [], 0
    while len(alive):
        patterns = loop.patterns_at(alive.centroids())
        distinct, which = _distinct(patterns)
        laws = loop.laws(distinct)
        height = _heights(laws, which, alive.now)
        crossed = (height.max(axis=1) > 0) & (height.min(axis=1) < 0)
        crossing = crossed.any(axis=1)
        ready = ready.joined(alive.take(~crossing))
        ready_tags.append(tags[~crossing])
        ready_patterns.append(patterns[~crossing])
        if not crossing.any():
            break
        alive, tags, height, crossed = alive.take(crossing), tags[crossing], height[crossing], crossed[crossing]
        worst = np.where(crossed, height.max(axis=1), 0).argmax(axis=1)
        chosen = np.take_along_axis(height, worst[:, None, None], axis=2)[:, :, 0]
        i, j = steepest_crossing_edge(chosen)
        rows = np.arange(len(alive))
        share = chosen[rows, i] / (chosen[rows, i] - chosen[rows, j])
        cuts += len(alive)
        alive, tags = alive.split(i, j, share), np.concatenate([tags, tags])
        if len(ready) + len(alive) > budget.pieces or time.monotonic() - clock > budget.seconds:
            ready = ready.joined(alive)
            break
    patterns = np.concatenate(ready_patterns) if ready_patterns else np.zeros((0, loop.inc.q), int)
    distinct, which = _distinct(patterns)
    return ready, np.concatenate(ready_tags) if ready_tags else tags, distinct, which, cuts


def _heights(laws: Laws, which: np.ndarray, points: Array) -> Array:
    """How far z is beyond each bound of its piece (N, k, 2q): positive outside, 0 within the tolerance of the kink."""
    q = laws.z0.shape[1]
    z = points @ np.swapaxes(laws.Zx[which], 1, 2) + laws.z0[which][:, None, :]
    below, above = laws.low[which][:, None, :] - z, z - laws.high[which][:, None, :]
    height = np.concatenate([below, above], axis=2)
    if z.dtype == object or q == 0:
        return height
    size = np.max(np.abs(z), axis=(0, 1), initial=1e-300)
    return np.where(np.abs(height) <= KINK_TOLERANCE * np.concatenate([size, size]), 0.0, height)


def _moved(loop: PiecewiseLoop, claim: Regional, alive: Simplices, laws: Laws, which: np.ndarray, scale: object,
           slack: object) -> tuple[Simplices, object]:
    number, x = loop.numbers, alive.now
    u = x @ np.swapaxes(laws.Gx[which], 1, 2) + laws.g[which][:, None, :]
    if claim.inputs is not None:
        room = number(claim.inputs.h) - u @ number(claim.inputs.H).T
        slack = min(slack, room.min())  # type: ignore[type-var]
    stage = x @ number(claim.Q) @ np.swapaxes(x, 1, 2) + u @ number(claim.R) @ np.swapaxes(u, 1, 2)
    after = x @ number(loop.plant.A).T + u @ number(loop.plant.B).T
    return replace(alive, now=after, cost=alive.cost + scale * stage), slack


def _with_tail(inside: Simplices, terminal: TerminalSet, scale: object) -> Simplices:
    return replace(inside, cost=inside.cost + scale * terminal.tail_form(inside.now))


def _initial(loop: PiecewiseLoop, claim: Regional, terminal: TerminalSet) -> Simplices:
    region = claim.initial.support
    vertices = region.simplices()
    if isinstance(region, Box):
        gain = loop.laws(terminal.pattern[None]).Gx[0].astype(float)
        vertices = levelled(vertices, region.lower, region.upper, gain)
    vertices = loop.numbers(vertices)
    volumes = np.array([abs(_determinant(v[1:] - v[0])) for v in vertices], dtype=vertices.dtype)
    return begin(vertices, volumes / volumes.sum())


def _determinant(M: Array) -> object:
    if M.dtype != object:
        return np.linalg.det(M)
    table, value = M.copy(), Fraction(1)
    for k in range(len(M)):
        pivot = next((i for i in range(k, len(M)) if table[i, k] != 0), None)
        if pivot is None:
            return Fraction(0)
        if pivot != k:
            table[[k, pivot]], value = table[[pivot, k]], -value
        value *= table[k, k]
        table[k + 1:] = table[k + 1:] - (table[k + 1:, k] / table[k, k])[:, None] * table[k][None, :]
    return value


def _distinct(patterns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if patterns.shape[1] == 0:
        return patterns[:1], np.zeros(len(patterns), int)
    return np.unique(patterns, axis=0, return_inverse=True)


def _exhausted(alive: Simplices, step: int, budget: Budget, clock: float) -> str:
    if len(alive) == 0:
        return ""
    if len(alive) > budget.pieces:
        return f"more than {budget.pieces} simplices"
    if step >= budget.steps:
        return f"{len(alive)} simplices still under way after {step} steps"
    if time.monotonic() - clock > budget.seconds:
        return f"the time limit of {budget.seconds:g} s"
    return ""


def _assert_conserved(total: object, done: Simplices, left: Simplices, rational: bool) -> None:
    gap = abs(done.weight.sum() + left.weight.sum() - total)
    assert gap == 0 if rational else gap < 1e-9, f"cutting lost or doubled the probability {float(gap):.3g}"
