"""Which motions to draw: starting points that show a set, followed for as long as there is something to see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InvalidInputError
from ..simulate import Trajectory, simulate

CORNERS, INTERIOR = 8, 8
FIRST_STEPS, MOST_STEPS, FEWEST_STEPS = 25, 400, 8
SETTLED, ESCAPED = 0.01, 30.0


@dataclass(frozen=True, eq=False)
class Motions:
    """Motions from several starting points: run (states (n, N, T+1)); worst: the index of the one to be emphasized.

    marked: words for that one: "costliest start" where it is known to be, "costliest start shown" otherwise.
    """

    run: Trajectory
    worst: int
    marked: str


def motions(result: Any) -> Motions:
    """Return the motions of a result's loop: from corners and from the inside of the initial set, the worst one first.

    result: plant, spec, inc and certificate are read; the certificate's worst starting point is among the starts.
    """
    starts, marked = starting_points(result.spec.initial), "costliest start shown"
    worst = getattr(result.certificate, "worst", (np.nan, np.full(result.plant.n, np.nan)))[1]
    if np.all(np.isfinite(worst)):
        starts = np.column_stack([worst, starts[:, np.any(starts != worst[:, None], axis=0)]])
        marked = "costliest start"
    run = _followed(result.plant, result.inc, starts)
    if marked == "costliest start":
        return Motions(run, 0, marked)
    costs = run.cost(result.spec.Q, result.spec.R, result.spec.discount)
    return Motions(run, int(np.argmax(costs)), marked)


def starting_points(initial: Any, seed: int = 1) -> Array:
    """Return a few starting points (n, N) of a distribution: vertices where it has them, and draws.

    >>> from inc_casadi import Box, Uniform
    >>> starting_points(Uniform(Box([-1.0, -1.0], [1.0, 1.0]))).shape
    (2, 12)
    """
    draws = initial.sample(INTERIOR, np.random.default_rng(seed))
    try:
        corners = initial.vertices
    except InvalidInputError:  # an ellipsoid, a Gaussian, or a box of too many vertices
        return np.asarray(draws)
    some = np.unique(np.linspace(0, corners.shape[1] - 1, CORNERS).round().astype(int))
    return np.column_stack([corners[:, some], draws])


def _followed(plant: Any, inc: Any, starts: Array) -> Trajectory:
    """Follow the motions until they settle, escape, or 400 steps are over, and leave out what nobody needs to see."""
    steps = FIRST_STEPS
    while True:
        run = simulate(plant, inc, starts, steps=steps)
        size = float(np.max(np.abs(run.x[..., 0]), initial=1e-300))
        escaped = np.max(np.abs(run.x), axis=(0, 1)) > ESCAPED * size
        if escaped.any():
            return _first(run, max(int(np.argmax(escaped)), FEWEST_STEPS))
        still = np.max(np.abs(run.x - run.x[..., -1:]), axis=(0, 1)) <= SETTLED * size
        settled = int(np.argmax(still))
        if settled <= 0.6 * steps:
            return _first(run, max(settled + 2, FEWEST_STEPS))
        if steps >= MOST_STEPS:
            return run
        steps *= 2


def _first(run: Trajectory, steps: int) -> Trajectory:
    kept = slice(0, min(steps, run.t.size - 1) + 1)
    return Trajectory(run.t[kept], run.x[..., kept], run.u[..., kept], run.eta[..., kept], run.discrete)
