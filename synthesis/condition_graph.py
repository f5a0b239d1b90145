"""The CasADi reading of a claim: its matrix inequalities as functions of the controller, with exact derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from inc_casadi.arrays import Array
from inc_casadi.claims import DiscountedCost, Stability
from inc_casadi.claims.base import POSITIVE, Claim
from inc_casadi.claims.together import Together
from inc_casadi.errors import InvalidInputError, SolverError
from inc_casadi.inc import INC
from inc_casadi.inequalities import Inequalities
from inc_casadi.lmi_frame import Frame
from inc_casadi.loop import close_loop, stacked_matrices
from inc_casadi.multipliers import Multiplier
from inc_casadi.plant import Plant

from .law_family import NAMES, flat

try:
    import casadi as ca
except ImportError as error:
    raise SolverError("derivatives of matrix inequalities need CasADi: pip install casadi") from error

Values = Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class ConditionGraph:
    """L_k(theta; values) for each condition k of a claim, as CasADi expressions; the claim asks for L_k > 0.

    One formula is read: the claim's own `conditions`, with F, G, Z of the loop formed from symbols W, U, V, K. What a
    multiplier takes from the rest point (`Family` keeps it) is a constant.

    inequalities: over floats, at the law that the graph was made of; theta: (P, 1) symbols, W, U, V, K row by row;
    unknowns: one symbol per unknown of claim and multiplier; conditions: the L_k; goal: what the claim minimizes, or None.
    """

    inequalities: Inequalities
    theta: Any
    unknowns: dict[str, Any]
    conditions: dict[str, Any]
    goal: Any

    @cached_property
    def moving(self) -> tuple[str, ...]:
        """The conditions that depend on the controller: P > 0 alone does not."""
        return tuple(name for name, L in self.conditions.items() if ca.depends_on(ca.SX(L), self.theta))

    def at(self, inc: INC, values: Values) -> dict[str, Array]:
        """Return every L_k as numbers."""
        found = self._matrices(flat(inc), *self._listed(values))
        listed = found if isinstance(found, tuple | list) else [found]
        return {name: _even(L.full()) for name, L in zip(self.conditions, listed, strict=True)}

    def slope(self, inc: INC, values: Values, Z: Mapping[str, Array]) -> Array:
        """Return the gradient (P,) of sum_k <Z_k, L_k> in theta; a Z that is missing counts as zero."""
        weights = [Z.get(name, np.zeros(L.shape)) for name, L in self.conditions.items()]
        return self._slope(flat(inc), *self._listed(values), *weights).full().ravel()

    def congruences(self, frame: Frame) -> dict[str, Array]:
        """Return for each condition the S in whose coordinates S'L_k S is of size one."""
        graphs = self.inequalities.graphs
        found = {}
        for name in self.conditions:
            graph = graphs.get(POSITIVE if name == "P" else name)
            found[name] = frame.back if graph is None else frame.congruence(graph)
        return found

    def _listed(self, values: Values) -> list[Array]:
        return [values[name] for name in self.unknowns]

    @cached_property
    def _matrices(self) -> Any:
        return ca.Function("conditions", [self.theta, *self.unknowns.values()], list(self.conditions.values()))

    @cached_property
    def _slope(self) -> Any:
        Z = [ca.SX.sym(f"Z{k}", *L.shape) for k, L in enumerate(self.conditions.values())]
        total = sum((ca.dot(z, L) for z, L in zip(Z, self.conditions.values(), strict=True)), start=ca.SX(0))
        inputs = [self.theta, *self.unknowns.values(), *Z]
        return ca.Function("slope", inputs, [ca.densify(ca.gradient(total, self.theta))])


def condition_graph(plant: Plant, inc: INC, claim: Claim, multiplier: Multiplier) -> ConditionGraph:
    """Return the inequalities of a claim about a law as functions of its W, U, V, K.

    Raises InvalidInputError for a claim that is not read this way, or one that the multiplier refuses.

    >>> from inc_casadi.multipliers import Sector
    >>> law = INC([[0.0]], [[1.0]], [[0.2]], [[0.0]])
    >>> graph = condition_graph(Plant([[0.5]], [[1.0]]), law, Stability(0.9), Sector())
    >>> graph.moving, graph.at(law, {"P": np.eye(1), "Lambda": np.ones(1)})["decrease"].round(9).tolist()
    (('decrease',), [[0.56, -1.1], [-1.1, 1.96]])
    """
    readable(claim)
    loop = close_loop(plant, inc)
    refusal = claim.refusal(loop, multiplier)
    if refusal:
        raise InvalidInputError(f"the {multiplier.name} multiplier does not apply: {refusal}")
    rows = [ca.SX.sym(name, getattr(inc, name).size) for name in NAMES]
    matrices = [ca.reshape(part, *reversed(getattr(inc, name).shape)).T for name, part in zip(NAMES, rows, strict=True)]
    F, G, Z, _, _ = stacked_matrices(plant.A, plant.B, plant.C, *matrices)
    symbolic = Inequalities(replace(loop, F=F, G=G, Z=Z), claim, multiplier)
    unknowns = {unknown.name: ca.SX.sym(unknown.name, *unknown.shape) for unknown in symbolic.unknowns}
    conditions = {name: ca.SX(L) for name, L in symbolic.conditions(unknowns).items()}
    goal = claim.objective(symbolic.graphs, unknowns)
    return ConditionGraph(Inequalities(loop, claim, multiplier), ca.vertcat(*rows), unknowns, conditions, goal)


def readable(claim: Claim) -> None:
    """Raise InvalidInputError for a claim whose inequalities are not formed from F, G and Z alone."""
    parts = claim.claims if isinstance(claim, Together) else (claim,)
    for part in parts:
        if not isinstance(part, DiscountedCost | Stability):
            raise InvalidInputError(f"{type(part).__name__} is not differentiated: DiscountedCost is, and Stability with a "
                                    "rate, and Together of these")
        if part.tunable:
            raise InvalidInputError("Stability without a rate has no fixed inequality: name the rate")


def _even(L: Array) -> Array:
    return (L + L.T) / 2
