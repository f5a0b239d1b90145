"""One plant measured: every controller designed, judged and timed, and set beside the lower bounds."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Any

from benchmarks.plants import Case
from inc_casadi.comparison import Comparison
from inc_casadi.comparison.families import FAMILIES
from inc_casadi.errors import FormatError
from inc_casadi.interchange.files import save
from synthesis.one_thread import one_thread

from .duels import CLIPPED, OURS, SATURATED
from .entrants import entrants
from .environment import environment
from .evaluation import microseconds
from .floors import lower_bounds
from .growth import growth, hopeless
from .isolation import attempted
from .judging import SAME, compared
from .record import Entry, PlantRecord
from .settings import SYNTHESIZED, Settings
from .work import Design, Work

GROWN = (SYNTHESIZED, SATURATED, CLIPPED)  # whose initial sets are grown: it takes seconds for each


@dataclass(frozen=True)
class Measured:
    """The record of a plant, and the files of the synthesized laws with their certificates, "" without: the static one and
    that with memory."""

    record: PlantRecord
    law: str = ""
    memory: str = ""


def measured(name: str, case: Case, settings: Settings) -> Measured:
    """Return everything about one plant; a controller that fails, in whatever way, is an entry with the reason.

    Synthesized laws are judged by their own certificates, the others by `compare`. When `settings.limit` is over, what is
    not begun is left out with that reason. Linear algebra runs on one thread, so that plants measured side by side do not
    slow each other. Times are of the processor: of a busy machine they are the same.

    >>> from benchmarks.plants import scalar
    >>> quick = Settings(hidden=0, gains=0.5, only=("synthesized INC", "saturated LQR"))
    >>> record = measured("scalar", scalar(0.9), quick).record
    >>> [(one.name, round(one.cost, 5), one.how, one.certified) for one in record.entries]
    [('synthesized INC', 0.35833, 'exact', True), ('saturated LQR', 0.35833, 'exact', True)]
    """
    begun, from_here, here = perf_counter(), process_time(), environment()
    work = Work(case, settings, from_here + settings.limit)
    with one_thread():
        designs = list(entrants(work))
        found = compared(work, designs)
        entries = _entries(work, designs, found)
    plant = case.plant
    inversions = tuple(str(one) for one in found.inversions())
    stages = work.stages.seconds | {"in all": process_time() - from_here}
    record = PlantRecord(name, (plant.n, plant.m, plant.p), case.source, digest_of(case), settings, here, entries,
                         lower_bounds(found), inversions, perf_counter() - begun, stages)
    return Measured(record, *(_law_file(designs, own) for own in OURS))


def digest_of(case: Case) -> str:
    """Return the digest of plant and specification, by which a record of the same problem is known; "" without.

    >>> from benchmarks.plants import scalar
    >>> digest_of(scalar(0.9)) == digest_of(scalar(0.9)) != digest_of(scalar(0.8))
    True
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "problem.json"
        try:
            save({"plant": case.plant, "spec": case.spec}, path)
        except FormatError:  # a distribution that files do not know
            return ""
        return str(json.loads(path.read_text(encoding="utf-8"))["digest"])


def _entries(work: Work, designs: Sequence[Design], found: Comparison) -> tuple[Entry, ...]:
    made: list[Entry] = []
    for one in designs:
        entry = _entry(one, found)
        if one.law is not None and not work.over:
            with work.stages.during("evaluation"):
                entry = _timed(work, one.law, entry)
            with work.stages.during("growth"):
                entry = _grown(work, one.law, entry, found, made)
        made.append(entry)
    return tuple(made)


def _entry(design: Design, found: Comparison) -> Entry:
    row, law, proof = found.row(design.name), design.law, found.proofs.get(design.name)
    beaten = tuple(key for key in FAMILIES if found.separates(design.name, key))
    return Entry(design.name, row.kind, getattr(law, "q", None), getattr(law, "order", None), _number(row.cost.value),
                 row.cost.how, _number(row.cost.error), found.certifies(design.name),
                 None if proof is None else proof.succeeded, row.limits.verdict, _number(row.worst),
                 _number(found.gap(design.name)), beaten, design=design.seconds, judged=row.seconds,
                 reason="; ".join(filter(None, dict.fromkeys((design.reason, *row.notes)))))


def _timed(work: Work, law: Any, entry: Entry) -> Entry:
    time = attempted(partial(microseconds, work.case.plant, work.case.spec, law, work.settings.seed))
    return replace(entry, evaluation=time) if isinstance(time, float) else entry


def _grown(work: Work, law: Any, entry: Entry, found: Comparison, before: Sequence[Entry]) -> Entry:
    """The entry with how far the initial set may grow; what does not hold from the set will not from a larger one."""
    if not entry.certified or entry.name not in GROWN or not work.settings.region:
        return entry
    row = found.row(entry.name)
    if SAME in row.notes:
        return replace(entry, factor=before[0].factor, refuted=before[0].refuted)
    if reason := hopeless(row.cost.evidence):
        return replace(entry, reason="; ".join(filter(None, (entry.reason, f"initial set not grown: {reason}"))))
    grown = attempted(partial(growth, work.case, law, work.settings.region, work.settings.seed))
    return entry if isinstance(grown, BaseException) else replace(entry, factor=grown[0], refuted=grown[1])


def _number(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def _law_file(designs: Sequence[Design], name: str) -> str:
    result = next((one.result for one in designs if one.name == name and one.law is not None), None)
    if result is None:
        return ""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "law.json"
        attempted(partial(result.save, path))
        return path.read_text(encoding="utf-8") if path.exists() else ""
