"""The interval chart of costs: what competitors cannot beat, what is proved, what was simulated, what was found."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Context
from typing import Any

import numpy as np

from ..figures import at_least, at_most
from .style import colour, say_in, tint

AT_LEAST, AT_MOST, ABOUT, FOUND = "at least", "at most", "about", "found"
FEWEST_LINES = 5  # so that few rows do not make thick bars
COLOURS = {AT_LEAST: colour(0), AT_MOST: colour(2), ABOUT: colour(4), FOUND: colour(1)}


@dataclass(frozen=True)
class Row:
    """One line of the chart. kind: AT_LEAST, AT_MOST, ABOUT (with two standard errors) or FOUND; error: half width."""

    name: str
    value: float
    kind: str
    error: float = 0.0

    @property
    def label(self) -> str:
        """Name and figure, rounded so that the statement stays true."""
        if self.kind == ABOUT:
            return f"{self.name}\nabout {self.value:.5g} ± {self.error:.2g}"
        digits = rounded(self.value, self.kind)
        return f"{self.name}\n{digits}" if self.kind == FOUND else f"{self.name}\n{self.kind} {digits}"


def rows_of(result: Any) -> list[Row]:
    """Return the lines of a result: lower bounds that hold, certified and simulated cost, best linear costs found."""
    rows = [Row(name, float(bound), AT_LEAST) for name, bound in result.bounds.items() if bound.holds()]
    rows.append(Row("this controller, certified", float(result.cost), AT_MOST))
    if result.estimate is not None:
        error = 2 * float(result.estimate.standard_error)
        rows.append(Row("this controller, simulated", float(result.estimate.mean), ABOUT, error))
    rows += [Row(f"{name}, found", float(value), FOUND) for name, value in result.linear.items()]
    return [row for row in rows if np.isfinite(row.value)]


def draw_costs(axes: Any, rows: list[Row]) -> None:
    """Draw one line per row: bounds as a mark with a bar over the costs that remain possible, figures as a mark."""
    if not rows:
        say_in(axes, "no cost is known")
        return
    values = np.array([row.value for row in rows])
    low, high, log = _range(values, np.array([row.error for row in rows]))
    for y, row in enumerate(rows):
        shade = COLOURS[row.kind]
        if row.kind in (AT_LEAST, AT_MOST):
            left, right = (row.value, high) if row.kind == AT_LEAST else (low, row.value)
            axes.barh(y, right - left, left=left, height=0.5, color=tint(shade, 0.22), edgecolor="none")
            axes.plot([row.value, row.value], [y - 0.32, y + 0.32], color=shade, lw=2.5, solid_capstyle="butt")
            if row.kind == AT_LEAST:
                axes.plot(high, y, ">", color=shade, ms=6, clip_on=False)
        else:
            axes.errorbar(row.value, y, xerr=row.error or None, fmt="o" if row.kind == ABOUT else "D", color=shade,
                          ms=4 if row.kind == ABOUT else 6, capsize=5, lw=1.8)
    axes.set_yticks(range(len(rows)), [row.label for row in rows], fontsize="small")
    axes.set_ylim(max(len(rows), FEWEST_LINES) - 0.4, -0.6)
    axes.set_xscale("log" if log else "linear")
    axes.set_xlim(low, high)
    axes.set_xlabel("expected discounted cost" + ("" if low <= 0 or log else " (the axis does not begin at 0)"))
    axes.grid(True, axis="x", color="0.92")
    axes.set_axisbelow(True)


def _range(values: np.ndarray, errors: np.ndarray) -> tuple[float, float, bool]:
    """Return the ends of the axis and whether it is logarithmic: from 0 unless the figures are close to each other."""
    low, high = float(np.min(values - errors)), float(np.max(values + errors))
    if low > 0 and high > 30 * low:
        return low / 2, 2 * high, True
    span = high - low
    if span > 0 and low > 0.6 * high:
        return low - 0.6 * span, high + 0.3 * span, False
    return min(0.0, 1.1 * low), 1.12 * high if high > 0 else 1.0, False


def rounded(value: float, kind: str) -> str:
    """Return a figure in seven digits: an "at least" rounded down, an "at most" rounded up, others to the nearest.

    >>> rounded(1.36496190, AT_MOST), rounded(1.36496195, AT_LEAST)
    ('1.364962', '1.364961')
    """
    if kind == AT_LEAST:
        return at_least(value)
    return at_most(value) if kind == AT_MOST else f"{Context(prec=7).create_decimal_from_float(value).normalize():f}"
