"""The figure of a training or of a whole synthesis: cost against iterations, seconds by phase, what attempts came to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..errors import InvalidInputError
from ..figures import at_most
from .style import DASHES, MARKERS, QUIET, colour, new_figure, say_in, tint, written

WIDE = 30.0  # ratio of costs from which on the axis is logarithmic
FULL, HOLLOW = "certified cost", "simulated, two standard errors"


def plot_training(training: Any, path: str | Path | None = None, *, width: float | None = None,
                  dpi: float | None = None) -> Figure:
    """Return a Matplotlib figure of how a law was found: of a `Training`, or of all attempts of a `Result`.

    A Training: the cost after each iteration, one line for each phase, since phases count on nodes and horizons of their
    own; across, the estimates for start and outcome on nodes that no phase saw; beside it, the seconds of each phase. All of
    these are simulation. A Result: the cost of each attempt that was trained against its seconds; what the attempts came
    to, certified costs full and simulated ones hollow; the seconds of each phase.

    training: anything with `history` of dict(phase, iteration, cost, seconds), `cost` and `start_cost`; or a Result, whose
    `history` holds attempts. path: its ending chooses the format.
    width, dpi: of the figure and its file, in inches (the height in proportion) and dots per inch.

    Raises InvalidInputError when the history is empty or of neither kind.

    >>> from types import SimpleNamespace
    >>> rows = [{"phase": "coarse", "iteration": i, "cost": 3.0 - i, "seconds": 0.1 * i} for i in range(3)]
    >>> figure = plot_training(SimpleNamespace(history=rows, cost=1.1, start_cost=3.2))
    >>> figure.axes[0].lines[0].get_ydata().tolist()
    [3.0, 2.0, 1.0]
    """
    history = getattr(training, "history", None)
    if not history:
        raise InvalidInputError(f"there is nothing to draw: the history of this {type(training).__name__} is empty")
    if isinstance(history[0], Mapping):
        if not {"phase", "iteration", "cost", "seconds"} <= set(history[0]):
            raise InvalidInputError(f"the history has {', '.join(sorted(history[0]))}, but phase, iteration, cost and "
                                    f"seconds are drawn; of an Alternation, see plot_alternation")
        return written(_of_training(training), path, width, dpi)
    if not hasattr(history[0], "verdict"):
        raise InvalidInputError(f"the history holds {type(history[0]).__name__}, but rows of a Training or attempts of a "
                                f"Result are drawn")
    return written(_of_result(training), path, width, dpi)


def phases_of(history: Sequence[Mapping[str, Any]]) -> list[tuple[str, np.ndarray, np.ndarray, float]]:
    """Return for each phase in turn its name, iterations counted from the very first, costs, and the seconds it took.

    A phase's iteration 0 is its start, the law that the phase before ended with. A phase of the same name that begins
    anew (its iterations start over) is one of its own.

    >>> rows = [{"phase": p, "iteration": i, "cost": 1.0, "seconds": s} for p, i, s in
    ...         (("a", 0, 0.5), ("a", 1, 1.0), ("b", 0, 1.5), ("b", 1, 3.0))]
    >>> [(name, at.tolist(), seconds) for name, at, _, seconds in phases_of(rows)]
    [('a', [0, 1], 1.0), ('b', [1, 2], 2.0)]
    """
    found: list[tuple[str, np.ndarray, np.ndarray, float]] = []
    begin, elapsed = 0, 0.0
    starts = [0] + [k for k in range(1, len(history)) if history[k]["phase"] != history[k - 1]["phase"]
                    or history[k]["iteration"] <= history[k - 1]["iteration"]]
    for first, last in zip(starts, [*starts[1:], len(history)], strict=True):
        rows = history[first:last]
        at = begin + np.array([int(row["iteration"]) for row in rows])
        seconds = float(rows[-1]["seconds"])
        found.append((str(rows[0]["phase"]), at, np.array([float(row["cost"]) for row in rows]), seconds - elapsed))
        begin, elapsed = int(at[-1]), seconds
    return found


def _of_training(training: Any) -> Figure:
    figure = new_figure(10.0, 4.4)
    left, right = figure.subplots(1, 2, width_ratios=(2.2, 1.0))
    phases = phases_of(training.history)
    for i, (name, at, cost, _) in enumerate(phases):
        left.plot(at, np.where(np.isfinite(cost), cost, np.nan), color=colour(i), ls=DASHES[i % len(DASHES)], lw=1.8,
                  marker=MARKERS[i % len(MARKERS)], ms=4, mfc="white", label=f"phase {name!r}")
    for value, words, dashes in ((training.start_cost, "start", ":"), (training.cost, "outcome", "--")):
        if np.isfinite(value):
            left.axhline(value, color="black", ls=dashes, lw=1.2, label=f"{words}, on unseen nodes: {value:.6g}")
    _cost_axis(left, [value for _, _, cost, _ in phases for value in cost])
    left.set_xlabel("iteration, all phases")
    left.set_title("Training: estimated cost, not a proof", fontsize="medium")
    left.legend(fontsize="small")
    left.xaxis.get_major_locator().set_params(integer=True)
    _seconds(right, [(name, seconds) for name, _, _, seconds in phases])
    return figure


def _of_result(result: Any) -> Figure:
    attempts = result.history
    figure = new_figure(12.0, 2.6 + 0.45 * max(len(attempts), 3))
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.5, 1.6, 1.0))
    _courses(left, attempts)
    _outcomes(middle, attempts)
    _seconds(right, [(name, float(value)) for name, value in result.seconds.items() if name != "in all"])
    return figure


def _courses(axes: Any, attempts: Sequence[Any]) -> None:
    trained = [(i, one) for i, one in enumerate(attempts) if one.training]
    if not trained:
        say_in(axes, "no attempt was trained")
        return
    for i, one in trained:
        seconds, cost = np.array(one.training, dtype=float).T
        axes.plot(seconds, np.where(np.isfinite(cost), cost, np.nan), color=colour(i), ls=DASHES[i % len(DASHES)], lw=1.6,
                  marker=MARKERS[i % len(MARKERS)], ms=4, mfc="white", label=_short(one.name))
    _cost_axis(axes, [cost for _, one in trained for _, cost in one.training])
    axes.set_xlabel("seconds of training")
    axes.set_title("Training: estimated cost", fontsize="medium")
    axes.legend(fontsize="small")


def _outcomes(axes: Any, attempts: Sequence[Any]) -> None:
    labels, values, handles = [], [], {}
    for y, one in enumerate(attempts):
        certified = one.verdict.cost if one.certified else np.nan
        run, words = one.estimate, "nothing is certified"
        if run is not None and np.isfinite(run.mean):
            handles[HOLLOW] = axes.errorbar(run.mean, y, xerr=2 * run.standard_error, fmt=MARKERS[0], mfc="white", ms=6,
                                            color=QUIET, capsize=4)
            values.append(run.mean)
        if np.isfinite(certified):
            handles[FULL], = axes.plot(certified, y, "D", color=colour(2), mec="black", ms=8, ls="", zorder=4)
            values.append(certified)
            words = f"at most {at_most(certified)}"
        labels.append(f"{_short(one.name)}\n{words}")
    axes.set_yticks(range(len(attempts)), labels, fontsize="small")
    axes.set_ylim(max(len(attempts), 3) - 0.4, -0.6)
    _scaled(axes, "x", values)
    axes.set_xlabel("expected discounted cost")
    axes.set_title("Attempts, in their order", fontsize="medium")
    axes.grid(True, axis="x", color="0.92")
    axes.set_axisbelow(True)
    axes.margins(x=0.15)
    if handles:
        axes.legend(list(handles.values()), list(handles), fontsize="small", loc="lower right")


def _seconds(axes: Any, phases: Sequence[tuple[str, float]]) -> None:
    for y, (_, seconds) in enumerate(phases):
        axes.barh(y, seconds, height=0.6, color=tint(colour(0), 0.35), edgecolor=colour(0), lw=1.0)
        axes.annotate(f"{seconds:.2g} s", (seconds, y), (4, 0), textcoords="offset points", va="center", fontsize="small")
    axes.set_yticks(range(len(phases)), [name for name, _ in phases], fontsize="small")
    axes.set_ylim(max(len(phases), 4) - 0.4, -0.6)
    axes.set_xlim(0.0, 1.3 * max([seconds for _, seconds in phases] + [1e-9]))
    axes.set_xlabel("seconds")
    axes.set_title("Time by phase", fontsize="medium")
    axes.grid(True, axis="x", color="0.92")
    axes.set_axisbelow(True)


def _cost_axis(axes: Any, values: Sequence[float]) -> None:
    _scaled(axes, "y", values)
    axes.set_ylabel("discounted cost")
    axes.grid(True, color="0.92")
    axes.set_axisbelow(True)


def _scaled(axes: Any, which: str, values: Sequence[float]) -> None:
    """A logarithmic axis where finite positive values span a wide factor."""
    finite = np.array([value for value in values if np.isfinite(value)])
    if finite.size and finite.min() > 0 and finite.max() > WIDE * finite.min():
        (axes.set_xscale if which == "x" else axes.set_yscale)("log")


def _short(name: str) -> str:
    return name if len(name) <= 28 else name[:27] + "…"
