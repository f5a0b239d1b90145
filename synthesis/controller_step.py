"""The controller's step of the BMI loop: one NLP in which the matrix inequality is imposed by a factorization."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from inc_casadi.arrays import Array
from inc_casadi.claims.base import POSITIVE
from inc_casadi.inc import INC
from inc_casadi.lmi_frame import Frame
from inc_casadi.multipliers import Unknown

from .condition_graph import ConditionGraph, ca
from .law_family import Family, flat
from .law_variables import Nlp, law_of, law_start, law_variables

WAYS = ("joint", "fixed", "gradient")
EPS = 1e-7  # the factor's least squared diagonal: S'LS > 0 in coordinates where it is of size one
ITERATIONS = 60


@dataclass(frozen=True, eq=False)
class ControllerStep:
    """An NLP over the controller's free entries, built once for a rung and a frame, solved from any law of the family.

    way: what is searched beside theta. "joint": the certificate's numbers too, the claim's objective is minimized: the
    whole bilinear problem, near the point. "fixed": nothing, the numbers (P, multipliers) stay and the first-order model
    slope'theta of the certified cost is minimized: alternation proper. "gradient": nothing, and the model is
    slope'd + d'Bd / 2 without the matrix inequality.

    In the first two each condition is imposed as S'L(theta; v)S = R R', R lower triangular with R_ii^2 >= EPS, S the frame's
    congruence. unit: what the objective is divided by.
    """

    graph: ConditionGraph
    family: Family
    frame: Frame
    way: str
    unit: float
    conditions: tuple[str, ...]
    low: Array
    bounds: tuple[Array, Array]
    solver: Any

    def propose(self, family: Family, values: Mapping[str, Array], slope: Array, radius: float,
                B: Array | None = None) -> INC:
        """Return the law that the NLP ends with, within `radius` times the scales of theta; its claims are not checked.

        values: strictly feasible numbers at the start; slope (P,), B (P, P): of the model.
        """
        law, low, high = law_start(family, radius)
        parts, lows, highs = [law], [low], [high]
        if self.way == "joint":
            parts.append(_listed(self.graph, self.frame, values))
        if self.way != "gradient":
            parts += self._factors(family.start, values)
        rest = np.concatenate([np.zeros(0), *parts[1:]])
        lows.append(self.low[law.size:])
        highs.append(np.full(rest.size, np.inf))
        parameters = [flat(family.start), slope]
        if self.way == "fixed":
            parameters += [np.ravel(values[name], order="F") for name in self.graph.unknowns]
        if self.way == "gradient":
            parameters.append(np.ravel(np.zeros((slope.size,) * 2) if B is None else B, order="F"))
        try:
            answer = self.solver(x0=np.concatenate([law, rest]), lbx=np.concatenate(lows), ubx=np.concatenate(highs),
                                 lbg=self.bounds[0], ubg=self.bounds[1], p=np.concatenate(parameters))
        except RuntimeError:  # a solver that fails has proposed nothing
            return family.start
        if self.solver.stats()["return_status"] == "User_Requested_Stop":
            raise KeyboardInterrupt
        return law_of(family, answer["x"].full().ravel()[: law.size])

    def _factors(self, inc: INC, values: Mapping[str, Array]) -> list[Array]:
        """Return the entries of each R at the start, where rounding may have left a condition a trifle too small."""
        S, L = self.graph.congruences(self.frame), self.graph.at(inc, values)
        seen = [S[name].T @ L[name] @ S[name] for name in self.conditions]
        lifts = [max(EPS - float(np.linalg.eigvalsh(part)[0]), 0.0) for part in seen]
        roots = [np.linalg.cholesky(part + lift * np.eye(len(part))) for part, lift in zip(seen, lifts, strict=True)]
        return [root[np.tril_indices(len(root))] for root in roots]


def controller_step(graph: ConditionGraph, family: Family, frame: Frame, way: str, unit: float = 1.0, *,
                    seconds: float | None = None) -> ControllerStep:
    """Return the NLP of a way ("joint", "fixed", "gradient"); unit: the size of the objective, which is divided by it."""
    nlp = Nlp()
    theta0, slope = ca.SX.sym("theta0", family.free.size), ca.SX.sym("slope", family.free.size)
    nlp.p += [theta0, slope]
    theta = law_variables(nlp, family, theta0)
    goal = ca.dot(slope, theta - theta0) / unit
    conditions: tuple[str, ...] = ()
    if way == "gradient":
        B = ca.SX.sym("B", family.free.size, family.free.size)
        nlp.p.append(ca.vec(B))
        goal += ca.bilin(B, theta - theta0, theta - theta0) / (2 * unit)
    else:
        values = _numbers(nlp, graph, frame, way)
        if way == "joint":
            goal = _at(graph, [graph.goal], theta, values)[0] / unit
        conditions = tuple(graph.conditions) if way == "joint" else graph.moving
        S = graph.congruences(frame)
        for name, L in zip(conditions, _at(graph, [graph.conditions[name] for name in conditions], theta, values),
                           strict=True):
            _impose(nlp, name, ca.mtimes([ca.DM(S[name].T), L, ca.DM(S[name])]))
    problem = {"x": ca.vertcat(*nlp.x), "f": goal, "g": ca.vertcat(*nlp.g), "p": ca.vertcat(*nlp.p)}
    solver = ca.nlpsol("controller", "ipopt", problem, _options(seconds))
    return ControllerStep(graph, family, frame, way, unit, conditions, np.concatenate(nlp.low),
                          (np.concatenate([np.zeros(0), *nlp.low_g]), np.concatenate([np.zeros(0), *nlp.high_g])), solver)


def _numbers(nlp: Nlp, graph: ConditionGraph, frame: Frame, way: str) -> list[Any]:
    """Append the certificate's numbers, as parameters or as variables with their signs, and return their matrices."""
    if way == "fixed":
        nlp.p += [ca.vec(symbol) for symbol in graph.unknowns.values()]
        return list(graph.unknowns.values())
    found = []
    for unknown in graph.inequalities.unknowns:
        entries = _entries(unknown)
        v = nlp.variable(unknown.name, np.where(unknown.signed[entries], 0.0, -np.inf))
        value = ca.SX(unknown.shape[0], unknown.shape[1] if len(unknown.shape) == 2 else 1)
        for k, place in enumerate(zip(*entries, strict=True)):
            value[tuple(map(int, place))] = v[k]
            if unknown.is_symmetric:
                value[tuple(map(int, place[::-1]))] = v[k]
        back = np.linalg.inv(_axes(graph, frame, unknown))
        found.append(ca.mtimes([ca.DM(back.T), value, ca.DM(back)]) if len(unknown.shape) == 2
                     and unknown.kind == "symmetric" else value)
    for sign in graph.inequalities.signs(dict(zip(graph.unknowns, found, strict=True))).values():
        nlp.constraint(ca.SX(sign), 0.0, np.inf)
    return found


