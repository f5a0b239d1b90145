"""Motions for portraits: followed until they rest or are far away, and where the arrows of a field point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import NoEquilibriumError
from ..inc import INC
from ..loop import equilibrium
from ..plant import Plant
from ..sets import Box
from ..simulate import simulate

FAR = 3.0  # half widths of the picture from which on a motion is no longer followed
NEAR = 0.02  # of the picture's size: so close to the equilibrium a motion has come to rest
PERIODS, CONTRACTIONS = 60.0, 6.0


@dataclass(frozen=True, eq=False)
class Paths:
    """Motions x (n, N, K), NaN from when they are far away; rests (N,): whether each ends near the equilibrium."""

    x: Array
    rests: np.ndarray


def rest_of(plant: Plant, inc: INC) -> Array | None:
    """Return the equilibrium (n,) of the loop, or None where none is found.

    >>> rest_of(Plant([[0.5]], [[1.0]]), INC.linear([[0.0]])).tolist()
    [0.0]
    """
    try:
        return equilibrium(plant, inc).x
    except NoEquilibriumError:
        return None


def motion(plant: Plant, inc: INC, states: Array) -> Array:
    """Return where states (n, N) are heading: the step x+ - x in discrete time, dx/dt in continuous time.

    >>> motion(Plant([[0.5]], [[1.0]]), INC.linear([[0.0]]), np.array([[2.0]])).tolist()
    [[-1.0]]
    """
    ahead = plant.A @ states + plant.B @ inc(plant.C @ states)
    return ahead - states if plant.discrete else ahead


def paths(plant: Plant, inc: INC, starts: Array, window: Box, steps: int = 60, duration: float | None = None) -> Paths:
    """Return the motions from starts (n, N), each until it is three times as far out as the picture.

    window: the box in R^n whose size counts; steps: of a discrete plant; duration: of a continuous one, by default six
    times the slowest time constant of the loop at its equilibrium.
    """
    rest = rest_of(plant, inc)
    if plant.discrete:
        x = _steps(plant, inc, starts, window, steps)
    else:
        length = duration if duration is not None else _duration(plant, inc, rest)
        x = simulate(plant, inc, starts, duration=length).x
        x = np.where(np.cumsum(_far(x, window), axis=-1) > 0, np.nan, x)
    if rest is None:
        return Paths(x, np.zeros(starts.shape[1], dtype=bool))
    size = float(np.max(window.upper - window.lower))
    gap = np.max(np.abs(np.nan_to_num(x[..., -1], nan=np.inf) - rest[:, None]), axis=0)
    return Paths(x, gap <= NEAR * size)


def converging(plant: Plant, inc: INC, region: Box, points: int = 121, steps: int = 120) -> tuple[Array, np.ndarray]:
    """Return a grid (2, points^2) over a region of two states, and which of its simulated motions come to rest (points^2,).

    What `plot_attraction` takes as `simulated`; steps as in `paths`, of a discrete plant.

    >>> grid, rests = converging(Plant([[0.5, 0.0], [0.0, 2.0]], [[0.0], [1.0]]), INC.linear([[0.0, 0.0]]),
    ...                          Box([-1.0, -1.0], [1.0, 1.0]), 3)
    >>> grid[:, rests].tolist()
    [[-1.0, 0.0, 1.0], [0.0, 0.0, 0.0]]
    """
    sides = [np.linspace(low, high, points) for low, high in zip(region.lower, region.upper, strict=True)]
    grid = np.stack(np.meshgrid(*sides)).reshape(2, -1)
    return grid, paths(plant, inc, grid, region, steps).rests


def _steps(plant: Plant, inc: INC, starts: Array, window: Box, steps: int) -> Array:
    states, here = [starts], starts
    for _ in range(steps):
        near = ~_far(here, window)
        ahead = np.full_like(here, np.nan)
        ahead[:, near] = here[:, near] + motion(plant, inc, here[:, near])
        states.append(ahead)
        here = ahead
    return np.stack(states, axis=-1)


def _far(x: Array, window: Box) -> Any:
    """Whether each state of x (n, ...) is outside the window scaled by `FAR`, or is none."""
    shape = (-1,) + (1,) * (x.ndim - 1)
    half = ((window.upper - window.lower) / 2).reshape(shape)
    return ~np.all(np.abs(x - window.center.reshape(shape)) <= FAR * half, axis=0)


def _duration(plant: Plant, inc: INC, rest: Array | None) -> float:
    x = np.zeros(plant.n) if rest is None else rest
    poles = np.linalg.eigvals(plant.A + plant.B @ inc.jacobian(plant.C @ x) @ plant.C)
    slowest, fastest = float(np.min(np.abs(poles.real))), float(np.max(np.abs(poles)))
    if fastest == 0:
        return 1.0
    return min(CONTRACTIONS / slowest if slowest > 0 else np.inf, PERIODS / fastest)


def arrow_grid(low: Array, high: Array, count: int) -> tuple[Array, Array]:
    """Return the centres (2, count^2) of equal cells of a rectangle, and the size (2,) of a cell.

    >>> arrow_grid(np.zeros(2), np.array([2.0, 4.0]), 2)[0].tolist()
    [[0.5, 1.5, 0.5, 1.5], [1.0, 1.0, 3.0, 3.0]]
    """
    cell = (high - low) / count
    sides = [low[i] + cell[i] * (np.arange(count) + 0.5) for i in range(2)]
    return np.stack(np.meshgrid(*sides)).reshape(2, -1), cell


def arrows(direction: Array, cell: Array, share: float = 0.9) -> Array:
    """Return arrows (2, N) that point as `direction` does and fit their cells.

    Measured in cells, the longest is `share`, and lengths go with the root of the speed, so that slow ones remain to be
    seen. A direction of zero stays zero.

    >>> arrows(np.array([[4.0, 1.0], [0.0, 0.0]]), np.array([1.0, 1.0])).tolist()
    [[0.9, 0.45], [0.0, 0.0]]
    """
    scaled = direction / cell[:, None]
    speed = np.linalg.norm(scaled, axis=0)
    most = max(float(speed.max(initial=0.0)), 1e-300)
    return cell[:, None] * scaled * (share / np.sqrt(most * np.where(speed > 0, speed, 1.0)))
