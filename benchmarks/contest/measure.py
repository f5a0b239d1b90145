"""One plant measured: every controller designed, judged and timed, and set beside the lower bounds."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Any

import numpy as np

from benchmarks.baselines import BASELINES
from benchmarks.plants import Case
from inc_casadi import INC
from inc_casadi.certificate import Proof
from inc_casadi.comparison import Comparison, compare
from inc_casadi.comparison.families import FAMILIES
from inc_casadi.comparison.row import EXACT, Row
from inc_casadi.errors import FormatError, INCError
from inc_casadi.interchange.files import save
from inc_casadi.linear import LinearController
from inc_casadi.pieces.walk import Budget
from synthesis import synthesize
from synthesis.one_thread import one_thread
from synthesis.result import Result

from .duels import CLIPPED, SATURATED
from .environment import environment
from .evaluation import microseconds
from .floors import floors, lower_bounds
from .growth import growth
from .isolation import attempted, words
from .record import Entry, PlantRecord
from .settings import SYNTHESIZED, Settings

GROWN = (SYNTHESIZED, SATURATED, CLIPPED)  # whose initial sets are grown: it takes seconds for each
TOO_LATE = TimeoutError("the time for this plant was over")


@dataclass(frozen=True)
class Measured:
    """The record of a plant, and the file of the synthesized law with its certificate, "" without."""

    record: PlantRecord
    law: str = ""


@dataclass(frozen=True, eq=False)
class _Work:
    """The problem, the budgets, and the processor time from which on nothing more is begun.

    Processor time, so that what is measured on a busy machine is the same.
    """

    case: Case
    settings: Settings
    end: float

    @property
    def over(self) -> bool:
        return process_time() > self.end


@dataclass(frozen=True, eq=False)
class _Design:
    """A controller to judge: the law (or None with the reason), the seconds it took, the result of `synthesize`.

    kind: what a row without a law is called.
    """

    name: str
    law: Any
    seconds: float
    reason: str = ""
    result: Result | None = None
    kind: str = "not found"


def measured(name: str, case: Case, settings: Settings) -> Measured:
    """Return everything about one plant; a controller that fails, in whatever way, is an entry with the reason.

    The synthesized law is judged by its own certificate, the others by `compare`. When `settings.limit` is over, what is not
    begun is left out with that reason. Linear algebra runs on one thread, so that plants measured side by side do not slow
    each other.

    >>> from benchmarks.plants import scalar
    >>> quick = Settings(hidden=0, gains=0.5, only=("synthesized INC", "saturated LQR"))
    >>> record = measured("scalar", scalar(0.9), quick).record
    >>> [(one.name, round(one.cost, 5), one.how, one.certified) for one in record.entries]
    [('synthesized INC', 0.35833, 'exact', True), ('saturated LQR', 0.35833, 'exact', True)]
    """
    begun, here = perf_counter(), environment()
    work = _Work(case, settings, process_time() + settings.limit)
    with one_thread():
        designs = list(_designs(work))
        found = _compared(work, designs)
        entries = tuple(_entry(work, design, found) for design in designs)
    plant = case.plant
    record = PlantRecord(name, (plant.n, plant.m, plant.p), case.source, digest_of(case), settings, here, entries,
                         lower_bounds(found), tuple(str(one) for one in found.inversions()), perf_counter() - begun)
    return Measured(record, _law_file(designs))


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


def _designs(work: _Work) -> Iterator[_Design]:
    if work.settings.wants(SYNTHESIZED):
        yield _synthesized(work)
    for name, baseline in BASELINES.items():
        if not work.settings.wants(name):
            continue
        begun = perf_counter()
        law = TOO_LATE if work.over else attempted(partial(baseline, work.case, work.settings.seed))
        yield _designed(name, law, perf_counter() - begun)


def _synthesized(work: _Work) -> _Design:
    begun, settings = perf_counter(), work.settings
    result = attempted(partial(synthesize, work.case.plant, work.case.spec, hidden=settings.hidden, seconds=settings.search,
                               training_seconds=settings.training, proof_seconds=settings.proof, seed=settings.seed,
                               verbose=False))
    design = _designed(SYNTHESIZED, result, perf_counter() - begun)
    if design.law is None:
        return design
    return replace(design, law=result.inc, result=result, reason="; ".join(filter(None, (*result.notes, result.ended))))


def _designed(name: str, law: Any, seconds: float) -> _Design:
    if law is TOO_LATE:
        return _Design(name, None, seconds, words(law), kind="not tried")
    if isinstance(law, BaseException):
        return _Design(name, None, seconds, str(law) if isinstance(law, INCError) else words(law))
    return _Design(name, law, seconds)


def _compared(work: _Work, designs: list[_Design]) -> Comparison:
    """All controllers and bounds as one comparison; bounds that `synthesize` worked out are among them."""
    result = next((one.result for one in designs if one.result is not None), None)
    known = () if result is None else result.comparison().floors
    proofs: dict[str, Proof] = {} if result is None or result.proof is None else {SYNTHESIZED: result.proof}
    rows = tuple(_row(work, one) for one in designs)
    return Comparison(work.case.plant, work.case.spec, rows, (*known, *floors(work.case, work.settings)), proofs)


def _row(work: _Work, design: _Design) -> Row:
    """What is known of a controller, by its certificate when it brings one."""
    if design.result is not None:
        rows = design.result.comparison().rows
        return replace(rows[0], name=design.name) if rows else Row(design.name, None, "not found")
    if design.law is None:
        return Row(design.name, None, design.kind, notes=(design.reason,))
    found = TOO_LATE if work.over else attempted(partial(_judged, work, design.name, design.law))
    if isinstance(found, BaseException):
        return Row(design.name, design.law, type(design.law).__name__, notes=(words(found),))
    row: Row = found
    return row


def _judged(work: _Work, name: str, law: Any) -> Row:
    """What `compare` says; of a linear gain the Lyapunov equation is asked where pieces give no exact cost, as for n > 8."""
    settings = work.settings

    def row(one: Any) -> Row:
        return compare(work.case.plant, work.case.spec, {name: one}, bounds=(), seed=settings.seed,
                       budget=Budget(seconds=settings.pieces), samples=settings.samples).rows[0]

    found = row(law)
    if found.cost.how == EXACT or not isinstance(law, INC) or law.q or np.any(law.d):
        return found
    other = row(LinearController.static(law.K))
    return other if other.bound < found.bound else found


def _entry(work: _Work, design: _Design, found: Comparison) -> Entry:
    row, law, proof = found.row(design.name), design.law, found.proofs.get(design.name)
    beaten = tuple(key for key in FAMILIES if found.separates(design.name, key))
    entry = Entry(design.name, row.kind, getattr(law, "q", None), getattr(law, "order", None), _number(row.cost.value),
                  row.cost.how, _number(row.cost.error), found.certifies(design.name),
                  None if proof is None else proof.succeeded, row.limits.verdict, _number(row.worst),
                  _number(found.gap(design.name)), beaten, design=design.seconds, judged=row.seconds,
                  reason="; ".join(filter(None, dict.fromkeys((design.reason, *row.notes)))))
    return entry if law is None or work.over else _grown(work, law, _timed(work, law, entry))


def _timed(work: _Work, law: Any, entry: Entry) -> Entry:
    time = attempted(partial(microseconds, work.case.plant, work.case.spec, law, work.settings.seed))
    return replace(entry, evaluation=time) if isinstance(time, float) else entry


def _grown(work: _Work, law: Any, entry: Entry) -> Entry:
    """The entry with how far the initial set may grow; what does not hold from the set will not from a larger one."""
    if not entry.certified or entry.name not in GROWN or not work.settings.region:
        return entry
    grown = attempted(partial(growth, work.case, law, work.settings.region, work.settings.seed))
    return entry if isinstance(grown, BaseException) else replace(entry, factor=grown[0], refuted=grown[1])


def _number(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def _law_file(designs: list[_Design]) -> str:
    result = next((one.result for one in designs if one.result is not None and one.result.inc is not None), None)
    if result is None:
        return ""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "law.json"
        result.save(path)
        return path.read_text(encoding="utf-8")
