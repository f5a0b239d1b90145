"""The certified cost as a function of the controller, with its exact gradient from the dual of the matrix inequality."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from inc_casadi.arrays import Array
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.certificate_values import posed_values
from inc_casadi.claims.base import Claim
from inc_casadi.errors import InvalidInputError, NotCertifiedError
from inc_casadi.inc import INC
from inc_casadi.interior_point import solve
from inc_casadi.lmi_assembly import Assembly, assembled
from inc_casadi.lmi_frame import Frame
from inc_casadi.lmi_problem import Solution
from inc_casadi.lmi_search import EXACT_UP_TO, search
from inc_casadi.loop import close_loop
from inc_casadi.multipliers import Multiplier, as_multiplier
from inc_casadi.plant import as_plant

from .condition_graph import ConditionGraph, condition_graph
from .law_family import unflat

INWARD = (0.0, 1e-6, 1e-4, 1e-2, 0.3, 1.0)
GAP, DEEP = 1e-9, 1e-2  # relative gaps of the optimum and of the deeper point


class Gradient(NamedTuple):
    """Derivatives to W (q, q), U (q, p), V (m, q), K (m, p)."""

    W: Array
    U: Array
    V: Array
    K: Array


@dataclass(frozen=True, eq=False)
class CertifiedCost:
    """What `certified_cost` returns.

    certificate: holds; value: what the claim minimizes, tr(P S0) for `DiscountedCost`; gradient: of the value; gap,
    residual: of the dual pair that it comes from, both 0 at the exact optimum; values: the numbers of the certificate;
    deeper: numbers further inside the inequalities, for a search that needs room; frame: of the solver.
    """

    certificate: MatrixCertificate
    value: float
    gradient: Gradient
    gap: float
    residual: float
    deeper: Mapping[str, Array]
    frame: Frame

    @property
    def slope(self) -> Array:
        """The gradient as one vector, in the order of `law_family.flat`."""
        return np.concatenate([part.ravel() for part in self.gradient])


def certified_cost(plant: Any, inc: INC, claim: Claim, multiplier: str | Multiplier = "sector") -> CertifiedCost:
    """Return b(theta), the least bound that a multiplier certifies for a law, and its gradient in theta = (W, U, V, K).

    b(theta) = min over v = (P, multipliers) of c'v subject to L_k(theta; v) >= 0 for each condition k, and signs. With
    multipliers Z_k >= 0 of the constraints the Lagrangian is c'v - sum_k <Z_k, L_k(theta; v)>, and where (v, Z) is the only
    optimum, v strictly feasible for some v', the envelope theorem says

        db = - sum_k <Z_k, dL_k>,   dL_k along theta at the optimal v (signs and c do not depend on theta).

    Where the optimum is not unique, b need not be differentiable, and the figure is that of one optimal pair: an element of
    Clarke's generalized gradient. dL comes from the CasADi reading of the claim (`ConditionGraph`), Z from the
    interior point's X. The biases b and d follow W and V so that the rest point stays (`Family`).

    Parameters
    ----------
    plant : Plant or control.StateSpace
    inc : INC
    claim : one that minimizes: DiscountedCost, or Together with one
    multiplier : a rung by name, or a Multiplier

    Raises
    ------
    NotCertifiedError : no certificate was found with this multiplier: b is infinite there, or rounding spoils it
    InvalidInputError : another claim, or one with nothing to minimize

    Notes
    -----
    Source: Danskin's theorem for semidefinite programs (Shapiro, Math. Programming 77, 1997).

    Examples
    --------
    >>> from inc_casadi import Box, DiscountedCost, LeakyReLU, Plant
    >>> inc = INC([[0.3, 0.2], [0.2, 0.3]], [[1.0], [-1.0]], [[-0.7, 0.7]], [[0.0]], activation=LeakyReLU(0.5))
    >>> claim = DiscountedCost([[1.0]], [[0.05]], 0.98, Box([-1.0], [1.0]))
    >>> cost = certified_cost(Plant([[1.2]], [[1.0]]), inc, claim)
    >>> round(3 * cost.value, 4), cost.gradient.K.round(3).tolist()
    (1.3006, [[0.467]])
    """
    plant, multiplier = as_plant(plant), as_multiplier(multiplier)
    graph = condition_graph(plant, inc, claim, multiplier)
    if graph.goal is None:
        raise InvalidInputError(f"{type(claim).__name__} minimizes nothing, so it has no certified cost")
    found = cost_at(graph, inc)
    if found is None:
        search(plant, inc, claim, multiplier).require()
        raise NotCertifiedError("the optimum of the matrix inequality was not found accurately enough for a gradient")
    return found


def cost_at(graph: ConditionGraph, inc: INC) -> CertifiedCost | None:
    """Return the certified cost of a law of the graph's kind, or None when no certificate that holds is found."""
    programs = programs_at(graph, inc)
    problem = programs.cheapest()
    pair = solve(problem, tolerance=GAP, depth=DEEP)
    if pair.interior is None or not pair.X:
        return None
    certificate = _surviving(programs, pair.y, pair.interior)
    if certificate is None:
        return None
    value = objective(programs, certificate.values)
    unit = objective(programs, programs.values_at(pair.y)) / float(problem.cost @ pair.y)
    slope = -unit * graph.slope(inc, programs.values_at(pair.y), duals(graph, programs.frame, pair))
    return CertifiedCost(certificate, value, Gradient(*unflat(slope, inc)), pair.gap, pair.residual,
                         programs.values_at(pair.interior), programs.frame)


def programs_at(graph: ConditionGraph, inc: INC, frame: Frame | None = None) -> Assembly:
    """Return the semidefinite programs of the graph's claim about another law, in a frame or that of the law's loop."""
    parts = graph.inequalities
    return assembled(close_loop(parts.loop.plant, inc), parts.claim, parts.multiplier, frame)


def duals(graph: ConditionGraph, frame: Frame, pair: Solution) -> dict[str, Array]:
    """Return the Z_k of the conditions themselves: <X, S'L S> = <S X S', L>."""
    S = graph.congruences(frame)
    return {name: S[name] @ X @ S[name].T for name, X in zip(graph.conditions, pair.X, strict=True)}


def objective(programs: Assembly, values: Mapping[str, Array]) -> float:
    """Return what the claim minimizes, at values."""
    parts = programs.inequalities
    return float(np.sum(parts.claim.objective(parts.graphs, values)))


def certificate_of(programs: Assembly, values: Mapping[str, Array]) -> MatrixCertificate:
    """Return the certificate that values make for the programs' loop; it may not hold."""
    parts = programs.inequalities
    return MatrixCertificate(parts.loop.plant, parts.loop.inc, parts.claim, parts.multiplier,
                             {**values, **posed_values(parts.loop.inc)})


def _surviving(programs: Assembly, y: Array, deep: Array) -> MatrixCertificate | None:
    """Return the first certificate that surely holds on the way from the optimum to a deeper point."""
    for part in INWARD:
        certificate = certificate_of(programs, programs.values_at(y + part * (deep - y)))
        if certificate.surely(EXACT_UP_TO):
            return certificate
    return None
