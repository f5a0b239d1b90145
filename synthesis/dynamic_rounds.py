"""The search for a controller with memory: all starts, then training from the best, until nothing is left to win."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from inc_casadi.brief import Brief
from inc_casadi.figures import at_most

from .dynamic_attempts import DynamicTask, attempt_dynamic
from .dynamic_result import DynamicAttempt
from .one_thread import one_thread
from .progress import Progress, counted
from .rounds import Goal

BEST = 2  # of so many certified controllers training begins, in each round
LATER_ROUNDS = 1  # of training, when neither seconds nor rounds are given


@final
@dataclass(frozen=True, eq=False)
class DynamicSearch(Brief):
    """What a search came to: every attempt in order, why it ended, and the number of rounds."""

    history: tuple[DynamicAttempt, ...]
    ended: str
    rounds: int


def search_dynamic(first: Sequence[DynamicTask], goal: Goal, executor: Executor | None, progress: Progress) -> DynamicSearch:
    """Make rounds of attempts and return them all: the first is of the tasks given, later ones train the best so far.

    What is tried does not depend on the executor: it computes the attempts of a round at the same time, and they are looked
    at in order. Interrupting it ends the search with the attempts that were finished.
    """
    history: list[DynamicAttempt] = []
    tasks, number, ended = tuple(first), 0, "" if first else "nothing was to be tried"
    while not ended:
        number += 1
        with one_thread():
            ended = _round(tasks, history, goal, executor, progress)
        most = goal.rounds if goal.rounds is not None else np.inf if goal.explores else 1 + LATER_ROUNDS
        if not ended and number >= most:
            ended = f"no more than {counted(number, 'round')} {'was' if number == 1 else 'were'} to be made"
        if not ended:
            tasks = later(history, first[0], number)
            ended = "" if tasks else "nothing else is known to be worth trying"
    return DynamicSearch(tuple(history), ended, number)


def best_of(history: Sequence[DynamicAttempt]) -> DynamicAttempt | None:
    """Return the certified attempt with the lowest certified cost, else the one that simulates best, or None."""
    certified = min((one for one in history if one.certified), key=lambda one: one.cost, default=None)
    return certified or min((one for one in history if one.estimate is not None), key=ordeal, default=None)


def ordeal(one: DynamicAttempt) -> tuple[bool, bool, float]:
    """What simulation has against an attempt: no rest, a limit exceeded, the cost."""
    assert one.estimate is not None
    return not one.estimate.settled, one.estimate.excess > 1e-9, one.estimate.mean


def later(history: Sequence[DynamicAttempt], template: DynamicTask, turn: int) -> tuple[DynamicTask, ...]:
    """Return what is tried after round `turn`: training from the best certified attempts, with and without more units.

    Each seed draws other units. Without anything certified, training begins from what simulates best, and an ellipsoid's
    bound will do.
    """
    known = {one.name for one in history}
    certified = list({float(f"{one.cost:.8g}"): one for one in sorted(
        (one for one in history if one.certified), key=lambda one: -one.cost)}.values())[::-1]  # equal costs: one law, often
    begin = certified[:BEST] if certified else [one for one in [best_of(history)] if one is not None]
    tasks = []
    for one in begin:
        for hidden in dict.fromkeys((0, template.hidden)):
            seed = template.seed + turn - 1
            label = f"{counted(hidden, 'more unit')}, seed {seed}" if hidden else "trained"
            name = f"{one.name}, {label}"
            tasks.append(replace(template, name=name, dynamic=one.dynamic, trained=True, hidden=hidden, seed=seed,
                                 loose=not certified, of=one.name))
    return tuple(task for task in tasks if task.name not in known)


def _round(tasks: Sequence[DynamicTask], history: list[DynamicAttempt], goal: Goal, executor: Executor | None,
           progress: Progress) -> str:
    """Make a round of attempts; return why the search is over, or ""."""
    before = len(history)
    try:
        for one in _attempts([replace(task, until=goal.until) for task in tasks], history, goal, executor, progress):
            history.append(one)
            progress.say(outcome(one))
            if goal.reached(one.cost):
                return f"the certified cost is within {100 * goal.tol:g} % of what no controller can go below"
    except KeyboardInterrupt:
        return f"interrupted after {len(history) - before} of {len(tasks)} attempts: this is the best of those"
    except BrokenExecutor as error:
        return f"the executor broke after {len(history) - before} of {len(tasks)} attempts: {error}"
    return "the time is over" if len(history) - before < len(tasks) or goal.is_late else ""


def _attempts(tasks: Sequence[DynamicTask], history: list[DynamicAttempt], goal: Goal, executor: Executor | None,
              progress: Progress) -> Iterator[DynamicAttempt]:
    """Yield the attempts in order, as long as there is time; the first of all is always made."""
    def say(names: list[str]) -> None:
        progress.trying(names, min((one.cost for one in history), default=np.inf), goal.floor)

    if executor is None:
        for task in tasks:
            if history and goal.is_late:
                return
            say([task.name])
            with progress.during(task.name):
                one = attempt_dynamic(task)
            yield one
        return
    say([task.name for task in tasks])
    futures = [executor.submit(attempt_dynamic, task) for task in tasks]
    try:
        for future in futures:
            with progress.during(f"{sum(not one.done() for one in futures)} attempts"):
                made = future.result(timeout=None if np.isinf(goal.until) else max(0.0, goal.until - time.time()) + 10.0)
            yield made
    except TimeoutError:
        return
    finally:
        for future in futures:
            future.cancel()


def outcome(one: DynamicAttempt) -> str:
    """Return what came of an attempt, in a line."""
    if one.verdict is None or one.estimate is None:
        return f"{one.name}: no candidate, {one.note}"
    if one.certified:
        return f"{one.name}: certified cost at most {at_most(one.cost)}"
    return f"{one.name}: not certified, simulated cost {one.estimate.mean:.4f}; {next(iter(one.verdict.refusals), '')}"
