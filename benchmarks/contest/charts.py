"""The suite in three pictures: costs above the bound, times, and who wins."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from matplotlib.figure import Figure

from inc_casadi.plotting.style import PALETTE, QUIET, new_figure, say_in, written

from .duels import ABSENT, LOSES, OPEN, OURS, TIES, WINS, duel
from .record import Entry, PlantRecord
from .settings import MEMORY, SYNTHESIZED

MARKERS = ("o", "s", "^", "v", "P", "X", "<", ">")
SMALLEST = 1e-6  # share above the bound from which on it is told apart from none
ROW, WIDTH = 0.34, 9.5  # inches
SPREAD = 0.6  # in rows, over which the marks of one plant are apart
SHADES = {WINS: PALETTE[0], TIES: PALETTE[5], LOSES: PALETTE[1], OPEN: "#BFBFBF", ABSENT: "#F2F2F2"}
HATCHES = {WINS: "", TIES: "//", LOSES: "xx", OPEN: "..", ABSENT: ""}
SAID = {WINS: "the INC costs less", TIES: "the same", LOSES: "more", OPEN: OPEN, ABSENT: ABSENT}


def draw_charts(records: Sequence[PlantRecord], folder: Path) -> list[Path]:
    """Write the three pictures into a folder, which is made when missing, and return where they are."""
    folder.mkdir(parents=True, exist_ok=True)
    charts: dict[str, Callable[..., Figure]] = {"costs.png": cost_chart, "times.png": time_chart, "wins.png": wins_chart}
    for name, draw in charts.items():
        draw(records, folder / name)
    return [folder / name for name in charts]


def names_in(records: Iterable[PlantRecord]) -> list[str]:
    """Return the names of all controllers, in the order of their first appearance.

    >>> from .sample import record
    >>> names_in([record(1.0, {}), record(1.0, {"LQG": 2.0})])
    ['synthesized INC', 'LQG']
    """
    return list(dict.fromkeys(entry.name for record in records for entry in record.entries))


def cost_chart(records: Sequence[PlantRecord], path: str | Path | None = None) -> Figure:
    """Return a row per plant with a mark per controller: by what share its cost exceeds the bound on any controller.

    Full marks are certified, hollow ones are not. Controllers are a little apart in height, so that equal costs are seen.
    At the dotted line and left of it all differences are below 1e-6. A plant without a positive bound has an empty row.
    """
    figure = new_figure(WIDTH, 2.0 + ROW * len(records))
    axes = figure.subplots()
    if not any(_shares(record) for record in records):
        say_in(axes, "no cost beside a lower bound is known")
        return written(figure, path)
    names = names_in(records)
    for index, name in enumerate(names):
        apart = SPREAD * (index / max(len(names) - 1, 1) - 0.5)
        points = [(share, y + apart, sure) for y, record in enumerate(records)
                  for one, share, sure in _shares(record) if one == name]
        for sure in (True, False):
            _marks(axes, index, name, [(x, y) for x, y, is_sure in points if is_sure == sure], sure)
        _marks(axes, index, name, [], True, label=name)
    _log_axis(axes, [share for record in records for _, share, _ in _shares(record)])
    axes.set_xlabel("cost above the lower bound on any controller, %; hollow marks are not certified")
    _plant_rows(axes, records)
    _legend(figure, axes)
    return written(figure, path)


def time_chart(records: Sequence[PlantRecord], path: str | Path | None = None) -> Figure:
    """Return two panels with a row per controller and a mark per plant: time to design, time per input; bars at medians."""
    names = names_in(records)
    figure = new_figure(WIDTH, 1.4 + 1.3 * ROW * max(len(names), 1))
    panels = figure.subplots(1, 2, sharey=True)
    kinds: tuple[tuple[str, Callable[[Entry], float | None]], ...] = (
        ("time to design, s", lambda entry: entry.design), ("time per input in Python, µs", lambda entry: entry.evaluation))
    for axes, (title, figure_of) in zip(panels, kinds, strict=True):
        all_times: list[float] = []
        for y, name in enumerate(names):
            found = [record.entry(name) for record in records]
            times = [time for entry in found if entry is not None and entry.cost is not None
                     and (time := figure_of(entry)) is not None and time > 0]
            _strip(axes, y, name, times)
            all_times += times
        _log_axis(axes, all_times)
        axes.set_xlabel(title)
        axes.grid(True, axis="x", color="0.92")
    panels[0].set_yticks(range(len(names)), names, fontsize="small")
    panels[0].set_ylim(max(len(names), 1) - 0.5, -0.5)
    return written(figure, path)


def wins_chart(records: Sequence[PlantRecord], path: str | Path | None = None) -> Figure:
    """Return a bar per competitor: on how many plants a synthesized law costs less, the same, more, or is not compared.

    The static INC is on the left, on the right the INC with memory, on the plants that do not measure their state."""
    panels = {SYNTHESIZED: list(records),
              MEMORY: [one for one in records if not one.sees_all and one.entry(MEMORY) is not None]}
    shown = [own for own in OURS if own == SYNTHESIZED or panels[own]]
    names = [name for name in names_in(records) if name not in OURS]
    figure = new_figure(WIDTH, 1.5 + 1.4 * ROW * max(len(names), 1))
    for axes, own in zip(figure.subplots(1, len(shown), sharey=True, squeeze=False)[0], shown, strict=True):
        for y, name in enumerate(names):
            _bar(axes, y, [duel(record, name, own=own).outcome for record in panels[own]])
        axes.set_xlim(0, max(len(panels[own]), 1))
        axes.set_xlabel(f"plants, {own}")
        axes.set_yticks(range(len(names)), names, fontsize="small")
        axes.set_ylim(max(len(names), 1) - 0.5, -0.5)
    _legend(figure, figure.axes[0])
    return written(figure, path)


def _bar(axes: Any, y: int, outcomes: Sequence[str]) -> None:
    """One bar, its parts labelled with their counts; the first one names them for the legend."""
    left = 0
    for outcome, shade in SHADES.items():
        count = outcomes.count(outcome)
        axes.barh(y, count, left=left, height=0.7, color=shade, edgecolor="white", hatch=HATCHES[outcome],
                  label=SAID[outcome] if y == 0 else None)
        if count:
            axes.text(left + count / 2, y, str(count), ha="center", va="center", fontsize="small",
                      bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.85})
        left += count


def _log_axis(axes: Any, values: Sequence[float]) -> None:
    """A logarithmic axis around values > 0, be they equal."""
    if values:
        axes.set_xlim(min(values) / 2, 2 * max(values))  # before the scale, which would look for limits itself
    axes.set_xscale("log")


def _shares(record: PlantRecord) -> list[tuple[str, float, bool]]:
    """Name, per cent above the bound and whether it is certified, of each controller within the limits."""
    floor = record.bound("any")
    if floor is None or floor <= 0:
        return []
    return [(entry.name, 100 * max(entry.cost / floor - 1, SMALLEST), entry.certified) for entry in record.entries
            if entry.cost is not None and entry.limits != "violated"]


def _look(index: int, name: str) -> tuple[str, str, float]:
    """Colour, marker and size of a controller."""
    if name in OURS:
        return "#000000", "*" if name == SYNTHESIZED else "D", 110.0 if name == SYNTHESIZED else 42.0
    return PALETTE[(index - 1) % 7], MARKERS[(index - 1) % 8], 42.0


def _marks(axes: Any, index: int, name: str, points: list[tuple[float, float]], sure: bool,
           label: str | None = None) -> None:
    shade, marker, size = _look(index, name)
    axes.scatter([x for x, _ in points], [y for _, y in points], s=size, marker=marker, lw=1.2, alpha=0.85,
                 facecolor=shade if sure else "none", edgecolor=shade,
                 label=label, zorder=4 if name in OURS else 3)


def _strip(axes: Any, y: int, name: str, times: list[float]) -> None:
    if not times:
        return
    shade, marker, size = _look(y, name)
    axes.scatter(times, [y] * len(times), s=size / 2, marker=marker, facecolor="none", edgecolor=shade, alpha=0.8)
    axes.plot([median(times)] * 2, [y - 0.35, y + 0.35], color=shade, lw=2.5)


def _plant_rows(axes: Any, records: Sequence[PlantRecord]) -> None:
    axes.set_yticks(range(len(records)), [record.plant for record in records], fontsize="small")
    axes.set_ylim(len(records) - 0.5, -0.5)
    axes.grid(True, axis="x", color="0.92")
    for y in range(1, len(records)):
        axes.axhline(y - 0.5, color="0.92", lw=0.8)
    axes.set_axisbelow(True)
    axes.axvline(100 * SMALLEST, color=QUIET, lw=0.8, ls=":")


def _legend(figure: Any, axes: Any) -> None:
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper center", ncols=5, fontsize="small", frameon=False)
