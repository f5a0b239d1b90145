"""The phase portrait: the regions of the law, where the loop is heading, motions, the initial and the certified set."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike

from ..arrays import Array, columns
from ..errors import DimensionError, InvalidInputError
from ..inc import INC
from ..loop import fitting
from ..plant import Plant
from ..sets import Box
from ..sets.uniform import as_distribution
from .motions import starting_points
from .outlines import legend_beside
from .paths import Paths, arrow_grid, arrows, motion, paths, rest_of
from .phase_line import draw_line
from .plane_slice import PlaneSlice, plane_slice, rim
from .portrait_levels import draw_levels, levels_wanted
from .portrait_regions import draw_regions
from .portrait_sets import certified_bodies, draw_sets, window_of
from .style import WORST, canvas, colour, name_of, written

GRID = 21  # arrows along each axis
HEAVY, LEAVES = "#303030", colour(1)


def plot_phase_portrait(plant: Any, inc: INC, region: Box | None = None, *, initial: Any = None, certificate: Any = None,
                        levels: int | None = None, sets: Mapping[str, Any] | None = None, starts: ArrayLike | None = None,
                        steps: int = 60, duration: float | None = None, axes: tuple[int, int] = (0, 1),
                        at: ArrayLike | None = None, ax: Any = None, path: str | Path | None = None,
                        width: float | None = None, dpi: float | None = None) -> Figure:
    """Return a Matplotlib figure of the closed loop x+ = A x + B pi(C x), or dx/dt of it, in a plane of states.

    Shaded: the regions of a piecewise-affine law, exact, a number in each and its formula in the legend (no shade for other
    activations). Grey arrows: the step x+ - x, or dx/dt; longer where it is larger, by the root. Lines: motions, solid
    where they end near the equilibrium (the cross), dashed where they do not within the time shown: that is simulation.
    Outlined: the initial set; what the certificate certifies; further sets under the names given. Thin: level sets of the
    certificate's storage function, no further out than where it proves something.

    Two states are the plane itself. Of more, `axes` and `at` choose a slice: regions, arrows and sets are those of the
    slice, motions and the equilibrium are projected onto it; the title says so. One state: x+ (or dx/dt) against x, with
    motions as a staircase; see `draw_line`.

    Parameters
    ----------
    plant : Plant or control.StateSpace
    inc : the controller
    region : Box in R^2, the two coordinates drawn (R^1 for one state); by default what holds sets, starts and motions
    initial : distribution or set of starting points in R^n, or None
    certificate : one that holds, or a Basin of `region_of_attraction`, or None
    levels : how many level sets of the certificate's storage function; by default 6 where it certifies no set, else none
    sets : Box, Polytope or Ellipsoid in R^n by the name that the legend gives it
    starts : starting points (n,) or (n, N) of the motions; by default vertices and draws of `initial`, else points on the
        rim of the region
    steps, duration : how long motions are followed, in discrete and in continuous time (there six slowest time constants)
    axes, at : coordinates of the plane, numbered from 0, and the values (n,) of the others, 0 by default
    ax : Matplotlib axes to draw into, whose figure is returned; path : where to write it, the ending chooses the format
    width, dpi : inches, the height in proportion, and dots per inch, of the figure and its file

    Raises
    ------
    InvalidInputError : nothing says where to look, a certificate that does not hold, levels of what has no storage function
        or in one state, a set of another kind
    DimensionError : something is not of n states

    Examples
    --------
    >>> plant = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
    >>> law = INC.saturated([[-1.3749, -2.6490]], 1.0)
    >>> figure = plot_phase_portrait(plant, law, initial=Box([-0.8, -0.8], [0.8, 0.8]))
    >>> [text.get_text() for text in figure.legends[0].get_texts()][3:]
    ['initial set', 'step $x^+ - x$', 'motions that come to rest', 'equilibrium']
    """
    plant = fitting(plant, inc)
    initial = None if initial is None else _distribution(initial, plant.n)
    bodies = certified_bodies(certificate, sets, initial, plant.n)
    given = None if starts is None else columns("starts", starts, plant.n)[0]
    if given is None and initial is not None:
        given = starting_points(initial)
    if plant.n == 1:
        if levels:
            raise InvalidInputError(f"levels = {levels}: level sets are drawn in a plane, but the plant has one state")
        figure, panel = canvas(ax, 6.4, 6.0)
        draw_line(panel, plant, inc, window_of(region, bodies, given, (0,)), bodies, given,
                  (steps, duration), ax is None)
        return written(figure, path, width, dpi)
    plane = plane_slice(plant.n, axes, at)
    window = window_of(region, bodies, given, plane.axes)
    figure, panel = canvas(ax, 6.6, 6.8)
    begin = plane.lift(rim(window)) if given is None else given
    found = paths(plant, inc, begin, plane.around(window, begin), steps, duration)
    rest = rest_of(plant, inc)
    busy = [plane.project(found.x).reshape(2, -1)] + ([] if rest is None else [plane.project(rest)[:, None]])
    handles = draw_regions(panel, inc, plant.C, plane, window, np.concatenate(busy, axis=1).T)
    handles += draw_sets(panel, plane, bodies)
    handles += draw_levels(panel, certificate, plane, window, levels_wanted(certificate, bodies, levels))
    handles += _draw_field(panel, plant, inc, plane, window)
    handles += _draw_motions(panel, plant, plane, found, rest)
    _finish(panel, plane, window)
    legend_beside(panel, handles, 2, ax is None)
    return written(figure, path, width, dpi)


def _distribution(initial: Any, n: int) -> Any:
    found = as_distribution(initial)
    if found.dimension != n:
        raise DimensionError(f"initial is on R^{found.dimension}, but the plant has {n} states")
    return found


def _draw_field(axes: Any, plant: Plant, inc: INC, plane: PlaneSlice, window: Box) -> list[Any]:
    points, cell = arrow_grid(window.lower, window.upper, GRID)
    tips = arrows(plane.project(motion(plant, inc, plane.lift(points))), cell)
    axes.quiver(*points, *tips, angles="xy", scale_units="xy", scale=1.0, pivot="mid", color="#8A8A8A", width=0.0022,
                headwidth=4.5, headlength=5.0, headaxislength=4.2, zorder=1.5)
    name = "step $x^+ - x$" if plant.discrete else r"velocity $\dot{x}$"
    return [Line2D([], [], color="#8A8A8A", lw=1.0, marker=">", ms=4, label=name)]


def _draw_motions(axes: Any, plant: Plant, plane: PlaneSlice, found: Paths, rest: Array | None) -> list[Any]:
    handles = []
    for settles, words in ((True, "motions that come to rest"), (False, "motions not at rest in the time shown")):
        if np.any(found.rests == settles):
            handles.append(_lines(axes, plant, plane, found, settles, words))
    if rest is not None:
        dot, = axes.plot(*plane.project(rest)[:, None], "P", color=WORST, mec="white", ms=9, ls="", zorder=7,
                         label="equilibrium")
        handles.append(dot)
    return handles


def _lines(axes: Any, plant: Plant, plane: PlaneSlice, found: Paths, settles: bool, words: str) -> Any:
    shade, dashes = (HEAVY, "-") if settles else (LEAVES, (0, (4, 2)))
    marker, size = ("o", 2.6) if plant.discrete else (None, 0.0)
    for x in np.moveaxis(plane.project(found.x[:, found.rests == settles]), 1, 0):
        line, = axes.plot(*x, color=shade, ls=dashes, lw=0.9, marker=marker, ms=size, mew=0, zorder=4, label=words)
        axes.plot(*x[:, :1], "o", color=shade, mfc="white", ms=4.5, zorder=4.5)
    return line


def _finish(axes: Any, plane: PlaneSlice, window: Box) -> None:
    axes.set_xlim(window.lower[0], window.upper[0])
    axes.set_ylim(window.lower[1], window.upper[1])
    axes.set_xlabel("state " + name_of("x", plane.axes[0], plane.n))
    axes.set_ylabel("state " + name_of("x", plane.axes[1], plane.n))
    axes.set_title("Phase portrait" + (f"\n{plane.words}" if plane.words else ""), fontsize="medium")

