"""The exact walk: cut a polytope of starting points until the loop is affine on every simplex, step, repeat."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..brief import Brief
from ..claims.regional import Regional
from ..sets import Box, Polytope
from .enclosure import Step
from .laws import Laws, PiecewiseLoop, heights
from .linear import determinant
from .simplices import Simplices, begin, cut_along, levelled, pieces_of_cuts
from .terminal import TerminalSet

DIVERGED = 1e6


@dataclass(frozen=True)
class Budget:
    """How far a walk may go: pieces in all, arrived or under way, steps, seconds."""

    pieces: int = 200_000
    steps: int = 2_000
    seconds: float = 60.0


@dataclass(frozen=True, eq=False)
class Walk(Brief):
    """What a walk found.

    done: the simplices that reached the terminal set, their cost forms complete; left: those still under way when
    the budget ended, with the cost so far; arrival (N,): the step at which each done simplex arrived; first (N,): the row
    of `patterns` that was its first law, -1 when it began in the terminal set; slack: the smallest h - H u over all
    visited inputs, infinite without limits; cuts: how many cuts were made; ended: "" when nothing is left, else the
    budget that ran out; steps: what an error bound needs to know of each step.

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
    steps: tuple[Step, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether every starting point was followed into the terminal set."""
        return self.ended == ""

    @property
    def followed(self) -> float:
        """The probability of the starting points that arrived."""
        return float(self.done.weight.sum())


def walk(loop: PiecewiseLoop, claim: Regional, terminal: TerminalSet, budget: Budget | None = None,
         progress: Callable[[int, int], None] | None = None) -> Walk:
    """Follow every starting point of the claim's initial set until it lies in the terminal set.

    At each step: simplices within the terminal ellipsoid (all vertices in, so by convexity all points) are done
    and take its tail cost; the others are cut until each carries one pattern (`one_pattern_each`); their inputs are
    compared with the limits at the vertices, which decides for all points since u is affine there; their vertices move.

    In Fractions nothing is rounded; with 256 binary places `enclosure` bounds what rounding does. In floats a
    pre-activation within 1e-12 (relative to the largest terms met so far) of a kink counts as on it; there the two
    laws agree to that accuracy.

    progress: called with (step, simplices alive).
    """
    budget = budget or Budget()
    clock = time.monotonic()
    alive = _initial(loop, claim, terminal)
    total, reach = alive.weight.sum(), DIVERGED * float(np.max(np.abs(alive.now)))
    tags, firsts, patterns = np.full(len(alive), -1), np.zeros((0, loop.inc.q), int), None
    done, arrival, first = [alive.take(np.zeros(0, int))], [], []
    steps: list[Step] = []
    cuts, ended, size = 0, "", np.zeros(loop.inc.q)
    scale, beta = loop.numbers(np.array([1.0, claim.discount]))
    for step in range(budget.steps + 1):
        inside = np.all(terminal.contains(alive.now), axis=1)
        done.append(_with_tail(alive.take(inside), terminal, scale))
        arrival.append(np.full(int(inside.sum()), step))
        first.append(tags[inside])
        alive, tags = alive.take(~inside), tags[~inside]
        patterns = None if patterns is None else patterns[~inside]
        if progress:
            progress(step, len(alive))
        finished = sum(len(part) for part in done)
        ended = _exhausted(alive, step, budget, clock, reach, finished)
        if len(alive) == 0 or ended:
            break
        patterns = loop.patterns_at(alive.centroids(), patterns)
        size = np.maximum(size, _size(loop, patterns, alive.now))
        alive, tags, patterns, cutting = one_pattern_each(loop, alive, tags, patterns, size, budget, clock,
                                                          finished)
        cuts += cutting.cuts
        ended = cutting.ended
        if ended:
            break
        distinct, which = loop.distinct(patterns)
        if step == 0:
            firsts, tags = distinct, which
        alive, moved = _moved(loop, claim, alive, loop.laws(distinct), which, scale, cutting)
        steps.append(moved)
        scale = scale * beta
    arrived = done[0].joined(*done[1:])
    _assert_conserved(total, arrived, alive, loop.arithmetic == "exact")
    slack = min((step.slack for step in steps), default=np.inf)
    return Walk(arrived, alive, np.concatenate(arrival), np.concatenate(first), firsts, slack, cuts, ended,
                time.monotonic() - clock, tuple(steps))


@dataclass(frozen=True)
class Cutting:
    """How one step's cutting went: cuts made, the depth of the deepest, how far whole simplices leave their piece, and ""
    or the budget that ended it."""

    cuts: int
    depth: int
    beyond: float
    ended: str = ""


def one_pattern_each(loop: PiecewiseLoop, alive: Simplices, tags: np.ndarray, patterns: np.ndarray, size: Array,
                     budget: Budget, clock: float, finished: int = 0) -> tuple[Simplices, np.ndarray, np.ndarray, Cutting]:
    """Cut simplices until the controller is one affine law on each; return them with tags, patterns and the cutting.

    The law of the pattern at a simplex's centroid holds on all of it exactly when its z lies within the piece at
    every vertex. If some vertex lies beyond a bound, another lies strictly within it, because their mean does; the
    simplex is cut along the hyperplane z = bound of that law, the one that is crossed the farthest. No piece of it crosses
    that hyperplane again and there are finitely many, so this ends. (In floats a vertex beyond a bound without one
    strictly within is beyond it by at most n + 1 tolerances, and counts as on it.)

    patterns (N, q): those at the centroids; size (q,): what the tolerance of the kinks is relative to;
    finished: pieces elsewhere that the budget counts too. It is looked at before a cut, so it is never exceeded.
    """
    ready, cuts, depth, beyond, ended = [], 0, 0, 0.0, ""
    while True:
        distinct, which = loop.distinct(patterns)
        raw = heights(loop.laws(distinct), which, alive.now)
        height = np.where(np.abs(raw) <= _tolerance(loop, size), 0, raw)
        highest = height.max(axis=1)
        crossed = (highest > 0) & (height.min(axis=1) < 0)
        cut = crossed.any(axis=1)
        ready.append((alive.take(~cut), tags[~cut], patterns[~cut]))
        beyond = max(beyond, float(np.max(raw[~cut], initial=0)))
        if not cut.any():
            break
        farthest = np.where(crossed[cut], highest[cut], 0).argmax(axis=1)
        chosen = np.take_along_axis(height[cut], farthest[:, None, None], axis=2)[:, :, 0]
        ended = _no_room(budget, clock, finished + sum(len(part) for part, _, _ in ready) + pieces_of_cuts(chosen))
        if ended:
            ready.append((alive.take(cut), tags[cut], patterns[cut]))
            break
        alive, parent, rounds = cut_along(alive.take(cut), chosen)
        cuts, depth = cuts + len(alive) - len(chosen), depth + rounds
        tags, patterns = tags[cut][parent], patterns[cut][parent]
        patterns = loop.patterns_at(alive.centroids(), patterns)
    parts, all_tags, all_patterns = zip(*ready, strict=True)
    whole = parts[0].joined(*parts[1:])
    return whole, np.concatenate(all_tags), np.concatenate(all_patterns), Cutting(cuts, depth, beyond, ended)


def _size(loop: PiecewiseLoop, patterns: np.ndarray, points: Array) -> Array:
    """The magnitude (q,) of the terms that z is summed from: rounding is relative to it, also where z itself vanishes."""
    if loop.arithmetic != "float":
        return np.zeros(loop.inc.q)
    laws = loop.laws(loop.distinct(patterns)[0])
    return (np.abs(laws.Zx) @ np.abs(points).max(axis=(0, 1)) + np.abs(laws.z0)).max(axis=0)


def _tolerance(loop: PiecewiseLoop, size: Array) -> Any:
    """What height counts as 0, for each bound (2q,): in floats relative to the size of the terms."""
    if loop.arithmetic != "float" or size.size == 0:
        return loop.kink_tolerance
    return loop.kink_tolerance * np.tile(size, 2)


def _moved(loop: PiecewiseLoop, claim: Regional, alive: Simplices, laws: Laws, which: np.ndarray, scale: object,
           cutting: Cutting) -> tuple[Simplices, Step]:
    number, x = loop.numbers, alive.now
    u = x @ np.swapaxes(laws.Gx[which], 1, 2) + laws.g[which][:, None, :]
    slack: Any = np.inf
    if claim.inputs is not None:
        slack = (number(claim.inputs.h) - u @ number(claim.inputs.H).T).min()
    stage = x @ number(claim.Q) @ np.swapaxes(x, 1, 2) + u @ number(claim.R) @ np.swapaxes(u, 1, 2)
    after = x @ number(loop.plant.A).T + u @ number(loop.plant.B).T
    moved = replace(alive, now=after, cost=alive.cost + scale * stage)
    largest = max(float(np.max(np.abs(part), initial=0)) for part in (laws.Zx, laws.z0, laws.Gx, laws.g, moved.cost))
    reach = [np.abs(part).max(axis=(0, 1)).astype(float) for part in (x, u)]
    return moved, Step(cutting.depth, cutting.beyond, reach[0], reach[1], slack, largest, len(alive))


def _with_tail(inside: Simplices, terminal: TerminalSet, scale: object) -> Simplices:
    return replace(inside, cost=inside.cost + scale * terminal.tail_form(inside.now))


def _initial(loop: PiecewiseLoop, claim: Regional, terminal: TerminalSet) -> Simplices:
    region = claim.initial.support
    assert isinstance(region, Box | Polytope)
    vertices = region.simplices()
    if isinstance(region, Box):
        gain = loop.laws(terminal.pattern[None]).Gx[0].astype(float)
        vertices = levelled(vertices, region.lower, region.upper, gain)
    corners = exact(vertices) if loop.arithmetic == "fixed" else loop.numbers(vertices)
    volumes = np.array([abs(determinant(v[1:] - v[0])) for v in corners], dtype=corners.dtype)
    return begin(loop.numbers(vertices), loop.numbers(volumes / volumes.sum()))


def _no_room(budget: Budget, clock: float, pieces: int) -> str:
    if pieces > budget.pieces:
        return f"more than {budget.pieces} simplices"
    return f"the time limit of {budget.seconds:g} s" if time.monotonic() - clock > budget.seconds else ""


def _exhausted(alive: Simplices, step: int, budget: Budget, clock: float, reach: float, finished: int) -> str:
    if len(alive) == 0:
        return ""
    if step >= budget.steps:
        return f"{len(alive)} simplices still under way after {step} steps"
    if float(np.max(np.abs(alive.now))) > reach:
        return f"a motion grew to {DIVERGED:g} times the size of the initial set"
    return _no_room(budget, clock, finished + len(alive))


def _assert_conserved(total: object, done: Simplices, left: Simplices, exactly: bool) -> None:
    gap = abs(done.weight.sum() + left.weight.sum() - total)
    assert gap == 0 if exactly else float(gap) < 1e-9, f"cutting lost or doubled the probability {float(gap):.3g}"
