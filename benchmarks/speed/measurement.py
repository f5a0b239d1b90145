"""One measured time beside its target, and the two ways of measuring: repeated in one run, or in a fresh process."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
TIME_LIMIT = 300.0


@dataclass(frozen=True)
class Measurement:
    """A measured figure: name, value and unit; target: what it should stay below, or None; note: how it came about."""

    name: str
    value: float
    unit: str
    target: float | None = None
    note: str = ""

    @property
    def verdict(self) -> str:
        """pass, miss, or a dash where no target is set.

        >>> Measurement("import", 0.5, "s", 1.0).verdict
        'pass'
        """
        if self.target is None:
            return "-"
        return "pass" if self.value < self.target else "MISS"


def repeated(work: Callable[[], Any], times: int) -> tuple[float, float]:
    """Return median and least wall time of a call in seconds, over `times` calls after one that is not counted.

    The least is what the machine can do, the median what it does with everything else that runs on it.
    """
    work()
    durations = []
    for _ in range(times):
        start = time.perf_counter()
        work()
        durations.append(time.perf_counter() - start)
    return median(durations), min(durations)


def in_fresh_process(code: str) -> Any:
    """Return what a new Python prints as JSON in its last line when it runs `code`.

    Raises RuntimeError with its standard error when it fails, subprocess.TimeoutExpired after five minutes.

    >>> in_fresh_process("print([1, 2])")
    [1, 2]
    """
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=TIME_LIMIT,
                         env={**os.environ, "PYTHONPATH": path})
    if run.returncode != 0:
        raise RuntimeError(f"the measured process failed:\n{run.stderr}")
    return json.loads(run.stdout.strip().splitlines()[-1])


def table(rows: Sequence[Measurement]) -> str:
    """Return measurements as text: what, figure, target, verdict, note.

    >>> print(table([Measurement("import", 0.5, "s", 1.0)]))
    what    measured  unit  target  verdict  note
    import       0.5  s          1  pass
    """
    name, unit = max([4, *(len(row.name) for row in rows)]), max([4, *(len(row.unit) for row in rows)])
    lines = [f"{'what':<{name}}  {'measured':>8}  {'unit':<{unit}}  {'target':>6}  verdict  note"]
    for row in rows:
        target = "-" if row.target is None else f"{row.target:g}"
        lines.append(f"{row.name:<{name}}  {row.value:>8.3g}  {row.unit:<{unit}}  {target:>6}  {row.verdict:<7}  "
                     f"{row.note}".rstrip())
    return "\n".join(lines)
