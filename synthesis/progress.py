"""What the search says while it works: whole lines, flushed, so that logs and notebooks stay tidy."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from threading import Event, Thread
from typing import TYPE_CHECKING

import numpy as np

from inc_casadi.figures import at_least, at_most

from .result import Attempt

if TYPE_CHECKING:
    from .dynamic_result import DynamicAttempt

SILENCE = 5.0  # seconds after which a long task is said to go on


@dataclass(frozen=True, eq=False)
class Progress:
    """Prints lines with the seconds since the call began; nothing at all unless verbose.

    began: time.monotonic() of the call; seconds: its budget, infinite without.
    """

    verbose: bool
    seconds: float = np.inf
    began: float = field(default_factory=time.monotonic)

    @property
    def elapsed(self) -> float:
        """Seconds since the call began."""
        return time.monotonic() - self.began

    @property
    def is_late(self) -> bool:
        """Whether the budget is used up."""
        return self.elapsed >= self.seconds

    def share(self, part: float) -> float | None:
        """Return a part of the budget in seconds, no more than what is left of it; None where there is no budget.

        >>> Progress(False).share(0.1), Progress(False, seconds=20.0).share(0.1)
        (None, 2.0)
        """
        return max(0.0, min(part * self.seconds, self.seconds - self.elapsed)) if np.isfinite(self.seconds) else None

    def say(self, line: str) -> None:
        """Print a line at once."""
        if self.verbose:
            print(f"[{self.elapsed:5.1f} s] {line}", flush=True)

    @contextmanager
    def during(self, what: str) -> Iterator[None]:
        """Say every few seconds, while a block works, that it still does."""
        if not self.verbose:
            yield
            return
        over, since = Event(), self.elapsed

        def beat() -> None:
            while not over.wait(SILENCE):
                self.say(f"still at it for {self.elapsed - since:.0f} s: {what}")

        beating = Thread(target=beat, daemon=True)
        beating.start()
        try:
            yield
        finally:
            over.set()
            beating.join()

    def trying(self, names: list[str], best: float, floor: float) -> None:
        """Say what is tried next, and how the search stands."""
        parts = [standing(best, floor)]
        if np.isfinite(self.seconds):
            parts.append(f"{max(0.0, self.seconds - self.elapsed):.0f} s left")
        self.say(f"trying {'; '.join(names)} ({', '.join(part for part in parts if part)})")


def standing(best: float, floor: float) -> str:
    """Return best certified cost, lower bound and gap in words.

    >>> standing(2.0, 1.6)
    'best certified 2, none below 1.6, gap 25 %'
    >>> standing(float("inf"), 1.6)
    'nothing certified yet, none below 1.6'
    """
    words = [f"best certified {at_most(best)}" if np.isfinite(best) else "nothing certified yet"]
    if np.isfinite(floor):
        words.append(f"none below {at_least(floor)}")
    if np.isfinite(best) and floor > 0:
        words.append(f"gap {100 * (best / floor - 1):.3g} %")
    return ", ".join(words)


def counted(number: int, noun: str) -> str:
    """Return a number with its noun.

    >>> counted(1, "round"), counted(3, "attempt")
    ('1 round', '3 attempts')
    """
    return f"{number} {noun}" + ("" if number == 1 else "s")


def outcome(one: Attempt | DynamicAttempt) -> str:
    """Return what came of an attempt, in a line."""
    if one.verdict is None or one.estimate is None:
        return f"{one.name}: no candidate, {one.note}"
    if one.certified:
        return f"{one.name}: certified cost at most {at_most(one.verdict.cost)}"
    reason = one.verdict.refusals[0] if one.verdict.refusals else ""
    return f"{one.name}: not certified, simulated cost {one.estimate.mean:.4f}; {reason}"
