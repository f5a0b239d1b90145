"""What `python -m benchmarks suite` and `page` do, from plain arguments."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.baselines import BASELINES
from benchmarks.plants import Case, suite
from inc_casadi.errors import InvalidInputError

from .charts import draw_charts
from .environment import cores
from .files import read_records, write_tables
from .isolation import FreshProcesses
from .page import write_page
from .record import PlantRecord
from .runner import Run, run
from .settings import MEMORY, QUICK, QUICK_PLANTS, SYNTHESIZED, Settings
from .sheets import read_sheets
from .table import table

SHORT = {"synthesized": SYNTHESIZED, "memory": MEMORY}
PAGE = "RESULTS.md"
PATIENCE = 3.0  # a plant whose time is over finishes what it is at, and is ended after so many times as long
CONNECTING = 15.0  # seconds for a Dask scheduler to answer
INTERRUPTED = 130  # as a shell says it


def suite_command(folder: Path, plants: Sequence[str] = (), only: Sequence[str] = (), *, quick: bool = False, seed: int = 0,
                  jobs: int | None = None, dask: str = "", fresh: bool = False, say: Callable[[str], Any] = print) -> int:
    """Run the suite, or a part of it, write everything into a folder, say the table, and return the exit status.

    Parameters
    ----------
    folder : records, tables, charts and page go here
    plants, only : names of plants and of controllers; all when empty
    quick : small budgets, and a few plants when none are named
    jobs : plants at the same time, each in a process of its own, None for as many as cores
    dask : the address of a Dask scheduler to compute on instead
    fresh : measure what a former run has measured already

    Returns
    -------
    0; 1 when a plant failed or a certified cost contradicts a bound; 130 after Ctrl-C.

    Raises
    ------
    InvalidInputError : a name that there is none of, jobs < 1, or Dask is asked for and not there
    """
    cases = chosen(plants or (QUICK_PLANTS if quick else ()))
    settings = replace(QUICK if quick else Settings(), seed=seed, only=controllers(only))
    with _workers(cores() if jobs is None else jobs, dask, settings, len(cases)) as (executor, width):
        found = run(cases, settings, folder, executor, width, fresh=fresh, say=say)
    if found.records:
        _written(folder, found.records)
        say("\n" + table(found.records))
    say(_last(found, folder))
    return INTERRUPTED if found.interrupted else int(any(one.error or one.inversions for one in found.records))


def page_command(folder: Path, path: Path, say: Callable[[str], Any] = print) -> int:
    """Write the results page, and tables and charts, from the records in a folder; return 0.

    Raises FormatError when there are none.
    """
    records = read_records(folder, tuple(suite()))
    _written(folder, records)
    say(f"{_plants(len(records))}: {write_page(path, records, read_sheets(folder), folder)}")
    return 0


def chosen(names: Sequence[str]) -> dict[str, Case]:
    """Return plants of the suite by name, in its order; all for no names.

    Raises InvalidInputError with the names that there are.

    >>> list(chosen(["double integrator", "two states"]))
    ['two states', 'double integrator']
    """
    cases = suite()
    for name in names:
        if name not in cases:
            raise InvalidInputError(f"no plant of the suite is named {name!r}; the names are {', '.join(map(repr, cases))}")
    return {name: case for name, case in cases.items() if not names or name in names}


def controllers(names: Sequence[str]) -> tuple[str, ...]:
    """Return names of controllers in the order of the table, "synthesized" standing for the synthesized INC, "memory" for
    the one with memory.

    Raises InvalidInputError with the names that there are.

    >>> controllers(["LQG", "synthesized"])
    ('synthesized INC', 'LQG')
    """
    known = (SYNTHESIZED, MEMORY, *BASELINES)
    asked = [SHORT.get(name, name) for name in names]
    for name in asked:
        if name not in known:
            names_known = ", ".join(map(repr, (*SHORT, *BASELINES)))
            raise InvalidInputError(f"no controller is named {name!r}; the names are {names_known}")
    return tuple(name for name in known if name in asked)


@contextmanager
def _workers(jobs: int, dask: str, settings: Settings, plants: int) -> Iterator[tuple[Executor, int]]:
    """An executor, and how many plants it takes at once."""
    if jobs < 1:
        raise InvalidInputError(f"jobs is {jobs}, but at least one plant must be measured at a time")
    if not dask:
        with FreshProcesses(PATIENCE * settings.limit) as processes:
            yield processes, jobs
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise InvalidInputError("dask is asked for, but distributed is not installed: pip install 'inc-casadi[distributed]'"
                                ) from error
    try:
        client = Client(dask, timeout=CONNECTING)
    except OSError as error:
        raise InvalidInputError(f"no Dask scheduler answers at {dask}: {error}") from error
    with client:  # it queues what its workers do not take yet
        yield client.get_executor(), plants


def _written(folder: Path, records: Sequence[PlantRecord]) -> None:
    write_tables(folder, records)
    draw_charts(records, folder)
    write_page(folder / PAGE, records, read_sheets(folder), folder)


def _plants(count: int) -> str:
    return f"{count} plant{'s' if count != 1 else ''}"


def _last(found: Run, folder: Path) -> str:
    known = f", {len(found.skipped)} known from a former run" if found.skipped else ""
    return f"{_plants(len(found.records))} in {found.seconds:.0f} s{known}; results in {folder}"
