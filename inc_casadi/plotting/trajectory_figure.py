"""The figure of a simulated motion: states above, inputs below."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from ..sets import Box, Polytope
from ..simulate import Trajectory
from .style import new_figure, written
from .time_panels import draw_inputs, draw_states


def plot_trajectories(trajectory: Trajectory, inputs: Box | Polytope | None = None,
                      path: str | Path | None = None) -> Figure:
    """Return a Matplotlib figure of one motion or of several: states and inputs against time.

    trajectory: what `simulate` returned; inputs: the input limits, drawn as dashed lines; path: where to write it, the
    ending chooses the format.

    >>> from inc_casadi import Box, INC, Plant, simulate
    >>> run = simulate(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0), [1.0], steps=5)
    >>> [axes.get_ylabel() for axes in plot_trajectories(run, Box(-1.0, 1.0)).axes]
    ['state $x$', 'input $u$']
    """
    figure = new_figure(8.0, 6.0)
    above, below = figure.subplots(2, 1, sharex=True)
    draw_states(above, trajectory)
    draw_inputs(below, trajectory, inputs)
    above.set_xlabel("")
    return written(figure, path)
