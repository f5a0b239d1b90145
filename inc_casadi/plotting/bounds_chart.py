"""The bar chart of costs with what classes of controllers cost at least as lines across it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .cost_panel import ABOUT, AT_LEAST, AT_MOST, FOUND, Row, rounded
from .style import QUIET, canvas, colour, say_in, tint, written

LINES = ((colour(7), "-"), (colour(0), (0, (5, 2))), (colour(3), (0, (1, 1.2))), (colour(5), "-."))
SHADES = {AT_MOST: colour(2), FOUND: colour(1), ABOUT: colour(4)}
BAR, LABEL = 0.62, 0.62  # height of a bar, and of the line that names a bound, in rows
LOG_FROM = 30.0  # ratio of the figures from which on the axis is logarithmic


def plot_bounds(rows: Sequence[Row], title: str = "", path: str | Path | None = None, *, ax: Any = None,
                width: float | None = None, dpi: float | None = None) -> Figure:
    """Return a Matplotlib figure of costs as bars and lower bounds as lines; see `draw_bounds`.

    rows: any order; title: above the chart; path: where to write it, the ending chooses the format; ax:
    Matplotlib axes to draw into, whose figure is returned.
    width, dpi: of the figure and its file, in inches (the height in proportion) and dots per inch.

    >>> figure = plot_bounds([Row("linear controllers", 0.4166, AT_LEAST), Row("clipped law", 0.3612, AT_MOST)])
    >>> [text.get_text().replace("\\n", ", ") for text in figure.axes[0].get_yticklabels()]
    ['clipped law, at most 0.3612']
    """
    figure, axes = canvas(ax, 7.2, 1.6 + 0.55 * len(rows))
    draw_bounds(axes, rows)
    axes.set_title(title, fontsize="medium")
    return written(figure, path, width, dpi)


def draw_bounds(axes: Any, rows: Sequence[Row]) -> None:
    """Draw a bar for each cost and, for each lower bound, a line across the bars with its name and figure on top.

    rows: AT_LEAST are the lines; AT_MOST (certified), FOUND and ABOUT (with two standard errors) the bars, told apart by
    colour and hatching. A bar of the class that a line speaks of never ends left of it.
    """
    costs = [row for row in rows if row.kind != AT_LEAST and np.isfinite(row.value)]
    floors = sorted((row for row in rows if row.kind == AT_LEAST and np.isfinite(row.value)), key=lambda row: -row.value)
    if not costs and not floors:
        say_in(axes, "no cost is known")
        return
    low, high = _scale(axes, [row.value + row.error for row in (*costs, *floors)])
    for y, row in enumerate(costs):
        _bar(axes, y, row, low)
    for index, row in enumerate(floors):
        _line(axes, index, row, len(costs), (low, high))
    axes.set_yticks(range(len(costs)), [row.label for row in costs], fontsize="small")
    axes.set_ylim(len(costs) - 0.5, -0.7 - LABEL * max(len(floors), 1))
    axes.set_xlabel("expected discounted cost")
    axes.grid(True, axis="x", color="0.92")
    axes.set_axisbelow(True)


def _scale(axes: Any, values: list[float]) -> tuple[float, float]:
    # The axis begins at 0, as bars ask for, unless the figures are of different sizes.
    least, most = min(values), max(values)
    log = least > 0 and most > LOG_FROM * least
    low, high = (least / 2, 2 * most) if log else (min(0.0, 1.1 * least), 1.12 * most if most > 0 else 1.0)
    axes.set_xscale("log" if log else "linear")
    axes.set_xlim(low, high)
    return low, high


def _bar(axes: Any, y: int, row: Row, low: float) -> None:
    shade = SHADES[row.kind]
    axes.barh(y, row.value - min(low, row.value), left=min(low, row.value), height=BAR, color=tint(shade, 0.45),
              edgecolor=shade, lw=1.4, hatch=None if row.kind == AT_MOST else "////")
    if row.error:
        axes.errorbar(row.value, y, xerr=row.error, color=QUIET, capsize=4, lw=1.5)


def _line(axes: Any, index: int, row: Row, bars: int, ends: tuple[float, float]) -> None:
    shade, dashes = LINES[index % len(LINES)]
    top = -0.62 - LABEL * index - LABEL / 2
    axes.plot([row.value, row.value], [bars - 0.5, top - 0.2], color=shade, ls=dashes, lw=2.0, zorder=3)
    left, right = axes.transData.transform([(end, 0.0) for end in ends])[:, 0]
    far = axes.transData.transform((row.value, 0.0))[0] > left + 0.58 * (right - left)
    axes.annotate(f"{row.name}: at least {rounded(row.value, AT_LEAST)}", (row.value, top), xytext=(-5 if far else 5, 0),
                  textcoords="offset points", ha="right" if far else "left", va="center", fontsize="small", color=shade,
                  bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 0.6}, zorder=4)
