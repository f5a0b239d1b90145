"""The portrait of one state: where the loop goes from each value, with motions as a staircase."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..arrays import Array
from ..inc import INC
from ..plant import Plant
from ..sets import Box
from .outlines import legend_beside
from .paths import motion, paths, rest_of
from .portrait_sets import look
from .style import QUIET, WORST, colour

POINTS, MARGIN = 801, 0.08


def draw_line(axes: Any, plant: Plant, inc: INC, window: Box, bodies: Mapping[str, Any], starts: Array | None,
              span: tuple[int, float | None], own: bool) -> None:
    """Draw the next state x+ (discrete) or the velocity (continuous) against the state x of a plant of one state.

    Discrete: motions are a staircase between the graph and the diagonal x+ = x, at rest where the two meet. Continuous:
    motions are arrows on the axis, to the right where the velocity is positive. Sets are bars along the lower edge.
    """
    x = np.linspace(window.lower[0], window.upper[0], POINTS)
    ahead = motion(plant, inc, x[None])[0] + (x if plant.discrete else 0.0)
    name = "next state $x^+$" if plant.discrete else r"velocity $\dot{x}$"
    handles = axes.plot(x, ahead, color=colour(0), lw=2.0, zorder=3, label=name)
    still = x if plant.discrete else np.zeros_like(x)
    handles += axes.plot(x, still, color=QUIET, ls="--", lw=1.0, label="at rest: $x^+ = x$" if plant.discrete else "at rest")
    if plant.discrete:
        begin = np.array([[window.lower[0], window.upper[0]]]) if starts is None else starts
        handles += _draw_stairs(axes, plant, inc, window, begin, span)
    else:
        _draw_heading(axes, x, ahead)
    handles += _draw_bars(axes, bodies)
    rest = rest_of(plant, inc)
    if rest is not None:
        handles += axes.plot(rest, rest if plant.discrete else 0.0, "P", color=WORST, mec="white", ms=9, zorder=6,
                             label="equilibrium")
    axes.set_xlim(x[0], x[-1])
    axes.set_ylim(*_height(np.concatenate([ahead, still])))
    axes.set_xlabel("state $x$")
    axes.set_ylabel(name)
    axes.grid(True, color="0.92")
    axes.set_axisbelow(True)
    axes.set_title("Phase portrait of one state", fontsize="medium")
    legend_beside(axes, handles, 3, own)


def _height(values: Array) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    room = 0.1 * max(high - low, 1e-9 + 1e-3 * abs(high))
    return low - 2 * room, high + room  # below, the bars of the sets


def staircase(x: Array) -> tuple[Array, Array]:
    """Return the corners of the staircase of a motion (K,): from (x_k, x_k) up to (x_k, x_k+1), across to (x_k+1, x_k+1).

    >>> [part.tolist() for part in staircase(np.array([1.0, 0.5, 0.25]))]
    [[1.0, 1.0, 0.5, 0.5, 0.25], [1.0, 0.5, 0.5, 0.25, 0.25]]
    """
    return np.repeat(x, 2)[:-1], np.concatenate([x[:1], np.repeat(x[1:], 2)])


def _draw_stairs(axes: Any, plant: Plant, inc: INC, window: Box, starts: Array,
                 span: tuple[int, float | None]) -> list[Any]:
    found = paths(plant, inc, starts, window, *span)
    for row, settles in zip(found.x[0], found.rests, strict=True):
        shade, dashes = ("#303030", "-") if settles else (colour(1), (0, (4, 2)))
        axes.plot(*staircase(row), color=shade, ls=dashes, lw=0.9, zorder=4)
        axes.plot(row[0], row[0], "o", color=shade, mfc="white", ms=4.5, zorder=5)
    looks = (("#303030", "-", "motions that come to rest", found.rests),
             (colour(1), (0, (4, 2)), "motions not at rest in the time shown", ~found.rests))
    return [Line2D([], [], color=shade, ls=dashes, lw=1.0, label=words) for shade, dashes, words, which in looks
            if which.any()]


def _draw_heading(axes: Any, x: Array, velocity: Array) -> None:
    some = slice(POINTS // 40, None, POINTS // 20)
    for sign, marker in ((1.0, ">"), (-1.0, "<")):
        here = x[some][np.sign(velocity[some]) == sign]
        axes.plot(here, np.zeros_like(here), marker, color="#303030", ms=6, ls="", zorder=4)


def _draw_bars(axes: Any, bodies: Mapping[str, Any]) -> list[Any]:
    handles, own = [], 0
    for level, (name, body) in enumerate(bodies.items()):
        shade, dashes = look(name, own)
        own += shade not in (WORST, colour(2))
        inner = body.region if hasattr(body, "polytopes") else body
        ends = [(float(-inner.support([-1.0])), float(inner.support([1.0])))]
        if hasattr(body, "polytopes"):
            ends = [(float(corners.min()), float(corners.max())) for corners in body.polytopes()]
        for low, high in ends:
            axes.plot([low, high], [MARGIN / 2 * (level + 1)] * 2, color=shade, lw=4.0, solid_capstyle="butt",
                      transform=axes.get_xaxis_transform(), zorder=5)
        handles.append(Patch(facecolor=shade, label=name))
    return handles
