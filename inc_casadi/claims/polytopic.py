"""A claim for every plant of a polytope of plants, by one Lyapunov function."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import DimensionError, InvalidInputError
from ..inc import INC
from ..loop import ClosedLoop, close_loop
from ..multipliers.base import Multiplier, Unknown
from ..plant import Plant, as_plant
from ..readings import Reading
from .base import DECREASE, Claim, Graphs
from .robust import NOT_BIASED


@dataclass(frozen=True, eq=False)
class Polytopic(Claim):
    """A claim that holds for every (A, B) in the convex hull of several plants, time-varying ones included. Sufficient.

    The claim's inequality is asked at each vertex (A_i, B_i) with one P and a multiplier M_i of its own. -F'P F is concave
    and the flow is linear in F, which is affine in (A, B), and Z, G do not depend on them; so the weighted sum of the
    vertices' inequalities gives that of the mixture, with M the weighted sum of the M_i, which is nonnegative on
    the same graph (Boyd et al., Linear Matrix Inequalities in System and Control Theory, 1994, ch. 5 and 7).

    claim: `Stability`, `DiscountedCost` or `L2Gain`; plants: the further vertices; the plant that is certified is one
    too. All must share C, dt and the sizes. Raises InvalidInputError or DimensionError otherwise, and for a biased
    controller.

    >>> from inc_casadi.claims import Stability
    >>> len(Polytopic(Stability(), (Plant([[0.5]], [[1.0]]), Plant([[0.4]], [[1.1]]))).plants)
    2
    """

    claim: Claim
    plants: tuple[Plant, ...]

    def __post_init__(self) -> None:
        if not isinstance(self.claim, Claim) or self.claim.compound:
            raise InvalidInputError(f"claim is {self.claim!r}, but must be a Claim about one plant")
        object.__setattr__(self, "plants", tuple(as_plant(plant) for plant in self.plants))
        if not self.plants:
            raise InvalidInputError("plants is empty: a polytope needs further vertices")

    def check(self, plant: Plant, inc: INC) -> None:
        """Raise when the vertices do not fit the plant, or the controller is biased."""
        self.claim.check(plant, inc)
        for i, other in enumerate(self.plants):
            if (other.n, other.m, other.p) != (plant.n, plant.m, plant.p):
                raise DimensionError(f"vertex {i + 1} has sizes (n, m, p) = {(other.n, other.m, other.p)}, but the plant "
                                     f"has {(plant.n, plant.m, plant.p)}")
            if other.dt != plant.dt or not np.array_equal(other.C, plant.C):
                raise InvalidInputError(f"vertex {i + 1} has another C or dt than the plant: the mixture of the "
                                        "inequalities needs one measurement")
        if not inc.preserves_origin:
            raise InvalidInputError(f"a polytopic claim cannot be made: {NOT_BIASED}")

    def refusal(self, loop: ClosedLoop, multiplier: Multiplier) -> str | None:
        """Return why not: V must depend on x alone, for later hidden vectors would depend on the plant's matrices."""
        if multiplier.steps:
            return ("for a polytope of plants the Lyapunov function must depend on x alone: hidden vectors to come differ "
                    "by plant")
        return self.claim.refusal(loop, multiplier)

    def graphs(self, loop: ClosedLoop, multiplier: Multiplier) -> dict[str, ClosedLoop]:
        """Return the step of each vertex: the plant's own under its usual name."""
        found = self.claim.graphs(loop, multiplier)
        for i, plant in enumerate(self.plants):
            other = close_loop(plant, loop.inc)
            other = other.read(type(loop.F)) if isinstance(loop.F, Reading) else other
            found[f"{DECREASE} at vertex {i + 1}"] = self.claim.graphs(other, multiplier)[DECREASE]
        return found

    def unknowns(self, graphs: Graphs) -> tuple[Unknown, ...]:
        """Return the claim's unknowns, shared by all vertices."""
        return self.claim.unknowns(_of_vertex(graphs, DECREASE))

    def conditions(self, graphs: Graphs, values: Mapping[str, Any], M: Mapping[str, Any]) -> dict[str, Any]:
        """Return V > 0 and the decrease at each vertex."""
        found: dict[str, Any] = {}
        for name in [name for name in graphs if name.startswith(DECREASE)]:
            for key, condition in self.claim.conditions(_of_vertex(graphs, name), values, _of_vertex(M, name)).items():
                found.setdefault(name if key == DECREASE else key, condition)
        return found

    def objective(self, graphs: Graphs, values: Mapping[str, Any]) -> Any:
        """Return the claim's objective."""
        return self.claim.objective(_of_vertex(graphs, DECREASE), values)

    def bound(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return the claim's bound."""
        return self.claim.bound(loop, values)

    def merit(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return the claim's merit."""
        return self.claim.merit(loop, values)

    @property
    def compound(self) -> bool:
        """Yes."""
        return True

    @property
    def sums(self) -> bool:
        """Whether the claim's proof sums with weights that do not grow."""
        return self.claim.sums

    @property
    def yes_or_no(self) -> bool:
        """Whether the claim is."""
        return self.claim.yes_or_no

    @property
    def tunable(self) -> bool:
        """Whether the claim leaves a level open."""
        return self.claim.tunable

    def at(self, level: float, loop: ClosedLoop) -> Polytopic:
        """Return the claim at that level, for the same plants."""
        return Polytopic(self.claim.at(level, loop), self.plants)

    def ceiling(self, loop: ClosedLoop) -> float:
        """Return the claim's ceiling."""
        return self.claim.ceiling(loop)

    def sentence(self, loop: ClosedLoop, values: Mapping[str, Any]) -> str:
        """Return the promise, for every plant of the polytope."""
        return (f"For every plant, time-varying ones included, in the convex hull of the {len(self.plants) + 1} given: "
                f"{self.claim.sentence(loop, values)}")

    def obstacle(self, plant: Plant, inc: INC, *, exactly: bool = False) -> str | None:
        """Return the claim's obstacle."""
        return self.claim.obstacle(plant, inc, exactly=exactly)


def _of_vertex(parts: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return what the claim knows of one vertex under the names that it uses."""
    return {key: part for key, part in parts.items() if not key.startswith(DECREASE)} | {DECREASE: parts[name]}
