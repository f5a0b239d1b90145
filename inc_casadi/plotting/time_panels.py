"""Panels over time: states, inputs with their limits, the size of the state."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from ..arrays import Array
from ..simulate import Trajectory
from .style import LIMIT, WORST, colour, name_of

MOST_NAMED = 8
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
    """Dashed lines at the least and largest value of each input, with its figure; equal ones are drawn once."""
    m = limits.dimension
    high, low = np.asarray(limits.support(np.eye(m))), -np.asarray(limits.support(-np.eye(m)))
    lines: dict[float, list[int]] = {}
    for i in range(m):
        for value in (float(low[i]), float(high[i])):
            lines.setdefault(round(value, 12), []).append(i)
    for value, inputs in lines.items():
        whose = "" if len(inputs) == m else ", ".join(name_of("u", i, m) for i in inputs) + " "
        shade = colour(inputs[0]) if m > 1 and len(inputs) < m else LIMIT
        axes.axhline(value, color=shade, ls="--", lw=1.2, zorder=1.9)
        axes.annotate(f"{whose}limit ${value:.4g}$", (1.0, value), xycoords=("axes fraction", "data"), xytext=(-4, 3),
                      textcoords="offset points", ha="right", va="bottom", fontsize="small", color=shade,
                      bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 0.8}, zorder=4)
    axes.margins(y=0.12)
