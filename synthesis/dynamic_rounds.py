"""The search for a controller with memory: all starts, then training from the best, until nothing is left to win."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from inc_casadi.brief import Brief

from .closing import ordeal
from .dynamic_attempts import DynamicTask, attempt_dynamic
from .dynamic_result import DynamicAttempt
from .one_thread import one_thread
from .progress import Progress, counted
from .rounds import Goal, one_round

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
    return certified or min((one for one in history if one.estimate is not None),
                            key=lambda one: ordeal(one.estimate), default=None)


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
    def keep(task: DynamicTask, one: DynamicAttempt) -> float:
        history.append(one)
        return one.cost

    def best() -> float:
        return min((one.cost for one in history), default=np.inf)

    return one_round([replace(task, until=goal.until) for task in tasks], attempt_dynamic, keep, best, not history, goal,
                     executor, progress)
