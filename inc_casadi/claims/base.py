"""What a claim promises: a statement about the loop that follows from matrix inequalities."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

from ..inc import INC
from ..loop import ClosedLoop
from ..multipliers.base import Unknown
from ..plant import Plant


class Claim(ABC):
    """A statement about every motion of a loop, with the matrix inequalities that it follows from.

    The theorem behind a claim reads: if the controller is well posed, M is sound (`Multiplier`), `obstacle` names
    nothing, and every matrix of `conditions` is positive definite, then `sentence` is true. The inequalities are
    written with `@ + - * .T` and `blocks` only, so CVXPY, NumPy, CasADi and exact arithmetic all read the same text.
    """

    @abstractmethod
    def check(self, plant: Plant, inc: INC) -> None:
        """Raise an INCError when the claim does not make sense for this plant and controller."""

    @abstractmethod
    def unknowns(self, loop: ClosedLoop) -> tuple[Unknown, ...]:
        """Return the numbers to look for, the multiplier's apart."""

    @abstractmethod
    def conditions(self, loop: ClosedLoop, values: Mapping[str, Any], M: Any) -> dict[str, Any]:
        """Return the named symmetric matrices that must be positive definite; M is the multiplier's matrix."""

    @abstractmethod
    def objective(self, loop: ClosedLoop, values: Mapping[str, Any]) -> Any:
        """Return what to minimize, a 1 x 1 matrix linear in the values, or None when any solution will do."""

    @abstractmethod
    def bound(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return the number that the claim states."""

    @abstractmethod
    def merit(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return how strong the statement is, to compare certificates of one claim: larger is stronger."""

    @abstractmethod
    def sentence(self, loop: ClosedLoop, values: Mapping[str, Any]) -> str:
        """Return what is proved, in one sentence for an engineer."""

    @property
    def yes_or_no(self) -> bool:
        """Whether the claim is the same whatever numbers prove it, so that there is nothing to improve."""
        return False

    def obstacle(self, plant: Plant, inc: INC, *, exactly: bool = False) -> str | None:
        """Return why the claim would not follow from its conditions, or None; `exactly` allows no tolerance."""
        return None
