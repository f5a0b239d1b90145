"""A claim with its multipliers over the loops it speaks of: all that its inequalities need but the values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from .arrays import Array
from .claims.base import DECREASE, Claim, Graphs
from .loop import ClosedLoop
from .multipliers import Multiplier, Unknown


def named(unknown: str, graph: str) -> str:
    """Return the name of a multiplier's unknown for one of the claim's graphs; the step's own keeps its name.

    >>> named("Lambda", "decrease"), named("Lambda", "positive")
    ('Lambda', 'Lambda (positive)')
    """
    return unknown if graph == DECREASE else f"{unknown} ({graph})"


def own_values(values: Mapping[str, Any], unknowns: tuple[Unknown, ...], graph: str) -> dict[str, Any]:
    """Return the values of a graph's multiplier under the multiplier's own names."""
    return {unknown.name: values[named(unknown.name, graph)] for unknown in unknowns}


@dataclass(frozen=True, eq=False)
class Inequalities:
    """A claim over its graphs with a multiplier for each: everything a reading needs but the values.

    loop: as read, in some arithmetic; graphs: the claim's, in the same.

    >>> from inc_casadi import INC, Plant, close_loop
    >>> from inc_casadi.claims import Stability
    >>> from inc_casadi.multipliers import Sector
    >>> law = INC([[0.0]], [[1.0]], [[0.2]], [[0.0]])
    >>> [u.name for u in Inequalities(close_loop(Plant([[0.5]], [[1.0]]), law), Stability(0.9), Sector()).unknowns]
    ['P', 'Lambda']
    """

    loop: ClosedLoop
    claim: Claim
    multiplier: Multiplier
    graphs: Graphs = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "graphs", self.claim.graphs(self.loop, self.multiplier))

    @cached_property
    def of_graph(self) -> dict[str, tuple[Unknown, ...]]:
        """The multiplier's unknowns for each graph."""
        return {name: self.multiplier.unknowns(graph) for name, graph in self.graphs.items()}

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """All unknowns: the claim's, then each graph's under its full name."""
        found = list(self.claim.unknowns(self.graphs))
        for graph, unknowns in self.of_graph.items():
            found += [Unknown(named(u.name, graph), u.shape, u.kind, u.zero, u.unsigned) for u in unknowns]
        return tuple(found)

    def conditions(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the named matrices that must be positive definite, of the kind of the values."""
        return self.claim.conditions(self.graphs, values, self.multiplier_matrices(values))

    def multiplier_matrices(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the multiplier's matrix for each graph."""
        return {name: self.multiplier.matrix(graph, own_values(values, self.of_graph[name], name))
                for name, graph in self.graphs.items()}

    def signs(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the named matrices whose entries must be nonnegative, besides signed unknowns."""
        return {named(sign, name): entries for name, graph in self.graphs.items()
                for sign, entries in self.multiplier.signs(graph, own_values(values, self.of_graph[name], name)).items()}

    def zeros(self) -> dict[str, Array]:
        """Return zero for every unknown."""
        return {unknown.name: np.zeros(unknown.shape) for unknown in self.unknowns}
