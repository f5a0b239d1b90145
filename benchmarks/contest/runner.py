"""Run the suite: plants side by side, each apart from the others, finished ones kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks.plants import Case
from inc_casadi.errors import FormatError, InvalidInputError

from .environment import environment
from .files import PLANTS as FOLDER
from .files import read_record, slug, write_record
from .isolation import words
from .measure import Measured, digest_of, measured
from .record import PlantRecord
from .settings import Settings
from .table import progress_line

Measure = Callable[[str, Case, Settings], Measured]


@dataclass(frozen=True, eq=False)
class Run:
    """What a run came to. records: of all plants that are known now, in the order asked for; skipped: those that a former
    run had measured; interrupted: whether it was cut short by Ctrl-C; seconds."""

    records: tuple[PlantRecord, ...]
    skipped: tuple[str, ...]
    interrupted: bool
    seconds: float


@dataclass(eq=False)
class _Books:
    """What is under way and what is finished."""

    settings: Settings
    folder: Path
    say: Callable[[str], Any]
    count: int
    done: dict[str, PlantRecord] = field(default_factory=dict)
    running: dict[Future[Measured], tuple[str, Case, float]] = field(default_factory=dict)

    def finish(self, future: Future[Measured]) -> None:
        name, case, begun = self.running.pop(future)
        error = future.exception()
        found = _failed(name, case, self.settings, error, perf_counter() - begun) if error else future.result()
        write_record(self.folder, found.record, found.law, found.memory)
        self.done[name] = found.record
        self.say(progress_line(found.record, len(self.done), self.count))


def run(cases: Mapping[str, Case], settings: Settings, folder: Path, executor: Executor, width: int, *, fresh: bool = False,
        say: Callable[[str], Any] = print, measure: Measure = measured) -> Run:
    """Measure plants and write each record into `folder` as soon as it is known.

    A plant is skipped when `folder` holds a record of it without error that the same code made from the same problem with
    the same settings, seed included. One that fails is a record with the error's type and message, and the rest goes on.
    Ctrl-C ends what is under way and keeps what is finished, so that a second run resumes there.

    Parameters
    ----------
    cases : by name
    executor : any concurrent.futures.Executor that takes picklable calls; width: how many plants it gets at once
    fresh : measure everything anew
    say : for the progress lines
    measure : what is done with one plant

    Raises
    ------
    InvalidInputError : two plants would be written to the same file
    """
    _distinct(cases)
    begun = perf_counter()
    known = {} if fresh else _known(cases, settings, folder)
    books = _Books(settings, folder, say, len(cases), dict(known))
    for name in known:
        say(f"{name}: known from a former run")
    waiting = [(name, case) for name, case in cases.items() if name not in known]
    interrupted = False
    try:
        while waiting or books.running:
            while waiting and len(books.running) < max(width, 1):
                name, case = waiting.pop(0)
                books.running[executor.submit(measure, name, case, settings)] = (name, case, perf_counter())
            for future in wait(books.running, return_when=FIRST_COMPLETED).done:
                books.finish(future)
    except KeyboardInterrupt:
        interrupted = True
        say(f"interrupted: {len(books.done)} of {len(cases)} plants are kept")
        executor.shutdown(wait=False, cancel_futures=True)
    records = tuple(books.done[name] for name in cases if name in books.done)
    return Run(records, tuple(known), interrupted, perf_counter() - begun)


def _distinct(cases: Mapping[str, Case]) -> None:
    stems: dict[str, str] = {}
    for name in cases:
        other = stems.setdefault(slug(name), name)
        if other != name:
            raise InvalidInputError(f"the plants {other!r} and {name!r} would be written to the same file")


def _known(cases: Mapping[str, Case], settings: Settings, folder: Path) -> dict[str, PlantRecord]:
    """Former records that this run would repeat."""
    here, found = environment(), {}
    for name, case in cases.items():
        path = folder / FOLDER / f"{slug(name)}.json"
        try:
            record = read_record(path)
        except (OSError, FormatError):  # none, or of an older form: it is measured anew
            continue
        if (not record.error and record.plant == name and record.settings == settings
                and record.environment.same_code(here) and record.digest and record.digest == digest_of(case)):
            found[name] = record
    return found


def _failed(name: str, case: Case, settings: Settings, error: BaseException, seconds: float) -> Measured:
    plant = case.plant
    return Measured(PlantRecord(name, (plant.n, plant.m, plant.p), case.source, digest_of(case), settings, environment(),
                                seconds=seconds, error=words(error)))
