"""The forms of training side by side: what `train` reaches within so many CPU seconds, over several seeds."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from statistics import median
from typing import Any

import numpy as np

from synthesis.one_thread import one_thread
from synthesis.phases import Form
from synthesis.starts.random_start import random_start
from synthesis.training import Training, train
from synthesis.training_options import settled
from synthesis.training_setup import setup

from ..plants.paper import Case
from ..plants.suite import suite

PLANTS = ("double integrator", "NN2", "DIS2", "cart and pole")  # the middle two by output feedback, DIS2 with two inputs
SIZES, SEEDS, FORMS = (8, 32), (0, 1, 2, 3, 4), ("shooting", "projected", "lifted")
SECONDS, KAPPA = 1.0, 0.95
QUICK = {"plants": ("NN2", "DIS2"), "sizes": (8,), "seeds": (0, 1), "seconds": 1.0}
LARGEST = {"lifted": 8}  # units above which a form is not run: a few of its steps take all the time there is
NO_END = 10**6  # iterations


@dataclass(frozen=True, eq=False)
class Run:
    """One training from a random start: its cost on nodes not trained on, the steps taken and the CPU seconds of one."""

    plant: str
    q: int
    form: str
    seed: int
    cost: float
    steps: int
    step: float
    status: str


@dataclass(frozen=True, eq=False)
class Row:
    """All seeds of one form. cost, worst: median and largest; permille, percent: in how many seeds the cost is within 0.1
    and 1 % of the least that any form reached from that seed; steps, step: medians; ended: the most frequent end; chosen:
    whether form="auto" takes it.
    """

    plant: str
    q: int
    form: str
    cost: float
    worst: float
    permille: int
    percent: int
    seeds: int
    steps: float
    step: float
    ended: str
    chosen: bool


def training(plants: Sequence[str] = PLANTS, sizes: Sequence[int] = SIZES, seconds: float = SECONDS,
             seeds: Sequence[int] = SEEDS, forms: Sequence[str] = FORMS) -> list[Row]:
    """Return one row for each plant, q and form; every run may take so many CPU seconds, from the same start per seed."""
    return [row for name, q in product(plants, sizes) for row in rows(runs(name, q, seconds, seeds, forms), name, q)]


def quick_training() -> list[Row]:
    """Return the rows of a quick look: two plants, 8 units, two seeds."""
    return training(**QUICK)  # type: ignore[arg-type]


def runs(name: str, q: int, seconds: float, seeds: Sequence[int], forms: Sequence[str]) -> list[Run]:
    """Return one run for each seed and each form that is not too large."""
    case = suite()[name]
    fitting = [form for form in forms if q <= LARGEST.get(form, q)]
    return [_run(case, name, q, form, seed, seconds) for seed, form in product(seeds, fitting)]


def _run(case: Case, name: str, q: int, form: str, seed: int, seconds: float) -> Run:
    start = random_start(case.plant, case.spec, q, kappa=KAPPA, seed=seed)
    times: list[float] = []
    began = time.process_time()

    def watch(_: dict[str, Any]) -> None:
        times.append(time.process_time() - began)
        if times[-1] >= seconds:
            raise KeyboardInterrupt

    with one_thread():  # else CPU time counts what idle threads of linear algebra spend waiting
        found: Training = train(case.plant, case.spec, start, kappa=KAPPA, form=form, max_iterations=NO_END, progress=watch,
                                seed=seed)
    cut = bool(times) and times[-1] >= seconds
    step = float(np.median(np.diff(times))) if len(times) > 1 else np.nan
    return Run(name, q, form, seed, found.cost, len(times), step, "time" if cut else found.status)


def rows(measured: Sequence[Run], name: str, q: int) -> list[Row]:
    """Return the runs of one plant and q as one row per form."""
    chosen = choice(name, q)
    least = {run.seed: min(other.cost for other in measured if other.seed == run.seed) for run in measured}
    return [_row(part, least, chosen) for part in _by_form(measured)]


def choice(name: str, q: int) -> str:
    """Return the form that "auto" stands for.

    >>> choice("NN2", 8), choice("NN2", 32)
    ('shooting', 'projected')
    """
    case = suite()[name]
    start = random_start(case.plant, case.spec, q, kappa=KAPPA)
    problem = setup(case.plant, case.spec, start, kappa=KAPPA, horizon=None, order=None, anchored=True, frozen=(),
                    terminal=None, seed=0)
    return settled(Form(), problem).name


def _by_form(measured: Sequence[Run]) -> Iterator[list[Run]]:
    for form in dict.fromkeys(run.form for run in measured):
        yield [run for run in measured if run.form == form]


def _row(part: Sequence[Run], least: dict[int, float], chosen: str) -> Row:
    costs = np.array([run.cost for run in part])
    above = costs / np.array([least[run.seed] for run in part]) - 1.0
    ended = Counter(run.status for run in part).most_common(1)[0][0]
    return Row(part[0].plant, part[0].q, part[0].form, float(np.median(costs)), float(np.max(costs)),
               int(np.sum(above <= 1e-3)), int(np.sum(above <= 1e-2)), len(part), median(run.steps for run in part),
               float(np.median([run.step for run in part])), ended, part[0].form == chosen)


def training_table(table: Sequence[Row]) -> str:
    """Return the rows as text; a star marks the form that "auto" takes, the ratio is to the form of the least median.

    >>> print(training_table([Row("NN2", 4, "shooting", 6.5, 6.6, 3, 5, 5, 35, 0.02, "solved", True)]))
    plant                q form              median  ratio      worst  0.1 %   1 %  steps  ms/step  ended
    NN2                  4 shooting  *       6.5000      1     6.6000    3/5   5/5     35       20  solved
    """
    lines = [f"{'plant':<18} {'q':>3} {'form':<11} {'median':>12} {'ratio':>6} {'worst':>10} {'0.1 %':>6} {'1 %':>5} "
             f"{'steps':>6} {'ms/step':>8}  ended"]
    for row in table:
        ratio = row.cost / min(other.cost for other in table if (other.plant, other.q) == (row.plant, row.q))
        lines.append(f"{row.plant:<18} {row.q:>3} {row.form:<9} {'*' if row.chosen else ' '} {_cost(row.cost):>12} "
                     f"{ratio:>6.4g} {_cost(row.worst):>10} {f'{row.permille}/{row.seeds}':>6} "
                     f"{f'{row.percent}/{row.seeds}':>5} {row.steps:>6.0f} {1e3 * row.step:>8.0f}  {row.ended}")
    return "\n".join(lines)


def _cost(value: float) -> str:
    return f"{value:.4f}" if value < 1e4 else f"{value:.1e}"
