"""The time that a bound may take. What is found by then is a bound as well, only a lower one."""

from __future__ import annotations

import time
from dataclasses import dataclass
from math import inf

from ..arrays import number


@dataclass(frozen=True)
class Clock:
    """When to stop: `until` is of time.monotonic(), infinite without a limit."""

    until: float = inf

    @classmethod
    def of(cls, seconds: float | None) -> Clock:
        """Return the clock that runs out after so many seconds from now, never when left out.

        Raises InvalidInputError for seconds below 0 or NaN.

        >>> Clock.of(None).is_over, Clock.of(0.0).is_over
        (False, True)
        """
        return cls() if seconds is None else cls(time.monotonic() + number("seconds", seconds, 0.0))

    @property
    def left(self) -> float:
        """Seconds left, at least 0; infinite without a limit."""
        return max(0.0, self.until - time.monotonic())

    @property
    def is_over(self) -> bool:
        """Whether nothing is left."""
        return time.monotonic() >= self.until

    @property
    def is_set(self) -> bool:
        """Whether there is a limit at all."""
        return self.until < inf