def _listed(graph: ConditionGraph, frame: Frame, values: Mapping[str, Array]) -> Array:
    """Return the variables of given numbers."""
    parts = [np.zeros(0)]
    for unknown in graph.inequalities.unknowns:
        value = np.asarray(values[unknown.name])
        if unknown.kind == "symmetric":
            S = _axes(graph, frame, unknown)
            value = S.T @ value @ S
        parts.append(value[_entries(unknown)])
    return np.concatenate(parts)


def _entries(unknown: Unknown) -> tuple[Array, ...]:
    free = np.tril(unknown.free) if unknown.is_symmetric else unknown.free
    return np.nonzero(free)


def _axes(graph: ConditionGraph, frame: Frame, unknown: Unknown) -> Array:
    """Return the S of a symmetric unknown over states, whose S'PS is of size one; the identity for another."""
    parts, k = graph.inequalities, unknown.shape[0]
    if unknown.kind != "symmetric" or k < parts.loop.n:
        return np.eye(k)
    return frame.back if k == parts.loop.n else frame.congruence(parts.graphs[POSITIVE])[:k, :k]


def _at(graph: ConditionGraph, expressions: list[Any], theta: Any, values: list[Any]) -> list[Any]:
    """Return expressions of the graph with theta and the unknowns replaced."""
    function = ca.Function("at", [graph.theta, *graph.unknowns.values()], expressions)
    found = function(theta, *values)
    return list(found) if isinstance(found, tuple | list) else [found]


def _impose(nlp: Nlp, name: str, L: Any) -> None:
    """Append R and L = R R', on and below the diagonal."""
    size = L.shape[0]
    rows, columns = np.tril_indices(size)
    entries = nlp.variable(f"R {name}", np.where(rows == columns, np.sqrt(EPS), -np.inf))
    R = ca.SX(size, size)
    for k, (i, j) in enumerate(zip(rows.tolist(), columns.tolist(), strict=True)):
        R[i, j] = entries[k]
    gap = R @ R.T - L
    nlp.constraint(ca.vertcat(*(gap[i, j] for i, j in zip(rows.tolist(), columns.tolist(), strict=True))), 0.0, 0.0)


def _options(seconds: float | None) -> dict[str, Any]:
    options: dict[str, Any] = {
        "print_time": False, "show_eval_warnings": False, "ipopt.print_level": 0, "ipopt.sb": "yes",
        "ipopt.max_iter": ITERATIONS, "ipopt.tol": 1e-6, "ipopt.mu_init": 1e-4, "ipopt.bound_push": 1e-8,
        "ipopt.bound_frac": 1e-8,
    }
    if seconds is not None:
        options["ipopt.max_wall_time"] = max(seconds, 1e-2)
    return options
