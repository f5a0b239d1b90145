"""What is known of one controller: whether it keeps the limits and converges, what it costs, and how each is known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf, nan
from typing import Any, Protocol

from ..brief import Brief
from ..certificate import Proof
from .families import ANY, Family

CERTIFIED, SEEN, VIOLATED, OPEN = "certified", "seen in simulation", "violated", "unknown"
EXACT, UPPER, LYAPUNOV, SIMULATED, NOTHING = "exact", "upper bound", "Lyapunov", "simulated", "unknown"


class Evidence(Protocol):
    """What a row rests on: it recomputes its verdict from stored numbers, and settles it rigorously when asked."""

    def holds(self) -> bool:
        """Return whether the numbers prove it."""

    def prove(self) -> Proof:
        """Settle it rigorously."""


@dataclass(frozen=True)
class Finding:
    """An answer to a yes-or-no question. verdict: CERTIFIED, SEEN, VIOLATED or OPEN; reason: why, in words."""

    verdict: str
    reason: str


@dataclass(frozen=True, eq=False)
class Cost(Brief):
    """The expected discounted cost of a controller.

    Parameters
    ----------
    value : rounded up where `evidence` certifies it, the mean where it is simulated, NaN where nothing is known
    how : EXACT (certified up to rounding), UPPER (certified, perhaps too large), LYAPUNOV (a linear loop's), SIMULATED or
        NOTHING
    error : standard error of a simulated mean
    evidence : what certifies `value`, or None; in words
    """

    value: float = nan
    how: str = NOTHING
    error: float = 0.0
    evidence: Evidence | None = field(default=None, repr=False)
    words: str = ""


UNASKED, NO_LIMITS = Finding(OPEN, "not examined"), Finding(CERTIFIED, "there are no input limits")


@dataclass(frozen=True, eq=False)
class Row(Brief):
    """One controller of a comparison.

    Parameters
    ----------
    name, controller : as given
    kind : what it is, in words
    family : the smallest of the classes that contains it
    limits : whether every input stays within its limits, from every initial state
    converges : whether every motion comes to rest
    cost : what it costs
    worst : certified largest cost over the initial set, NaN when not known
    grounds : certificates, other than that of the cost, that `limits` rests on
    seconds : wall time
    notes : what was tried and failed, with reasons
    """

    name: str
    controller: Any = field(repr=False)
    kind: str
    family: Family = ANY
    limits: Finding = UNASKED
    converges: Finding = UNASKED
    cost: Cost = Cost()
    worst: float = nan
    grounds: tuple[Evidence, ...] = field(default=(), repr=False)
    seconds: float = 0.0
    notes: tuple[str, ...] = ()

    @property
    def evidence(self) -> Iterator[Evidence]:
        """All certificates of the row, that of the cost first."""
        if self.cost.evidence is not None:
            yield self.cost.evidence
        yield from self.grounds

    @property
    def certified(self) -> bool:
        """Whether limits and cost are both certified: recomputed from the certificates."""
        certain = self.limits.verdict == CERTIFIED and self.cost.evidence is not None
        return certain and all(one.holds() for one in self.evidence)

    @property
    def bound(self) -> float:
        """What the controller costs at most as a member of its class, infinite unless certified."""
        return self.cost.value if self.certified else inf

    def prove(self) -> Proof:
        """Settle all certificates of the row rigorously, up to the first that fails."""
        seconds, means = 0.0, []
        if self.limits.verdict != CERTIFIED or self.cost.evidence is None:
            return Proof(False, "none", 0.0, f"{self.name} has no certified cost within the limits")
        for one in self.evidence:
            proof = one.prove()
            seconds += proof.seconds
            if not proof:
                return Proof(False, proof.method, seconds, proof.reason)
            means.append(proof.method)
        return Proof(True, ", ".join(dict.fromkeys(means)), seconds)
