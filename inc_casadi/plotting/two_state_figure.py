"""The figure of laws on a plant of two states: a motion, its inputs, the mean state norm, and what each law costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ..arrays import Array, vector
from ..errors import InvalidInputError
from ..inc import INC
from ..plant import as_plant
from ..sets import Box
from ..simulate import simulate
from ..spec import Spec
from .bounds_chart import draw_bounds
from .cost_panel import Row
from .outlines import as_plane, require_plane
from .style import LIMIT, QUIET, colour, new_figure, written
from .time_panels import ends_of, hatch_beyond, time_label

STYLES = ((colour(2), "o", "-"), (colour(1), "s", "--"), (colour(0), "D", ":"), (colour(3), "^", "-."))
MOST_LAWS = len(STYLES)
FLOOR = 1e-4  # of the largest mean norm: what lies below is nothing to look at


def plot_two_states(plant: Any, spec: Spec, laws: Mapping[str, INC], rows: Sequence[Row], start: ArrayLike,
                    path: str | Path | None = None, *, steps: int = 25, grid: int = 41, width: float | None = None,
                    dpi: float | None = None) -> Figure:
    """Return a Matplotlib figure of up to four laws on a plant of two states.

    Top left: the motion of each law from `start`, with the initial box. Top right: its inputs with their limits. Bottom
    left: the mean norm of the state over a uniform grid of initial states against k. Bottom right: costs and lower bounds,
    as `draw_bounds` draws them.

    plant: discrete; spec: `initial` on a Box, which the grid fills; laws: by name; rows: of the last panel; start: (2,);
    steps: how many; grid: initial states along each axis; path: where to write the figure, the ending chooses the format.
    width, dpi: of the figure and its file, in inches (the height in proportion) and dots per inch.

    Raises InvalidInputError when the plant has not two states or is continuous, the initial set is no box, or there are
    no laws or more than four.

    >>> from inc_casadi import INC, Box, Plant
    >>> plant = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
    >>> spec = Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box(-1, 1))
    >>> figure = plot_two_states(plant, spec, {"clipped": INC.saturated([[-1.4, -2.6]], 1.0)}, [], [0.8, 0.8])
    >>> len(figure.axes)
    4
    """
    plant = as_plant(plant)
    require_plane("the plant", spec.check(plant).n)
    start = vector("start", start, 2)
    if not isinstance(spec.initial.support, Box):
        raise InvalidInputError(f"initial is on a {type(spec.initial.support).__name__}, but the grid fills a Box")
    if not plant.discrete or not 1 <= len(laws) <= MOST_LAWS:
        raise InvalidInputError(f"the plant has dt = {plant.dt:g} and there are {len(laws)} laws, but the figure is of a "
                                f"discrete plant under 1 to {MOST_LAWS} laws")
    figure = new_figure(12.0, 8.6)
    (plane, inputs), (norms, costs) = figure.subplots(2, 2)
    everywhere = grid_of(spec.initial.support, grid)
    for (name, inc), (shade, marker, dashes) in zip(laws.items(), STYLES, strict=False):
        run = simulate(plant, inc, start, steps=steps)
        plane.plot(*run.x, marker + dashes, color=shade, lw=1.6, ms=4, label=name)
        for row in run.u:
            inputs.plot(run.t, row, color=shade, ls=dashes, lw=1.8, marker=marker, ms=3.5, drawstyle="steps-post")
        mean = np.linalg.norm(simulate(plant, inc, everywhere, steps=steps).x, axis=0).mean(axis=0)
        norms.plot(run.t, mean, marker + dashes, color=shade, lw=1.8, ms=4, label=name)
    _finish_plane(plane, spec.initial.support, start)
    _finish_inputs(inputs, spec, time_label(run))
    _finish_norms(norms, grid, time_label(run))
    draw_bounds(costs, rows)
    costs.set_title("Expected cost: solid bars are certified, lines are lower bounds", fontsize="medium")
    return written(figure, path, width, dpi)


def grid_of(box: Box, count: int) -> Array:
    """Return the points (n, count^n) of a uniform grid that includes the corners of the box.

    >>> grid_of(Box([0, 0], [1, 2]), 2).tolist()
    [[0.0, 0.0, 1.0, 1.0], [0.0, 2.0, 0.0, 2.0]]
    """
    sides = [np.linspace(low, high, count) for low, high in zip(box.lower, box.upper, strict=True)]
    return np.stack(np.meshgrid(*sides, indexing="ij")).reshape(box.dimension, -1)


def _finish_plane(axes: Any, box: Box, start: Array) -> None:
    (left, low), (right, high) = box.lower, box.upper
    axes.fill([left, right, right, left], [low, low, high, high], color="0.94", zorder=0, label="initial states")
    axes.plot(*start, "o", color="black", ms=8, mfc="none", mew=1.6, label="start", zorder=4)
    axes.plot(0.0, 0.0, "+", color="black", ms=9)
    as_plane(axes)
    axes.legend(fontsize="small", loc="best")
    axes.set_title(f"Motion from ({start[0]:g}, {start[1]:g})", fontsize="medium")


def _finish_inputs(axes: Any, spec: Spec, time: str) -> None:
    if spec.inputs is not None:
        for value in {*spec.inputs.vertices.ravel()}:
            axes.axhline(value, color=LIMIT, ls="--", lw=1.2, zorder=1.5)
    axes.axhline(0.0, color=QUIET, lw=0.8)
    axes.set_xlabel(time)
    axes.set_ylabel("input " + ("$u$" if spec.m == 1 else "$u_i$"))
    axes.grid(True, color="0.92")
    axes.margins(y=0.12)
    if spec.inputs is not None and spec.m == 1:
        hatch_beyond(axes, *(float(end[0]) for end in ends_of(spec.inputs)))
    axes.set_title("Its inputs; red: the limits", fontsize="medium")


def _finish_norms(axes: Any, grid: int, time: str) -> None:
    largest = max(float(np.max(line.get_ydata())) for line in axes.lines)
    axes.set_yscale("log")
    axes.set_ylim(FLOOR * largest, 2 * largest)
    axes.set_xlabel(time)
    axes.set_ylabel(r"mean norm of the state $\|x_k\|$")
    axes.grid(True, color="0.92")
    axes.legend(fontsize="small")
    axes.set_title(f"Mean over a grid of {grid} x {grid} initial states", fontsize="medium")
