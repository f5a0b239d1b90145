"""The figure of simulated motions: of one law, or of several in the same axes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..arrays import Array
from ..errors import DimensionError, InvalidInputError
from ..sets import Box, Polytope
from ..simulate import Trajectory
from .outlines import legend_below
from .style import DASHES, MARKERS, colour, name_of, new_figure, written
from .time_panels import draw_inputs, draw_states, ends_of, hatch_beyond, limit_line, time_label

MOST_STATES = 4  # with a panel each; of more the norm is drawn
TALL = 4  # panels above each other; more take two columns
SIGNS = 12  # markers along a line


def plot_trajectories(trajectory: Trajectory | Mapping[str, Trajectory], inputs: Box | Polytope | None = None,
                      path: str | Path | None = None, *, width: float | None = None, dpi: float | None = None) -> Figure:
    """Return a Matplotlib figure of motions against time: states above, inputs below, what the limits exclude hatched.

    One trajectory: all states in one panel, all inputs in another. Several, by the name of their law: a panel for each
    state (the norm, of more than 4) and for each input, where every law has a colour, a dash and a marker of its own.

    trajectory: what `simulate` returned, of one motion or several, or a mapping from names to such; inputs: the input
    limits, Box or Polytope in R^m (of a polytope, its extent along each input); path: where to write the figure, the ending
    chooses the format.
    width, dpi: of the figure and its file, in inches (the height in proportion) and dots per inch.

    Raises InvalidInputError when there is no law, no motion, or time is counted differently; DimensionError when numbers of
    states or inputs differ.

    >>> from inc_casadi import Box, INC, Plant, simulate
    >>> plant, box = Plant([[1.5]], [[1.0]]), Box(-1.0, 1.0)
    >>> run = simulate(plant, INC.saturated([[-1.5]], 1.0), [1.0], steps=5)
    >>> [axes.get_ylabel() for axes in plot_trajectories(run, box).axes]
    ['state $x$', 'input $u$']
    >>> figure = plot_trajectories({"clipped": run, "gain": simulate(plant, INC.linear([[-0.9]]), [1.0], steps=5)}, box)
    >>> [text.get_text() for text in figure.legends[0].get_texts()]
    ['clipped', 'gain']
    """
    runs = dict(trajectory) if isinstance(trajectory, Mapping) else {"": trajectory}
    _check(runs, inputs)
    if not isinstance(trajectory, Mapping):
        figure = new_figure(8.0, 6.0)
        above, below = figure.subplots(2, 1, sharex=True)
        draw_states(above, trajectory)
        draw_inputs(below, trajectory, inputs)
        above.set_xlabel("")
        return written(figure, path, width, dpi)
    return written(_several(runs, inputs), path, width, dpi)


def _check(runs: Mapping[str, Trajectory], inputs: Box | Polytope | None) -> None:
    if not runs:
        raise InvalidInputError("there is nothing to draw: no law is given")
    for name, run in runs.items():
        what = f"the trajectory {name!r}" if name else "the trajectory"
        if not isinstance(run, Trajectory):
            raise InvalidInputError(f"{what} is a {type(run).__name__}, but must be what `simulate` returned")
        if 0 in run.x.shape:
            raise InvalidInputError(f"{what} has states of shape {run.x.shape}: there is no motion to draw")
    first = next(iter(runs.values()))
    for name, run in runs.items():
        if (run.x.shape[0], run.u.shape[0]) != (first.x.shape[0], first.u.shape[0]):
            raise DimensionError(f"{name!r} has {run.x.shape[0]} states and {run.u.shape[0]} inputs, but the first law has "
                                 f"{first.x.shape[0]} and {first.u.shape[0]}")
        if time_label(run) != time_label(first):
            raise InvalidInputError(f"{name!r} counts {time_label(run)}, but the first law counts {time_label(first)}")
    if inputs is not None and inputs.dimension != first.u.shape[0]:
        raise DimensionError(f"inputs lies in R^{inputs.dimension}, but there are {first.u.shape[0]} inputs")


def _several(runs: Mapping[str, Trajectory], inputs: Box | Polytope | None) -> Figure:
    first = next(iter(runs.values()))
    n, m = first.x.shape[0], first.u.shape[0]
    shown = n if n <= MOST_STATES else 1
    wide = 1 if shown + m <= TALL else 2
    rows = -(-(shown + m) // wide)
    figure = new_figure(3.6 + 4.2 * wide, 0.9 + 2.1 * rows)
    panels = figure.subplots(rows, wide, squeeze=False, sharex=True).ravel()
    for i in range(shown):
        _panel(panels[i], {name: _state(run, i) for name, run in runs.items()}, runs, False)
        panels[i].set_ylabel("state " + name_of("x", i, n) if n <= MOST_STATES else r"norm of the state $\|x\|$")
    for j in range(m):
        axes = panels[shown + j]
        _panel(axes, {name: _motions(run.u)[j] for name, run in runs.items()}, runs, True)
        axes.set_ylabel("input " + name_of("u", j, m))
        if inputs is not None:
            _limits(axes, *(float(end[j]) for end in ends_of(inputs)))
    for axes in panels[max(shown + m - wide, 0): shown + m]:
        axes.set_xlabel(time_label(first))
        axes.tick_params(labelbottom=True)
    for spare in panels[shown + m:]:
        spare.set_axis_off()
    legend_below(figure, [_sign(i, name) for i, name in enumerate(runs)], 4)
    return figure


def _motions(values: Array) -> Array:
    return values[:, None, :] if values.ndim == 2 else values


def _state(run: Trajectory, i: int) -> Array:
    x = _motions(run.x)
    return x[i] if x.shape[0] <= MOST_STATES else np.linalg.norm(x, axis=0)


def _panel(axes: Any, values: Mapping[str, Array], runs: Mapping[str, Trajectory], held: bool) -> None:
    for index, (name, rows) in enumerate(values.items()):
        run = runs[name]
        style = "steps-post" if held and run.discrete else "default"
        every = (index % 3, max(1, run.t.size // SIGNS))
        for row in rows:
            axes.plot(run.t, row, color=colour(index), ls=DASHES[index % len(DASHES)], lw=1.6, drawstyle=style, ms=4.5,
                      marker=MARKERS[index % len(MARKERS)], mfc="white", markevery=every, zorder=3 - 0.01 * index)
    axes.grid(True, color="0.92")
    axes.set_axisbelow(True)
    axes.margins(x=0.02)


def _limits(axes: Any, low: float, high: float) -> None:
    for value in (low, high):
        limit_line(axes, value, f"limit ${value:.4g}$")
    axes.margins(y=0.12)
    hatch_beyond(axes, low, high)


def _sign(index: int, name: str) -> Line2D:
    return Line2D([], [], color=colour(index), ls=DASHES[index % len(DASHES)], lw=1.6, mfc="white", ms=4.5,
                  marker=MARKERS[index % len(MARKERS)], label=name)
