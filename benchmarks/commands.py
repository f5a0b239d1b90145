"""What the commands but `suite` and `page` do: a table, its sheet for the results page, the exit status."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
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
    """Print measured times, part by part; 1 when one misses its target. part: one alone; quick: of training."""
    total, status = 0.0, 0
    for name in PARTS if part is None else (part,):
        begun = _processor()
        if part is None:
            print(f"speed {name}", flush=True)
        status = max(status, _PARTS[name](quick, out))
        total += _processor() - begun
        if part is None:
            print(f"({_processor() - begun:.0f} s of the processor)\n", flush=True)
    if part is None:
        print(f"all parts: {total:.0f} s of the processor")
    return status


def _times(_: bool, out: Path | None) -> int:
    return _judged("speed times", [*speed.imports(), *speed.exact_cost(), *speed.main_job(), *speed.evaluation()], out)


def _certify(_: bool, out: Path | None) -> int:
    rows = speed.certification()
    _said("speed certify", speed.certification_table(rows), rows, out)
    print()
    return _judged("speed certify, targets", speed.certification_targets(rows), out)


def _pieces(_: bool, out: Path | None) -> int:
    rows = speed.pieces()
    return _said("speed pieces", speed.pieces_table(rows), rows, out)


def _training(quick: bool, out: Path | None) -> int:
    rows = speed.quick_training() if quick else speed.training()
    return _said("speed training", speed.training_table(rows), rows, out)


def _alternation(_: bool, out: Path | None) -> int:
    rows = speed.alternation()
    return _said("speed alternation", speed.alternation_table(rows), rows, out)


def _single(_: bool, out: Path | None) -> int:
    rows = speed.single_evaluation()
    return _said("speed single", speed.single_table(rows), rows, out)


_PARTS: Mapping[str, Callable[[bool, Path | None], int]] = MappingProxyType({
    "times": _times, "certify": _certify, "pieces": _pieces, "training": _training, "alternation": _alternation,
    "single": _single})
PARTS = tuple(_PARTS)


def _processor() -> float:
    """Processor seconds of this process and of those that it has waited for."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


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
