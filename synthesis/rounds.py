"""The loop of Algorithm 1: rounds of attempts, each chosen by what came of those before, until nothing is left to win."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from concurrent.futures import TimeoutError as FutureTimeout
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from .attempts import Task, attempt
from .followups import Done, best_certified, cost_of, explorations, improvements, repairs
from .one_thread import one_thread
from .progress import Progress, counted, outcome
from .result import Attempt

if TYPE_CHECKING:
    from .dynamic_attempts import DynamicTask
    from .dynamic_result import DynamicAttempt

REPAIRS = 2  # rounds of retries when neither seconds nor rounds are given
MOST_ROUNDS = 40
GRACE = 10.0  # seconds that an attempt in another process may be late

T = TypeVar("T", Task, "DynamicTask")
A = TypeVar("A", Attempt, "DynamicAttempt")


@dataclass(frozen=True, eq=False)
class Goal:
    """When the search ends.

    floor: a proved lower bound on the cost of every controller, -inf without; tol: the search ends when the certified cost
    is within this share of it; rounds: how many at most, None for the default; until: time.time() at the end of the
    budget, infinite without.
    """

    floor: float
    tol: float
    rounds: int | None
    until: float

    def reached(self, cost: float) -> bool:
        """Whether nothing, or less than tol, is left to win."""
        return bool(np.isfinite(cost) and np.isfinite(self.floor) and cost - self.floor <= self.tol * abs(self.floor))

    @property
    def explores(self) -> bool:
        """Whether the search goes on where nothing was refused."""
        return self.rounds is not None or np.isfinite(self.until)

    @property
    def is_late(self) -> bool:
        """Whether the budget is used up."""
        return time.time() >= self.until


@dataclass(frozen=True, eq=False)
class Search:
    """What a search came to: every attempt in order, and why it ended."""

    history: tuple[Done, ...]
    ended: str
    rounds: int


def search(first: tuple[Task, ...], goal: Goal, executor: Executor | None, progress: Progress) -> Search:
    """Make rounds of attempts and return them all.

    The history is that of making the attempts of each round one after another and stopping at the first that reaches the
    goal. An executor computes them at the same time, but they are looked at in that order, and those after the first
    that reaches it are dropped; so the history does not depend on the executor, unless a time limit cuts an attempt short.
    """
    with one_thread():  # threads of this process share the setting: attempts that end must not undo it for the others
        return _search(first, goal, executor, progress)


def _search(first: tuple[Task, ...], goal: Goal, executor: Executor | None, progress: Progress) -> Search:
    history: list[Done] = []
    tasks, number, ended = first, 0, "" if first else "nothing was to be tried: random starts need hidden units"
    while not ended:
        number += 1
        before = len(history)
        ended = _round(tasks, history, goal, executor, progress)
        if not ended and _is_last(number, goal):
            ended = f"no more than {counted(number, 'round')} {'was' if number == 1 else 'were'} to be made"
        if not ended:
            tasks = _next(tuple(history), history[before:], first[0], goal, number)
            ended = "" if tasks else "nothing else is known to be worth trying"
    return Search(tuple(history), ended, number)


def _next(history: tuple[Done, ...], latest: list[Done], template: Task, goal: Goal, number: int) -> tuple[Task, ...]:
    template = replace(template, start="", law=None, label="")
    tasks = repairs(history, latest)
    if template.hidden or goal.explores:
        tasks += improvements(history)
    if goal.explores:
        tasks += explorations(history, template, number)
    return tuple({task.name: task for task in tasks}.values())


def _is_last(number: int, goal: Goal) -> bool:
    most = goal.rounds if goal.rounds is not None else MOST_ROUNDS if goal.explores else 1 + REPAIRS
    return number >= most


def _round(tasks: tuple[Task, ...], history: list[Done], goal: Goal, executor: Executor | None,
           progress: Progress) -> str:
    def keep(task: Task, one: Attempt) -> float:
        history.append(Done(task, one))
        return cost_of(history[-1])

    def best() -> float:
        found = best_certified(history)
        return np.inf if found is None else cost_of(found)

    return one_round(tuple(replace(task, until=goal.until) for task in tasks), attempt, keep, best, not history, goal,
                     executor, progress)


def one_round(tasks: Sequence[T], make: Callable[[T], A], keep: Callable[[T, A], float], best: Callable[[], float],
              first: bool, goal: Goal, executor: Executor | None, progress: Progress) -> str:
    """Make a round of attempts; return why the search is over, or "".

    make : an attempt of a task, here or, by an executor, elsewhere; keep : puts it into the history and returns its
    certified cost; best : the lowest so far; first : whether nothing was tried before, for the first attempt of all is
    always made
    """
    done = 0
    try:
        for task, one in zip(tasks, _attempts(tasks, make, best, first, goal, executor, progress), strict=False):
            cost, done = keep(task, one), done + 1
            progress.say(outcome(one))
            if "interrupted" in one.note:
                raise KeyboardInterrupt
            if goal.reached(cost):
                return f"the certified cost is within {100 * goal.tol:g} % of what no controller can go below"
    except KeyboardInterrupt:
        return f"interrupted after {done} of {len(tasks)} attempts: this is the best of those"
    except BrokenExecutor as error:
        return f"the executor broke after {done} of {len(tasks)} attempts: {error}"
    return "the time is over" if done < len(tasks) or goal.is_late else ""


def _attempts(tasks: Sequence[T], make: Callable[[T], A], best: Callable[[], float], first: bool, goal: Goal,
              executor: Executor | None, progress: Progress) -> Iterator[A]:
    """Yield the attempts in order, as long as there is time."""
    if executor is None:
        for number, task in enumerate(tasks):
            if goal.is_late and (number or not first):
                return
            progress.trying([task.name], best(), goal.floor)
            with progress.during(task.name):
                one = make(task)
            yield one
        return
    progress.trying([task.name for task in tasks], best(), goal.floor)
    futures = [executor.submit(make, task) for task in tasks]
    try:
        for future in futures:
            with progress.during(f"{sum(not one.done() for one in futures)} attempts"):
                made = _result(future, goal)
            if made is None:
                return
            yield made
    finally:
        for future in futures:
            future.cancel()


def _result(future: Future[A], goal: Goal) -> A | None:
    """What came of an attempt elsewhere, None where it is late."""
    left = None if np.isinf(goal.until) else max(0.0, goal.until - time.time()) + GRACE
    try:
        return future.result(timeout=left)
    except FutureTimeout:
        return None
