"""What the phases of one training have come to, whatever program each of them solves."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .outcome import Outcome
from .rollout import Parameters


@dataclass
class PhaseLog:
    """Status and history of a training over all of its phases, and what is left of its time.

    began: the `time.perf_counter` of its beginning; limit: seconds; progress: called with each row of the history;
    history: dict(phase, iteration, cost, seconds) per iterate, seconds from the beginning of the training.
    """

    began: float
    limit: float
    progress: Callable[[dict[str, Any]], None] | None
    status: str = "nothing searched"
    history: list[dict[str, Any]] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Wall time since the training began."""
        return time.perf_counter() - self.began

    @property
    def is_over(self) -> bool:
        """Whether no further phase is to begin: the last one was interrupted, or the time is up."""
        return self.status == "interrupted" or self.seconds >= self.limit

    @property
    def iterations(self) -> int:
        """How many iterates there were beside the beginnings of the phases."""
        return sum(row["iteration"] > 0 for row in self.history)

    def entered(self, name: str, solve: Callable[..., Outcome]) -> Parameters:
        """Return the law that a phase ends with, the phase entered into the log.

        solve: called with `progress`, to be told (iteration, cost, seconds), and `time_limit`, what is left, or None.

        >>> log, law = PhaseLog(time.perf_counter(), np.inf, None), Parameters(*[np.zeros(0)] * 6)
        >>> log.entered("coarse", lambda progress, time_limit: Outcome(law, "solved", ((0, 2.0, 0.1),))) is law
        True
        >>> log.status, log.history[0]["phase"], log.history[0]["cost"]
        ('solved', 'coarse', 2.0)
        """
        begun = self.seconds

        def row(iteration: int, cost: float, seconds: float) -> dict[str, Any]:
            return {"phase": name, "iteration": iteration, "cost": cost, "seconds": begun + seconds}

        def report(iteration: int, cost: float, seconds: float) -> None:
            if self.progress is not None:
                self.progress(row(iteration, cost, seconds))

        outcome = solve(progress=report, time_limit=None if np.isinf(self.limit) else self.limit - begun)
        self.status = outcome.status
        self.history += [row(*values) for values in outcome.history]
        return outcome.law
