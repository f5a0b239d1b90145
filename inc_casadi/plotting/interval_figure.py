"""The interval chart of a comparison: within which costs each class's best member, and each law, is known to lie."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..comparison.comparison import label
from ..comparison.families import ANY, FAMILIES, LINEAR, STATIC, Family
from ..comparison.row import SIMULATED, VIOLATED
from ..figures import at_least, at_most
from .outlines import legend_beside
from .style import QUIET, canvas, colour, say_in, tint, written

WIDE = 30.0  # ratio of the figures from which on the axis is logarithmic
PROVED, CHECKED, SAMPLED, OPEN = "proved", "certified in floats", "simulated, two standard errors", "not certified"
BREAKS = "breaks the input limits"
FACES = {PROVED: ("D", "full"), CHECKED: ("D", "left"), SAMPLED: ("o", "none"), OPEN: ("D", "none"), BREAKS: ("x", "full")}
SHADES = {ANY: colour(0), LINEAR: colour(1), STATIC: colour(2)}
HATCHES = {ANY: "", LINEAR: "////", STATIC: "xxxx"}
BAR = 0.34


@dataclass(frozen=True)
class Interval:
    """One line of the chart: name; low, high: NaN where there is none; family: whose colour it has; how each end is known.

    of_class: whether it is a class's, whose best member costs at least `low`, or a law's, where `low` bounds any controller;
    error: two standard errors of a simulated `high`.
    """

    name: str
    low: float
    high: float
    family: Family
    low_how: str
    high_how: str
    of_class: bool = False
    error: float = 0.0

    @property
    def label(self) -> str:
        """Name and figures, each rounded to the side on which it stays true."""
        parts = [f"at least {at_least(self.low)}"] if self.of_class else []
        if self.high_how == SAMPLED and np.isfinite(self.high):
            parts.append(f"about {self.high:.5g} ± {self.error:.2g}")
        elif np.isfinite(self.high):
            parts.append(f"at most {at_most(self.high)}" if self.high_how in (PROVED, CHECKED) else f"{self.high:.7g}")
        return f"{self.name}\n" + (", ".join(parts) or "no finite cost is known")


def plot_intervals(comparison: Any, path: str | Path | None = None, *, ax: Any = None, width: float | None = None,
                   dpi: float | None = None) -> Figure:
    """Return a Matplotlib figure of intervals of costs: of each controller, and of the best member of each class.

    A controller's interval goes from the lower bound on any controller to its own certified cost: the best possible lies in
    it, and its width is what is left to win. A class's goes from its lower bound to the cheapest certified member that is
    known: the best member of the class lies in it. Intervals without an upper end fade out to the right. A full diamond is
    an end that was proved rigorously, a half one is certified in floats, a hollow one is not certified, a circle with two
    standard errors a simulation. The axis is logarithmic when the figures span a factor above 30.

    comparison: what `compare` returned (`.proved()` of it shows full diamonds), or a Result; path: its ending chooses the
    format; ax: Matplotlib axes to draw into, whose figure is returned.
    width, dpi: of the figure and its file, in inches (the height in proportion) and dots per inch.

    >>> from inc_casadi import INC, Box, Plant, Spec, compare
    >>> plant, spec = Plant(1.5, 1.0), Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-1, 1))
    >>> found = compare(plant, spec, {"clipped": INC.saturated([[-1.5]], 1.0)}, bounds=["linear"])
    >>> figure = plot_intervals(found)
    >>> [text.get_text() for text in figure.axes[0].get_yticklabels()]
    ['clipped\\nat most 0.3583334', 'best of linear controllers\\nat least 0.4083333']
    """
    found = comparison.comparison() if hasattr(comparison, "comparison") else comparison
    rows = intervals(found)
    figure, axes = canvas(ax, 8.6, 1.7 + 0.55 * max(len(rows), 3))
    values = np.array([value for row in rows for value in (row.low, row.high, row.high + row.error)])
    values = values[np.isfinite(values)]
    if not values.size:
        say_in(axes, "neither a cost nor a bound is known")
        return written(figure, path, width, dpi)
    low, high, log = _range(values)
    axes.set_xscale("log" if log else "linear")
    axes.set_xlim(low, high)
    for y, row in enumerate(rows):
        _draw(axes, y, row, high)
    axes.set_yticks(range(len(rows)), [row.label for row in rows], fontsize="small")
    axes.set_ylim(len(rows) - 0.4, -0.6)
    laws = len(found.rows)
    if 0 < laws < len(rows):
        axes.axhline(laws - 0.5, color=QUIET, lw=0.8)
    axes.set_xlabel("expected discounted cost" + ("" if low <= 0 or log else " (the axis does not begin at 0)"))
    axes.grid(True, axis="x", color="0.92")
    axes.set_axisbelow(True)
    axes.set_title("Where the best possible cost lies: for each law, for each class", fontsize="medium")
    legend_beside(axes, _legend(rows), 3, ax is None)
    return written(figure, path, width, dpi)


def intervals(comparison: Any) -> list[Interval]:
    """Return the lines of the chart: the controllers of the comparison in their order, then the classes.

    A class is listed when it has a lower bound of its own, or a certified member besides that of a larger class.
    """
    classes = []
    for family in FAMILIES.values():
        floor = comparison.floor(family)
        member = any(row.family is family and comparison.certifies(row.name) for row in comparison.rows)
        if floor is not None and (floor.family is family or member):
            classes.append(_of_class(comparison, family))
    return [_of_law(comparison, row) for row in comparison.rows] + classes


def _of_law(comparison: Any, row: Any) -> Interval:
    floor = comparison.floor(ANY)
    certified = comparison.certifies(row.name)
    low = floor.value if floor is not None and certified else np.nan
    how = OPEN if row.limits.verdict != VIOLATED else BREAKS
    if certified:
        how = _settled(comparison, row.name)
    elif how == OPEN and row.cost.how == SIMULATED:
        how = SAMPLED
    return Interval(row.name, low, comparison.cost_of(row.name) if certified else row.cost.value, row.family,
                    OPEN if floor is None else _settled(comparison, label(floor)), how, False, 2 * row.cost.error)


def _of_class(comparison: Any, family: Family) -> Interval:
    floor = comparison.floor(family)
    costs = {row.name: comparison.cost_of(row.name) for row in comparison.rows if family.contains(row.family)}
    best = min(costs, key=lambda name: costs[name], default="")
    high = costs.get(best, np.inf)
    name = "best possible" if family is ANY else f"best of {family.title}"
    return Interval(name, floor.value, high if np.isfinite(high) else np.nan, family,
                    _settled(comparison, label(floor)), _settled(comparison, best) if np.isfinite(high) else OPEN, True)


def _settled(comparison: Any, name: str) -> str:
    return PROVED if comparison.proofs.get(name) else CHECKED


def _range(values: np.ndarray) -> tuple[float, float, bool]:
    """Return the ends of the axis, and whether it is logarithmic."""
    least, most = float(values.min()), float(values.max())
    if least > 0 and most > WIDE * least:
        return least / 1.6, 2.0 * most, True
    span = max(most - least, 0.05 * abs(most)) or 1.0
    return least - 0.15 * span, most + 0.2 * span, False


def _draw(axes: Any, y: int, row: Interval, end: float) -> None:
    shade = SHADES[row.family]
    known = np.isfinite(row.low), np.isfinite(row.high)
    if known[0]:
        right = row.high if known[1] else end
        axes.barh(y, right - row.low, left=row.low, height=BAR, facecolor=tint(shade, 0.3 if known[1] else 0.12),
                  edgecolor=tint(shade, 0.7), hatch=HATCHES[row.family], lw=0.0, zorder=2)
        edge = shade if row.of_class else SHADES[ANY]  # a law's interval begins at the bound on any controller
        axes.plot([row.low, row.low], [y - 0.32, y + 0.32], color=edge, lw=2.4, solid_capstyle="butt", zorder=3,
                  ls="-" if row.low_how == PROVED else (0, (2, 1)))
        if not known[1]:
            axes.plot(end, y, ">", color=shade, ms=6, clip_on=False, zorder=3)
    if known[1]:
        if row.error:
            axes.errorbar(row.high, y, xerr=row.error, color="black", capsize=5, lw=1.4, zorder=4)
        axes.plot(row.high, y, **_mark(row.high_how), zorder=5)


def _mark(how: str) -> dict[str, Any]:
    marker, style = FACES[how]
    face = "white" if style == "none" else "black"
    return {"marker": marker, "fillstyle": "full" if style == "none" else style, "ms": 7.5, "ls": "", "color": "black",
            "mec": "black", "mew": 2.0 if how == BREAKS else 1.0, "markerfacecoloralt": "white", "mfc": face}


def _legend(rows: list[Interval]) -> list[Any]:
    families = dict.fromkeys(row.family for row in rows)
    kinds = [kind for kind in FACES if any(row.high_how == kind and np.isfinite(row.high) for row in rows)]
    lows = [kind for kind in (PROVED, CHECKED) if any(row.low_how == kind and np.isfinite(row.low) for row in rows)]
    return [Patch(facecolor=tint(SHADES[one], 0.3), edgecolor=SHADES[one], hatch=HATCHES[one],
                  label=f"class: {one.title}") for one in families] + [
        Line2D([], [], color=QUIET, lw=2.4, ls="-" if kind == PROVED else (0, (2, 1)), label=f"lower bound, {kind}")
        for kind in lows] + [
        Line2D([], [], label=kind if kind == BREAKS else f"cost, {kind}", **_mark(kind)) for kind in kinds]
