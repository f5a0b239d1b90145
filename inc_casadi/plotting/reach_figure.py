"""The figure of reachable sets: where the motions from a set are at each step."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch, Rectangle

from ..arrays import Array
from ..errors import DimensionError
from ..pieces.reach import ReachableSets
from .outlines import add_quickly, as_plane, legend_below, mark_small, union_path
from .style import QUIET, WORST, colour, name_of, new_figure, written
from .union_outline import boundary

FILLED = 0.3  # opacity of a set in the plane
MOST_OUTLINED = 5000  # polygons: finding the boundary of more takes seconds
TALL = 3  # up to so many panels stand above each other; more take two columns


def plot_reachable(sets: ReachableSets, points: Array | None = None, path: str | Path | None = None, *,
                   width: float | None = None, dpi: float | None = None) -> Figure:
    """Return a Matplotlib figure of exact reachable sets: for two states in the plane, otherwise intervals over steps.

    Two states: the set of each step is a union of polygons, filled as one shape and coloured by step, with its boundary
    and, dashed, its smallest box. Otherwise, one panel for each state and each input: the interval of
    its values at each step, every end of which is reached.

    sets: what `reachable` returned; points: sampled motions to draw on top, (n, N, K) as `simulate(...).x`, or None; path:
    where to write it.
    width, dpi: of the figure and its file, in inches (the height in proportion) and dots per inch.

    Raises DimensionError when the points have another number of states.

    >>> from inc_casadi import INC, Box, Plant
    >>> from inc_casadi.pieces.reach import reachable
    >>> sets = reachable(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0), Box([-1.0], [1.2]), 2)
    >>> [axes.get_ylabel() for axes in plot_reachable(sets).axes]
    ['state $x$', 'input $u$']
    """
    n = sets.boxes.shape[2]
    if points is not None and (points.ndim != 3 or points.shape[0] != n):
        raise DimensionError(f"points has shape {points.shape}, but motions of {n} states are ({n}, N, K)")
    shown = None if points is None else points[:, :, : sets.steps + 1]
    return written(_plane_figure(sets, shown) if n == 2 else _interval_figure(sets, shown), path, width, dpi)


def step_colours(steps: int) -> list[Any]:
    """Return one colour for each of the steps 0 to `steps`, from dark violet to light green, each readable on white.

    >>> len(step_colours(6))
    7
    """
    return [tuple(float(part) for part in row[:3]) for row in colormaps["viridis"](np.linspace(0.0, 0.9, steps + 1))]


def _title(sets: ReachableSets) -> str:
    count = sum(sets.pieces)
    ended = f"\n{sets.ended} ended the search" if sets.ended else ""
    return f"Reachable sets of {sets.steps} steps, exact: {count} polytope{'s' if count > 1 else ''} in all{ended}"


def _plane_figure(sets: ReachableSets, points: Array | None) -> Figure:
    figure = new_figure(7.4, 6.2)
    axes = figure.subplots()
    shades, boxes = step_colours(sets.steps), sets.boxes
    size = np.ptp(boxes.reshape(-1, 2), axis=0)
    for k, shade in enumerate(shades):
        _draw_set(axes, sets.polytopes(k), shade, 2 + k / len(shades))
        mark_small(axes, boxes[k], size, shade, 3.1)
        low, width = boxes[k, 0], np.ptp(boxes[k], axis=0)
        axes.add_patch(Rectangle((low[0], low[1]), *width, fill=False, ec=shade, ls="--", lw=0.9, zorder=3))
    handles = [Line2D([], [], color=QUIET, ls="--", lw=0.9, label="smallest box around each set")]
    if points is not None:
        axes.plot(*points.reshape(2, -1), ".", color=WORST, ms=2.0, mew=0, zorder=3)
        handles.append(Line2D([], [], color=WORST, ls="", marker=".", ms=4, label="simulated motions"))
    _step_bar(axes, sets.steps, shades)
    as_plane(axes)
    axes.margins(0.05)
    legend_below(figure, handles)
    axes.set_title(_title(sets), fontsize="medium")
    return figure


def _draw_set(axes: Any, polygons: list[Array], shade: Any, zorder: float) -> None:
    """Fill the union and draw its boundary, so that sets which cover each other all remain to be seen."""
    path = union_path(polygons)
    add_quickly(axes, PathPatch(path, facecolor=shade, alpha=FILLED, edgecolor="none", zorder=zorder))
    if len(polygons) <= MOST_OUTLINED:
        axes.add_collection(LineCollection(list(boundary(polygons)), colors=[shade], linewidths=1.5, zorder=zorder + 0.01))


def _step_bar(axes: Any, steps: int, shades: list[Any]) -> None:
    scale = BoundaryNorm(np.arange(steps + 2) - 0.5, steps + 1)
    ticks = np.arange(0, steps + 1, -(-(steps + 1) // 12))
    axes.figure.colorbar(ScalarMappable(scale, ListedColormap(shades)), ax=axes, label="step $k$", ticks=ticks)


def _interval_figure(sets: ReachableSets, points: Array | None) -> Figure:
    n, m = sets.boxes.shape[2], sets.inputs.shape[2]
    wide = 1 if n + m <= TALL else 2
    rows = -(-(n + m) // wide)
    figure = new_figure(4.0 + 4.0 * wide, 0.8 + 2.0 * rows)
    panels = figure.subplots(rows, wide, squeeze=False).ravel()
    for i in range(n):
        _draw_intervals(panels[i], sets.boxes[:, :, i], colour(0), "state " + name_of("x", i, n), sets.steps)
        if points is not None:
            panels[i].plot(np.arange(points.shape[2]), points[i].T, color=WORST, lw=0.6, alpha=0.5, zorder=3)
    for j in range(m):
        _draw_intervals(panels[n + j], sets.inputs[:, :, j], colour(1), "input " + name_of("u", j, m), sets.steps)
    for spare in panels[n + m:]:
        spare.set_axis_off()
    lines = "; lines: simulated motions" if points is not None else ""
    figure.suptitle(_title(sets) + "\nbars: smallest to largest value at each step" + lines, fontsize="medium")
    return figure


def _draw_intervals(axes: Any, ends: Array, shade: str, name: str, steps: int) -> None:
    k = np.arange(len(ends))
    axes.fill_between(k, ends[:, 0], ends[:, 1], color=shade, alpha=0.12, lw=0)
    axes.vlines(k, ends[:, 0], ends[:, 1], color=shade, lw=2.2)
    for end in ends.T:
        axes.plot(k, end, "_", color=shade, ms=9, mew=2.0)
    axes.set_xlabel("step $k$")
    axes.set_ylabel(name)
    axes.set_xlim(-0.04 * steps - 0.1, 1.04 * steps + 0.1)
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.grid(True, color="0.92")
    axes.set_axisbelow(True)
