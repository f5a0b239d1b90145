"""What is under way on one plant: the problem, its budgets, where the seconds go, and a controller between design and
judgement."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import process_time
from typing import Any

from benchmarks.plants import Case
from inc_casadi.certificate import Proof
from inc_casadi.errors import INCError, InvalidInputError

from .isolation import words
from .record import ABSENT, UNSUITED
from .settings import Settings

TOO_LATE = TimeoutError("the time for this plant was over")


@dataclass(eq=False)
class Stages:
    """Processor seconds by stage, which neither a busy machine nor plants measured side by side distort.

    >>> stages = Stages()
    >>> with stages.during("bounds"):
    ...     pass
    >>> list(stages.seconds), stages.seconds["bounds"] >= 0
    (['bounds'], True)
    """

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def during(self, stage: str) -> Iterator[None]:
        """Add what the block takes to a stage."""
        begun = process_time()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + process_time() - begun


@dataclass(frozen=True, eq=False)
class Work:
    """The problem, the budgets, the processor time from which on nothing more is begun, and where the seconds go."""

    case: Case
    settings: Settings
    end: float
    stages: Stages = field(default_factory=Stages)

    @property
    def over(self) -> bool:
        """Whether nothing more is to be begun."""
        return process_time() > self.end


@dataclass(frozen=True, eq=False)
class Design:
    """A controller to judge: the law (or None with the reason), the processor seconds it took, and the result of the
    synthesis that it comes from.

    kind: what a row without a law is called; proof: how its certificate was settled rigorously.
    """

    name: str
    law: Any
    seconds: float
    reason: str = ""
    result: Any = None
    kind: str = ABSENT
    proof: Proof | None = None


def designed(name: str, law: Any, seconds: float) -> Design:
    """Return the design of what came back: a law, or the exception that came instead.

    >>> designed("LQG", InvalidInputError("the state is measured"), 0.0).kind, designed("LQG", KeyError("x"), 0.0).reason
    ('does not apply', "KeyError: 'x'")
    """
    if law is TOO_LATE:
        return Design(name, None, seconds, words(law), kind="not tried")
    if isinstance(law, BaseException):
        kind = UNSUITED if isinstance(law, InvalidInputError) else ABSENT
        return Design(name, None, seconds, str(law) if isinstance(law, INCError) else words(law), kind=kind)
    return Design(name, law, seconds)
