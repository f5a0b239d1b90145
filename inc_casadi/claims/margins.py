"""Gain and phase margins at the plant input."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..arrays import number
from ..inc import INC
from ..loop import ClosedLoop
from ..multipliers.base import Multiplier, Unknown
from ..plant import Plant
from ..uncertainty import InputSector
from .base import Claim, Graphs
from .robust import Robust
from .stability import Stability


@dataclass(frozen=True, eq=False)
class Margins(Claim):
    """The loop stays stable when every plant input is off in gain or in phase, by a disk margin. Sufficient.

    `Robust(Stability(), InputSector.disk(alpha))`: gains in [(2 - alpha)/(2 + alpha), (2 + alpha)/(2 - alpha)] in each
    channel, nonlinear and time-varying ones included, and phase lags up to 2 arctan(alpha / 2). alpha None: the largest
    that is found, below 2. An open-loop unstable plant has alpha < 2, for the gain 0 must be out of the disk.

    Raises InvalidInputError for alpha outside [0, 2).

    >>> Margins(0.5).alpha
    0.5
    """

    alpha: float | None = None

    def __post_init__(self) -> None:
        if self.alpha is not None:
            object.__setattr__(self, "alpha", number("alpha", self.alpha, 0.0, 2.0, open_high=True))

    def check(self, plant: Plant, inc: INC) -> None:
        """Raise for a biased controller."""
        self._robust.check(plant, inc)

    def refusal(self, loop: ClosedLoop, multiplier: Multiplier) -> str | None:
        """Return why the multiplier does not apply to the loop with w."""
        return self._robust.refusal(loop, multiplier)

    def graphs(self, loop: ClosedLoop, multiplier: Multiplier) -> dict[str, ClosedLoop]:
        """Return the graphs of the loop with w = psi(u) - u."""
        return self._robust.graphs(loop, multiplier)

    def unknowns(self, graphs: Graphs) -> tuple[Unknown, ...]:
        """Return P and tau (m,)."""
        return self._robust.unknowns(graphs)

    def conditions(self, graphs: Graphs, values: Mapping[str, Any], M: Mapping[str, Any]) -> dict[str, Any]:
        """Return V > 0 and the decrease, over the stack with w."""
        return self._robust.conditions(graphs, values, M)

    def bound(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return alpha."""
        return 0.0 if self.alpha is None else self.alpha

    def merit(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return alpha: the larger the stronger."""
        return self.bound(loop, values)

    @property
    def uncertain(self) -> bool:
        """Yes."""
        return True

    @property
    def yes_or_no(self) -> bool:
        """Whether alpha was asked for."""
        return self.alpha is not None

    @property
    def tunable(self) -> bool:
        """Whether alpha is left open."""
        return self.alpha is None

    def at(self, level: float, loop: ClosedLoop) -> Margins:
        """Return the claim at that alpha."""
        return Margins(level)

    def ceiling(self, loop: ClosedLoop) -> float:
        """Return 2."""
        return 2.0

    def growth(self, discrete: bool) -> float:
        """Return 1 or 0: the plant itself is in the disk, so its loop must be stable."""
        return 1.0 if discrete else 0.0

    def sentence(self, loop: ClosedLoop, values: Mapping[str, Any]) -> str:
        """Return the promise with its margins."""
        return self._robust.sentence(loop, values)

    @property
    def _robust(self) -> Robust:
        return Robust(Stability(), InputSector.disk(0.0 if self.alpha is None else self.alpha))
