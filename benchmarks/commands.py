"""What the commands but `suite` and `page` do: a table, its sheet for the results page, the exit status."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from . import bounds, paper, speed
from .contest.sheets import write_sheet


def paper_command(figures: str | None, out: Path | None) -> int:
    """Print the paper's figures beside computed ones; 1 when one does not agree. figures: a folder for its pictures."""
    rows = paper.all_rows()
    _said("paper", paper.report(rows), rows, out)
    if figures is not None:
        for path in paper.draw_all(figures):
            print(f"drawn: {path}")
    return int(not all(row.agrees for row in rows))


def bounds_command(plant: str | None, out: Path | None) -> int:
    """Print every plant between bounds; 1 when a bound exceeds a certified cost of its class. plant: one alone.

    Raises InvalidInputError when there is no plant of that name.
    """
    lines: list[str] = []

    def say(line: str) -> None:
        lines.append(line)
        print(line, flush=True)

    status = bounds.report(bounds.lines(bounds.chosen(plant)), say)
    if out is not None:
        write_sheet(out, "bounds" if plant is None else f"bounds --plant {plant}", "\n".join(lines))
    return status


def speed_command(part: str | None, quick: bool, out: Path | None) -> int:
    """Print measured times; 1 when one misses its target. part: one measurement alone; quick: of training."""
    if part is None:
        measured = [*speed.imports(), *speed.exact_cost(), *speed.main_job(), *speed.evaluation()]
        return _judged("speed", measured, out)
    if part == "certify":
        rows = speed.certification()
        _said("speed certify", speed.certification_table(rows), rows, out)
        print()
        return _judged("speed certify, targets", speed.certification_targets(rows), out)
    if part == "pieces":
        text, found = speed.pieces_table(pieces := speed.pieces()), pieces
        return _said("speed pieces", text, found, out)
    if part == "training":
        runs = speed.quick_training() if quick else speed.training()
        return _said("speed training", speed.training_table(runs), runs, out)
    if part == "single":
        answers = speed.single_evaluation()
        return _said("speed single", speed.single_table(answers), answers, out)
    costs = speed.alternation()
    return _said("speed alternation", speed.alternation_table(costs), costs, out)


def main_command(out: Path | None) -> int:
    """Print the time of the main job alone; 1 when it misses its target."""
    return _judged("main", speed.main_job(), out)


def _judged(title: str, measured: list[speed.Measurement], out: Path | None) -> int:
    _said(title, speed.table(measured), measured, out)
    return int(any(one.verdict == "MISS" for one in measured))


def _said(title: str, text: str, rows: Sequence[Any], out: Path | None) -> int:
    print(text)
    if out is not None:
        write_sheet(out, title, text, rows)
    return 0
