"""The forms of training side by side: time of an iteration and time to a given cost, from one start on one set of nodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from inc_casadi.linear.regulator import discounted_lqr
from synthesis.lifted import minimize_lifted
from synthesis.nlp import minimize
from synthesis.objective import Objective
from synthesis.outcome import Outcome
from synthesis.projected import descend
from synthesis.rollout import Parameters, roll
from synthesis.starts.random_start import random_start
from synthesis.training_setup import LIFTED_COARSE, Setup, setup

from ..plants.suite import suite

PLANTS, SIZES = ("two states", "NN2"), (4, 8, 16, 32, 64)
SECONDS, ITERATIONS, KAPPA = 6.0, 1000, 0.95
QUICK_SIZES, QUICK_SECONDS = (4, 8), 1.0
MOST_WORK = 1e10  # multiplications in a factorization of the lifted form, above which one takes longer than all others may
GRAPH_SIZES = (4, 8)  # the CasADi graph alone is there for reference


@dataclass(frozen=True, eq=False)
class Row:
    """One run of one form: costs are true rollouts on the nodes trained on; seconds include building the NLP.

    iteration: median seconds of one; percent, permille: seconds until the cost is within 1 and 0.1 % of the least that any
    form reached for this plant and q, NaN where it never was; status: how the run ended.
    """

    plant: str
    q: int
    form: str
    start: float
    cost: float
    iterations: int
    iteration: float
    percent: float
    permille: float
    status: str


def training(plants: Sequence[str] = PLANTS, sizes: Sequence[int] = SIZES, seconds: float = SECONDS,
             max_iterations: int = ITERATIONS, seed: int = 0) -> list[Row]:
    """Return one row for each plant, q and form; each form may take so many seconds, and starts at the same random law."""
    return [row for name in plants for q in sizes for row in _measured(name, q, seconds, max_iterations, seed)]


def quick_training() -> list[Row]:
    """Return the rows of the two smallest sizes, with a second for each run."""
    return training(sizes=QUICK_SIZES, seconds=QUICK_SECONDS)


def _measured(name: str, q: int, seconds: float, max_iterations: int, seed: int) -> list[Row]:
    case = suite()[name]
    start = random_start(case.plant, case.spec, q, kappa=KAPPA, seed=seed)
    problem = setup(case.plant, case.spec, start, kappa=KAPPA, horizon=None, order=None, anchored=True, frozen=(),
                    terminal=None, seed=seed)
    scenario = problem.scenario(LIFTED_COARSE)
    law = Parameters.of(start)
    begun = roll(scenario, law).cost
    runs = {form: run(Objective(scenario, problem.layout, problem.scale, problem.sketch(scenario)), law,
                      time_limit=seconds, max_iterations=max_iterations)
            for form, run in _forms(problem).items() if form != "graph" or q in GRAPH_SIZES}
    least = min([begun] + [cost for outcome in runs.values() for _, cost, _ in outcome.history])
    return [_row(name, q, form, begun, outcome, least) for form, outcome in runs.items()]


def _forms(problem: Setup) -> dict[str, Callable[..., Outcome]]:
    gain, _ = discounted_lqr(problem.plant, problem.spec)

    def shooting(objective: Objective, law: Parameters, **options: float) -> Outcome:
        hessian = "limited-memory" if problem.sketch(objective.scenario) is None else "gauss-newton"
        return minimize(objective, law, hessian=hessian, **options)  # type: ignore[arg-type]

    def lifted(objective: Objective, law: Parameters, **options: float) -> Outcome:
        if work(objective) > MOST_WORK:
            return Outcome(law, f"not run: {work(objective):.0e} multiplications a step", ())
        return minimize_lifted(objective, law, gain=gain, **options)  # type: ignore[arg-type]

    def graph(objective: Objective, law: Parameters, **options: float) -> Outcome:
        return minimize(objective, law, method="graph", hessian="limited-memory", **options)  # type: ignore[arg-type]

    return {"shooting": shooting, "lifted": lifted, "projected": descend, "graph": graph}


def work(objective: Objective) -> float:
    """Return the multiplications of one factorization of the lifted form, to its leading term S (q + m + n) P^2."""
    scenario = objective.scenario
    stages = scenario.weights.size * scenario.steps
    return float(stages * (scenario.q + sum(scenario.B.shape)) * objective.layout.size**2)


def _row(name: str, q: int, form: str, begun: float, outcome: Outcome, least: float) -> Row:
    _, costs, seconds = np.array(outcome.history).reshape(-1, 3).T
    steps = np.diff(seconds)

    def until(share: float) -> float:
        met = np.flatnonzero(costs <= (1.0 + share) * least)
        return float(seconds[met[0]]) if met.size else np.nan

    return Row(name, q, form, begun, float(np.min(costs, initial=begun)), steps.size,
               float(np.median(steps)) if steps.size else np.nan, until(0.01), until(0.001), outcome.status)


def training_table(rows: Sequence[Row]) -> str:
    """Return the rows as text.

    >>> row = Row("two states", 4, "lifted", 9.0, 1.5, 20, 0.03, 0.5, np.nan, "solved")
    >>> print(training_table([row]))
    plant                q form          start       cost  steps  ms/step  s to 1 %  to 0.1 %  ended
    two states           4 lifted            9     1.5000     20       30      0.50         -  solved
    """
    lines = [f"{'plant':<18} {'q':>3} {'form':<10} {'start':>8} {'cost':>10} {'steps':>6} {'ms/step':>8} "
             f"{'s to 1 %':>9} {'to 0.1 %':>9}  ended"]
    for row in rows:
        lines.append(f"{row.plant:<18} {row.q:>3} {row.form:<10} {row.start:>8.4g} {row.cost:>10.4f} {row.iterations:>6} "
                     f"{_shown(1e3 * row.iteration, 0):>8} {_shown(row.percent, 2):>9} {_shown(row.permille, 2):>9}  "
                     f"{row.status}")
    return "\n".join(lines)


def _shown(value: float, digits: int) -> str:
    return "-" if np.isnan(value) else f"{value:.{digits}f}"
