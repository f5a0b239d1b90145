"""The chart of a comparison: what each controller costs, and what no member of its class can reach."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..comparison.families import ANY, LINEAR, STATIC, Family
from ..comparison.row import SIMULATED, UPPER, VIOLATED, Row
from ..comparison.table import figure, how
from ..figures import at_least
from .outlines import legend_beside
from .style import QUIET, canvas, colour, say_in, tint, written

COLOURS = {ANY: colour(0), LINEAR: colour(1), STATIC: colour(2)}
HATCHES = {ANY: "", LINEAR: "//", STATIC: "xx"}
BLACK, MARK = colour(7), 7.5
SURE, UNSURE, ABOVE = "cost, certified up to rounding", "cost, not certified", "upper bound of the cost"
SAMPLED, BREAKS = "simulated, two standard errors", "breaks the input limits"
MARKS = {SURE: ("D", BLACK, BLACK, 1.0), UNSURE: ("D", "white", BLACK, 1.0), ABOVE: ("<", BLACK, BLACK, 1.0),
         SAMPLED: ("o", "white", BLACK, 1.0), BREAKS: ("x", QUIET, QUIET, 2.0)}
WIDE, NARROW = 30.0, 0.05  # a wider factor takes a logarithmic axis; a smaller share is not magnified


def plot_comparison(comparison: Any, path: str | Path | None = None, *, ax: Any = None, width: float | None = None,
                    dpi: float | None = None) -> Figure:
    """Return a Matplotlib figure of a `Comparison`, written to `path` when given.

    One line per controller, those of the widest class first. Shaded is what the lower bounds exclude for the class of
    that controller; a dashed line carries the bound of each class through the lines of all, so that a mark left of it is a
    controller that the class cannot match. A filled mark is a cost known up to rounding, a bar ending in a mark an upper
    bound, a hollow mark with two standard errors a simulation, a cross the cost of a controller that breaks the limits.

    comparison: what `compare` returns. path: its ending chooses the format, such as .png, .pdf or .svg; ax: Matplotlib
    axes to draw into, whose figure is returned.
    width, dpi: of the figure and its file, in inches (the height in proportion) and dots per inch.
    """
    rows = sorted(comparison.rows, key=lambda row: -row.family.rank)
    drawing, axes = canvas(ax, 10.5, 1.9 + 0.55 * max(len(rows), 3))
    bounds = {family: found.value for family in COLOURS if (found := comparison.floor(family)) is not None}
    costs = [_end(row) for row in rows if np.isfinite(row.cost.value)]
    if not costs and not bounds:
        say_in(axes, "neither a cost nor a bound is known")
        return written(drawing, path, width, dpi)
    low, high, log = _range(np.array([*costs, *(row.cost.value for row in rows if np.isfinite(row.cost.value)),
                                      *bounds.values()]))
    for y, row in enumerate(rows):
        _draw_zone(axes, y, row, comparison.floor(row.family), low)
        _draw_cost(axes, y, row, comparison.floor(row.family), low)
    _draw_bounds(axes, comparison)
    axes.set_yticks(range(len(rows)), [_label(comparison, row) for row in rows], fontsize="small")
    axes.set_ylim(max(len(rows), 1) - 0.4, -0.6)
    axes.set_xscale("log" if log else "linear")
    axes.set_xlim(low, high)
    axes.set_xlabel("expected discounted cost" + ("" if low <= 0 or log else " (the axis does not begin at 0)"))
    axes.set_title("Costs, and (shaded) what no controller of that class can reach", fontsize="medium")
    legend_beside(axes, _legend(comparison, rows), 3, ax is None)
    return written(drawing, path, width, dpi)


def _end(row: Row) -> float:
    return row.cost.value + 2 * row.cost.error


def _range(values: np.ndarray) -> tuple[float, float, bool]:
    """Return the ends of the axis, and whether it is logarithmic."""
    least, most = float(np.min(values)), float(np.max(values))
    if least > 0 and most > WIDE * least:
        return least / 1.6, 1.6 * most, True
    span = max(most - least, NARROW * abs(most)) or 1.0
    return least - 0.25 * span, most + 0.15 * span, False


def _draw_zone(axes: Any, y: int, row: Row, floor: Any, low: float) -> None:
    if floor is None or floor.value <= low:
        return
    family = floor.family
    axes.barh(y, floor.value - low, left=low, height=0.84, color=tint(COLOURS[family], 0.28), hatch=HATCHES[family],
              edgecolor=tint(COLOURS[family], 0.6), linewidth=0.0, zorder=1)


def _draw_cost(axes: Any, y: int, row: Row, floor: Any, low: float) -> None:
    cost = row.cost
    if not np.isfinite(cost.value):
        words = "the cost is infinite" if cost.value == np.inf else "no cost is known"
        axes.annotate(words, (1, y), (-6, 0), xycoords=("axes fraction", "data"), textcoords="offset points", ha="right",
                      va="center", color=QUIET, fontsize="small", backgroundcolor="white", zorder=5)
        return
    kind = _kind(row)
    marker, face, edge, width = MARKS[kind]
    if kind == SAMPLED:
        axes.errorbar(cost.value, y, xerr=2 * cost.error, color=BLACK, capsize=5, zorder=4)
    elif kind == ABOVE:
        begin = low if floor is None else max(low, floor.value)
        axes.plot([begin, cost.value], [y, y], color=BLACK, lw=2.5, solid_capstyle="butt", zorder=3)
    face = "white" if kind == ABOVE and not row.certified else face
    axes.plot(cost.value, y, marker, ms=MARK, mfc=face, mec=edge, mew=width, zorder=4)


def _draw_bounds(axes: Any, comparison: Any) -> None:
    for floor in _distinct(comparison):
        axes.axvline(floor.value, color=COLOURS[floor.family], ls="--", lw=1.4, zorder=2)


def _distinct(comparison: Any) -> list[Any]:
    """The bounds that say something of their own: the highest for each class."""
    found = [comparison.floor(family) for family in COLOURS]
    return list(dict.fromkeys(floor for floor in found if floor is not None))


def _label(comparison: Any, row: Row) -> str:
    words = SIMULATED if row.cost.how == SIMULATED else how(comparison, row)
    known = "" if np.isnan(row.cost.value) else f"\n{figure(row)} {words}"
    return f"{row.name} ({row.kind}){known}"


def _legend(comparison: Any, rows: list[Row]) -> list[Any]:
    """The classes with their bounds, then the marks that occur."""
    zones = [_zone(floor.family, floor.value) for floor in _distinct(comparison)]
    return zones + [_mark(kind) for kind in MARKS if any(_kind(row) == kind for row in rows)]


def _zone(family: Family, value: float) -> Patch:
    return Patch(facecolor=tint(COLOURS[family], 0.28), edgecolor=COLOURS[family], hatch=HATCHES[family], ls="--",
                 label=f"{family.title}: at least {at_least(value)}")


def _kind(row: Row) -> str:
    """The words that the legend has for the mark of a row, or none."""
    if not np.isfinite(row.cost.value):
        return ""
    if row.limits.verdict == VIOLATED:
        return BREAKS
    if row.cost.how == SIMULATED:
        return SAMPLED
    if row.cost.how == UPPER:
        return ABOVE
    return SURE if row.certified else UNSURE


def _mark(kind: str) -> Line2D:
    marker, face, edge, width = MARKS[kind]
    return Line2D([], [], marker=marker, markerfacecolor=face, markeredgecolor=edge, markeredgewidth=width, linestyle="",
                  markersize=MARK, label=kind)
