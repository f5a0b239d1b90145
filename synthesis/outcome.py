"""What a search over laws comes to, and the track that it keeps on its way; the same for every form of training."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from inc_casadi.brief import Brief

from .rollout import Parameters

Progress = Callable[[int, float, float], None]


@dataclass(frozen=True, eq=False)
class Outcome(Brief):
    """The best law that a search accepted, its status in words, and (iteration, cost, seconds) per step."""

    law: Parameters
    status: str
    history: tuple[tuple[int, float, float], ...]


@dataclass
class Track:
    """The best law so far and the history of one search; times count from when it is made."""

    progress: Progress | None = None
    limit: float = np.inf
    best: Parameters | None = None
    least: float = np.inf
    history: list[tuple[int, float, float]] = field(default_factory=list)
    began: float = field(default_factory=time.perf_counter)

    @property
    def seconds(self) -> float:
        """Wall time since the search began."""
        return time.perf_counter() - self.began

    @property
    def late(self) -> bool:
        """Whether the time limit is over."""
        return self.seconds >= self.limit

    def note(self, law: Parameters, cost: float, worth: float | None = None) -> None:
        """Enter one more iterate; worth: what decides which law is best, its cost when left out.

        >>> track, law = Track(), Parameters(*[np.zeros(0)] * 6)
        >>> track.note(law, 2.0), track.note(law._replace(d=np.ones(1)), 3.0), track.best is law
        (None, None, True)
        """
        worth = cost if worth is None else worth
        if worth < self.least:
            self.best, self.least = law, worth
        self.history.append((len(self.history), cost, self.seconds))
        if self.progress is not None:
            self.progress(*self.history[-1])

    def outcome(self, start: Parameters, status: str) -> Outcome:
        """Return what the search came to: the start if nothing was entered."""
        return Outcome(start if self.best is None else self.best, status, tuple(self.history))
