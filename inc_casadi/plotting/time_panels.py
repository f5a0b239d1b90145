"""Panels over time: states, inputs with their limits, the size of the state."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from ..arrays import Array
from ..simulate import Trajectory
from .style import LIMIT, WORST, colour, name_of, tint

MOST_NAMED = 8
BAND = 0.08  # of the distance of the limits: what is seen beyond them at least
FLOOR = 1e-6  # of the largest norm: what lies below is nothing to look at


def draw_states(axes: Any, run: Trajectory, worst: int | None = None) -> None:
    """Draw every state of every motion against time, one colour per state, the motion `worst` in strong lines."""
    _draw(axes, run, run.x, "x", worst)
    axes.set_ylabel("state " + ("$x$" if run.x.shape[0] == 1 else "$x_i$"))


def draw_inputs(axes: Any, run: Trajectory, limits: Any = None, worst: int | None = None) -> None:
    """Draw every input of every motion against time, and the limits as dashed lines.

    limits: Box or Polytope in R^m, or None. Of a polytope the lines are its extent along each input.
    """
    _draw(axes, run, run.u, "u", worst)
    axes.set_ylabel("input " + ("$u$" if run.u.shape[0] == 1 else "$u_i$"))
    if limits is not None:
        _draw_limits(axes, limits)


def draw_norm(axes: Any, run: Trajectory, worst: int | None = None) -> None:
    """Draw the Euclidean norm of the state against time, logarithmic unless that would show nothing."""
    norm = np.linalg.norm(_motions(run.x), axis=0)
    largest = float(norm.max(initial=0.0))
    drawn = np.where(norm > 0, norm, np.nan) if largest > 0 else norm  # zero has no place on a logarithmic axis
    for i, row in enumerate(drawn):
        strong = i == worst
        axes.plot(run.t, row, color=WORST if strong else colour(0), lw=1.6 if strong else 0.9,
                  alpha=1.0 if strong else 0.6, marker="." if run.discrete else None, ms=3, zorder=3 if strong else 2)
    if largest > 0:
        axes.set_yscale("log")
        axes.set_ylim(bottom=max(FLOOR * largest, float(norm[norm > 0].min()) / 2))
    axes.set_ylabel(r"norm of the state $\|x\|$")
    axes.set_xlabel(time_label(run))
    axes.grid(True, color="0.92")


def time_label(run: Trajectory) -> str:
    """Return what the time axis counts: steps when the period is 1, seconds otherwise."""
    steps = run.discrete and (run.t.size < 2 or bool(np.allclose(np.diff(run.t), 1.0)))
    return "step $k$" if steps else "time $t$ in s"


def _motions(values: Array) -> Array:
    return values[:, None, :] if values.ndim == 2 else values


def _draw(axes: Any, run: Trajectory, values: Array, symbol: str, worst: int | None) -> None:
    values = _motions(values)
    held = symbol == "u" and run.discrete  # an input is held over the step, a state is not
    count, motions = values.shape[:2]
    quiet = 0.45 if worst is not None else 0.9
    for i in range(count):
        for j in range(motions):
            strong = j == worst or motions == 1
            axes.plot(run.t, values[i, j], color=colour(i), lw=2.0 if strong else 0.9, alpha=1.0 if strong else quiet,
                      drawstyle="steps-post" if held else "default", zorder=3 if strong else 2,
                      marker="." if run.discrete and not held else None, ms=4 if strong else 2)
    if count > 1:
        named = [Line2D([], [], color=colour(i), lw=2, label=name_of(symbol, i, count)) for i in range(count)]
        axes.legend(handles=named[:MOST_NAMED], loc="best", fontsize="small", ncols=2 if count > 4 else 1)
    axes.set_xlabel(time_label(run))
    axes.grid(True, color="0.92")
    axes.set_axisbelow(True)
    axes.set_xlim(run.t[0], run.t[-1])


def _draw_limits(axes: Any, limits: Any) -> None:
    """Dashed lines at the least and largest value of each input, with its figure; equal ones are drawn once.

    Where all inputs share their limits what lies beyond is hatched.
    """
    m = limits.dimension
    low, high = ends_of(limits)
    lines: dict[float, list[int]] = {}
    for i in range(m):
        for value in (float(low[i]), float(high[i])):
            lines.setdefault(round(value, 12), []).append(i)
    for value, inputs in lines.items():
        whose = "" if len(inputs) == m else ", ".join(name_of("u", i, m) for i in inputs) + " "
        shade = colour(inputs[0]) if m > 1 and len(inputs) < m else LIMIT
        limit_line(axes, value, f"{whose}limit ${value:.4g}$", shade)
    axes.margins(y=0.12)
    if len(lines) == 2:
        hatch_beyond(axes, min(lines), max(lines))


def ends_of(limits: Any) -> tuple[Array, Array]:
    """Return the least and the largest value (m,) of each input within a Box or Polytope.

    >>> from inc_casadi import Box
    >>> [end.tolist() for end in ends_of(Box([-1.0, -2.0], [3.0, 4.0]))]
    [[-1.0, -2.0], [3.0, 4.0]]
    """
    eye = np.eye(limits.dimension)
    return -np.asarray(limits.support(-eye)), np.asarray(limits.support(eye))


def limit_line(axes: Any, value: float, words: str, shade: str = LIMIT) -> None:
    """Draw a dashed line across at a limit, and what it is at its right end."""
    axes.axhline(value, color=shade, ls="--", lw=1.2, zorder=1.9)
    axes.annotate(words, (1.0, value), xycoords=("axes fraction", "data"), xytext=(-4, 3), textcoords="offset points",
                  ha="right", va="bottom", fontsize="small", color=shade, zorder=4,
                  bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 0.8})


def hatch_beyond(axes: Any, low: float, high: float) -> None:
    """Hatch what lies below `low` and above `high` up to the edges of the axes, which keep their limits."""
    bottom, top = axes.get_ylim()
    room = BAND * (high - low)
    bottom, top = min(bottom, low - room), max(top, high + room)
    for inner, outer in ((low, bottom), (high, top)):
        axes.axhspan(min(inner, outer), max(inner, outer), facecolor=tint(LIMIT, 0.06), edgecolor=tint(LIMIT, 0.35),
                     hatch="////", lw=0.0, zorder=0.6)
    axes.set_ylim(bottom, top)
