"""The figure of an alternation: the certified bound after each round, what was tried, and how far steps could go."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..errors import InvalidInputError
from ..figures import at_most
from .style import QUIET, colour, new_figure, tint, written

WIDE = 30.0  # ratio of bounds from which on the axis is logarithmic
TAKEN, DAMPED, NONE = "accepted", "refused, the step is damped", "refused: no certificate"


def plot_alternation(alternation: Any, path: str | Path | None = None, *, width: float | None = None,
                     dpi: float | None = None) -> Figure:
    """Return a Matplotlib figure of the BMI loop: its certified bound round by round, and the radius of its steps.

    Above: the bound after each round as a staircase that never rises within a rung; full circles are trials that were
    accepted, crosses those that were refused, after which the step is damped, triangles at the upper edge those without a
    certificate. Grounds tell the rungs of the multiplier apart; the dashed line is the bound of the start. Below: the radius
    of the trust region in which each step was sought. Rounds of the phase "feasibility" bound another cost, of a future
    that fades faster; they are hollow and dotted.

    alternation: what `alternate` returned, or anything with `history` of dict(round, phase, rung, bound, trial, accepted,
    radius) and `start_bound`; path: its ending chooses the format.
    width, dpi: of the figure and its file, in inches (the height in proportion) and dots per inch.

    Raises InvalidInputError when there is no round or a row lacks one of these.

    >>> from types import SimpleNamespace
    >>> rows = [dict(round=k, phase="cost", rung="sector", bound=b, trial=b, accepted=True, radius=0.5)
    ...         for k, b in enumerate((3.0, 2.0))]
    >>> figure = plot_alternation(SimpleNamespace(history=rows, start_bound=4.0))
    >>> figure.axes[0].lines[0].get_ydata().tolist()
    [4.0, 3.0, 2.0]
    """
    history = getattr(alternation, "history", None)
    if not history:
        raise InvalidInputError(f"there is nothing to draw: the history of this {type(alternation).__name__} has no round")
    wanted = {"round", "phase", "rung", "bound", "trial", "accepted", "radius"}
    missing = wanted - set(history[0])
    if missing:
        raise InvalidInputError(f"the rows of the history lack {', '.join(sorted(missing))}")
    figure = new_figure(8.4, 6.0)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1.0))
    _bounds(above, history, float(alternation.start_bound))
    _radii(below, history)
    above.set_title(_title(getattr(alternation, "certificate", None)), fontsize="medium")
    for axes in (above, below):
        _rungs(axes, history, axes is above)
        axes.set_xlim(-1.5, history[-1]["round"] + 0.5)
        axes.grid(True, axis="y", color="0.92")
        axes.set_axisbelow(True)
    below.set_xlabel("round")
    below.xaxis.get_major_locator().set_params(integer=True)
    return written(figure, path, width, dpi)


def _title(certificate: Any) -> str:
    if certificate is None:
        return "Alternation"
    if not certificate.holds():
        return "Alternation: nothing is certified"
    return f"Alternation: certified cost at most {at_most(certificate.bound)}"


def _bounds(axes: Any, history: Sequence[Any], start: float) -> None:
    cost = [row for row in history if row["phase"] == "cost"]
    _staircase(axes, cost, start)
    other = [row for row in history if row["phase"] != "cost"]
    if other:
        axes.plot([row["round"] for row in other], [row["bound"] for row in other], color=QUIET, ls=":", lw=1.4, marker="o",
                  mfc="white", ms=4, label="feasibility: of a future that fades faster")
    if np.isfinite(start):
        axes.axhline(start, color="black", ls="--", lw=1.1, label=f"start: at most {at_most(start)}")
    values = np.array([value for row in history for value in (row["bound"], row["trial"])] + [start], dtype=float)
    finite = values[np.isfinite(values)]
    wide = finite.size and finite.min() > 0 and finite.max() > WIDE * finite.min()
    axes.set_yscale("log" if wide else "linear")
    _trials(axes, history)
    axes.set_ylabel("certified cost")
    axes.margins(y=0.12)  # below, the names of the rungs
    axes.legend(fontsize="small", loc="best")


def _staircase(axes: Any, cost: Sequence[Any], start: float) -> None:
    if not cost:
        return
    first = [(cost[0]["round"] - 1, start)] if np.isfinite(start) else []
    at, bound = np.array(first + [(row["round"], row["bound"]) for row in cost], dtype=float).T
    axes.plot(at, bound, color=colour(0), lw=2.0, drawstyle="steps-post", zorder=3, label="certified bound after the round")


def _trials(axes: Any, history: Sequence[Any]) -> None:
    taken = [row for row in history if row["accepted"]]
    refused = [row for row in history if not row["accepted"] and np.isfinite(row["trial"])]
    lost = [row for row in history if not row["accepted"] and not np.isfinite(row["trial"])]
    for rows, marker, shade, words in ((taken, "o", colour(2), TAKEN), (refused, "x", colour(1), DAMPED)):
        if rows:
            axes.plot([row["round"] for row in rows], [row["trial"] for row in rows], marker, color=shade, ms=6, mew=1.8,
                      ls="", zorder=4, label=words)
    if lost:
        axes.plot([row["round"] for row in lost], np.full(len(lost), 0.96), "^", color=colour(1), ms=7, mfc="white", mew=1.6,
                  ls="", zorder=4, label=NONE, transform=axes.get_xaxis_transform())


def _radii(axes: Any, history: Sequence[Any]) -> None:
    at = np.array([row["round"] for row in history])
    radius = np.array([row["radius"] for row in history], dtype=float)
    taken = np.array([bool(row["accepted"]) for row in history])
    axes.plot(at, radius, color=QUIET, lw=1.0, zorder=2)
    axes.plot(at[taken], radius[taken], "o", color=colour(2), ms=6, zorder=3)
    axes.plot(at[~taken], radius[~taken], "x", color=colour(1), ms=6, mew=1.8, zorder=3)
    axes.set_yscale("log")
    axes.set_ylabel("radius of step")


def _rungs(axes: Any, history: Sequence[Any], named: bool) -> None:
    rungs = [row["rung"] for row in history]
    edges = [0] + [k for k in range(1, len(rungs)) if rungs[k] != rungs[k - 1]] + [len(rungs)]
    for i, (first, last) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
        left, right = history[first]["round"] - 0.5, history[last - 1]["round"] + 0.5
        if i % 2:
            axes.axvspan(left, right, color=tint(QUIET, 0.12), lw=0, zorder=0)
        if named:
            axes.annotate(rungs[first], (left, 0.0), (4, 4), xycoords=("data", "axes fraction"), fontsize="small",
                          color=QUIET, textcoords="offset points")
