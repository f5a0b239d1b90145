"""Several claims at once, proved by one Lyapunov function."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..errors import InvalidInputError
from ..inc import INC
from ..loop import ClosedLoop
from ..multipliers.base import Multiplier, Unknown
from ..plant import Plant
from .base import POSITIVE, Claim, Graphs

SHARED = ("P", POSITIVE)


@dataclass(frozen=True, eq=False)
class Together(Claim):
    """Several claims with one matrix P for all: V bounds the cost, decays at the rate, and so on. Sufficient.

    Each claim keeps its inequality with a multiplier of its own; only P, and what shows that V > 0, is shared. That makes V
    a single function to reason with (its level sets are invariant and its values bound the cost, say), at the price of a
    weaker figure than each claim would get alone. The first claim that minimizes something is the one that is minimized.

    claims: at least two, none with an open rate: name it. Raises InvalidInputError otherwise.

    >>> from inc_casadi.claims import L2Gain, Stability
    >>> Together((Stability(0.9), L2Gain([[1.0]]))).yes_or_no
    False
    """

    claims: tuple[Claim, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "claims", tuple(self.claims))
        if len(self.claims) < 2 or not all(isinstance(claim, Claim) for claim in self.claims):
            raise InvalidInputError(f"claims is {self.claims!r}, but must be at least two Claims")
        for claim in self.claims:
            if isinstance(claim, Together) or claim.tunable:
                raise InvalidInputError(f"{type(claim).__name__} cannot share P here: give every claim its rate or level, "
                                        "and do not nest Together")

    def check(self, plant: Plant, inc: INC) -> None:
        """Raise what any of the claims raises."""
        for claim in self.claims:
            claim.check(plant, inc)

    def refusal(self, loop: ClosedLoop, multiplier: Multiplier) -> str | None:
        """Return the first refusal of any claim."""
        return next((why for claim in self.claims if (why := claim.refusal(loop, multiplier))), None)

    def graphs(self, loop: ClosedLoop, multiplier: Multiplier) -> dict[str, ClosedLoop]:
        """Return every claim's graphs, under its number."""
        return {_tagged(name, i): graph for i, claim in enumerate(self.claims)
                for name, graph in claim.graphs(loop, multiplier).items()}

    def unknowns(self, graphs: Graphs) -> tuple[Unknown, ...]:
        """Return every claim's unknowns, P once."""
        found: dict[str, Unknown] = {}
        for i, claim in enumerate(self.claims):
            for unknown in claim.unknowns(_of(graphs, i)):
                name = _tagged(unknown.name, i)
                found.setdefault(name, Unknown(name, unknown.shape, unknown.kind, unknown.zero, unknown.unsigned))
        return tuple(found.values())

    def conditions(self, graphs: Graphs, values: Mapping[str, Any], M: Mapping[str, Any]) -> dict[str, Any]:
        """Return every claim's conditions, V > 0 once."""
        found: dict[str, Any] = {}
        for i, claim in enumerate(self.claims):
            for name, condition in claim.conditions(_of(graphs, i), _of(values, i), _of(M, i)).items():
                found.setdefault(_tagged(name, i), condition)
        return found

    def objective(self, graphs: Graphs, values: Mapping[str, Any]) -> Any:
        """Return the first objective that there is, or None."""
        for i, claim in enumerate(self.claims):
            goal = claim.objective(_of(graphs, i), _of(values, i))
            if goal is not None:
                return goal
        return None

    def bound(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return the bound of the claim that is minimized, or of the first."""
        i = self._leading
        return self.claims[i].bound(loop, _of(values, i))

    def merit(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return the merit of the claim that is minimized, or of the first."""
        i = self._leading
        return self.claims[i].merit(loop, _of(values, i))

    @property
    def compound(self) -> bool:
        """Yes."""
        return True

    @property
    def yes_or_no(self) -> bool:
        """Whether no claim has anything to improve."""
        return all(claim.yes_or_no for claim in self.claims)

    @property
    def sums(self) -> bool:
        """Whether every claim's proof sums with weights that do not grow."""
        return all(claim.sums for claim in self.claims)

    def sentence(self, loop: ClosedLoop, values: Mapping[str, Any]) -> str:
        """Return all the promises."""
        parts = [claim.sentence(loop, _of(values, i)) for i, claim in enumerate(self.claims)]
        return "With one Lyapunov function for all: " + " ".join(f"({i + 1}) {part}" for i, part in enumerate(parts))

    def obstacle(self, plant: Plant, inc: INC, *, exactly: bool = False) -> str | None:
        """Return the first obstacle of any claim."""
        return next((why for claim in self.claims if (why := claim.obstacle(plant, inc, exactly=exactly))), None)

    def growth(self, discrete: bool) -> float | None:
        """Return the least that any of the claims allows."""
        return min((found for claim in self.claims if (found := claim.growth(discrete)) is not None), default=None)

    @property
    def _leading(self) -> int:
        return next((i for i, claim in enumerate(self.claims) if not claim.yes_or_no), 0)


def _tagged(name: str, i: int) -> str:
    return name if name in SHARED else f"{name} [{i + 1}]"


def _of(parts: Mapping[str, Any], i: int) -> dict[str, Any]:
    """Return the parts of one claim under the names that it uses."""
    tag = f" [{i + 1}]"
    own = {key.removesuffix(tag): part for key, part in parts.items() if key.endswith(tag)}
    return own | {key: part for key, part in parts.items() if key in SHARED}
