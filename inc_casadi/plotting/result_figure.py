"""The figure of a result: where it is proved, what the motions look like, what they cost, what competitors cost."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .cost_panel import AT_MOST, draw_costs, rounded, rows_of
from .motions import Motions, motions
from .plane_panels import draw_cost, draw_plane, regional_walk
from .style import new_figure, say_in, written
from .time_panels import draw_inputs, draw_norm, draw_states


def plot_result(result: Any, path: str | Path | None = None, *, width: float | None = None,
                dpi: float | None = None) -> Figure:
    """Return a Matplotlib figure of what `synthesize` found, written to `path` when given.

    Four panels. States: for two states the plane, with the initial set cut into the pieces of the regional proof, each
    coloured by the law that acts on it first, and the terminal ellipsoid; otherwise states against time. Inputs
    against time with their limits. Costs: lower bounds of competitors, certified cost, simulated cost with two
    standard errors, best linear costs found. Last, the exact cost from every starting point where the proof gives it
    (one or two states), otherwise the norm of the state against time.

    result: anything with plant, spec, inc, certificate, status, cost, estimate, bounds and linear; a discrete plant.
    path: its ending chooses the format, such as .png, .pdf or .svg. The figure does not belong to pyplot; it can be
    written with `figure.savefig`, and a notebook with `%matplotlib inline` shows it.
    width, dpi: of the figure and its file, in inches (the height in proportion) and dots per inch.
    """
    figure = new_figure(12.0, 8.6)
    (top_left, top_right), (low_left, low_right) = figure.subplots(2, 2)
    shown = motions(result) if result.inc is not None else None
    if shown is None:
        _draw_without_controller(top_left, top_right, low_right, result)
    else:
        _draw_motions(top_left, top_right, result, shown)
        _draw_last(low_right, result, shown)
    draw_costs(low_left, rows_of(result))
    low_left.set_title("Costs: bars are what remains possible", fontsize="medium")
    figure.suptitle(headline(result), fontsize="x-large")
    return written(figure, path, width, dpi)


def headline(result: Any) -> str:
    """Return the title: the status, and what it means for the cost."""
    if np.isfinite(result.cost):
        return f"{result.status}: expected cost at most {rounded(result.cost, AT_MOST)}"
    if result.inc is None:
        return f"{result.status}: no controller"
    run = result.estimate
    if run is None:
        return f"{result.status}: nothing is proved"
    simulated = f"simulated cost {run.mean:.5g}" if np.isfinite(run.mean) else "the simulation diverges"
    return f"{result.status}: {simulated}, nothing is proved"


def _draw_motions(left: Any, right: Any, result: Any, shown: Motions) -> None:
    if result.plant.n == 2:
        draw_plane(left, result, shown)
        if not left.get_title():
            left.set_title("Initial set and motions", fontsize="medium")
    else:
        draw_states(left, shown.run, shown.worst)
        left.set_title(f"States; thick: from the {shown.marked}", fontsize="medium")
    draw_inputs(right, shown.run, result.spec.inputs, shown.worst)
    right.set_title(f"Inputs; thick: from the {shown.marked}", fontsize="medium")


def _draw_last(axes: Any, result: Any, shown: Motions) -> None:
    walk = regional_walk(result)
    if walk is not None and result.plant.n <= 2:
        draw_cost(axes, result, walk)
    else:
        draw_norm(axes, shown.run, shown.worst)
        axes.set_title(f"Size of the state; black: from the {shown.marked}", fontsize="medium")


def _draw_without_controller(left: Any, right: Any, last: Any, result: Any) -> None:
    if result.plant.n == 2:
        draw_plane(left, result, None)
    else:
        say_in(left, "no controller, no motion")
    say_in(right, "no controller, no input")
    say_in(last, "no controller, no cost")
