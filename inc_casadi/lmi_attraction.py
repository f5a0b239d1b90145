"""The search for ellipsoids of attraction: convex programs in X = P^-1 for CVXPY and Clarabel."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from .arrays import Array
from .blocks import kind
from .errors import SolverError
from .local.base import LocalMethod, Setting, without_cost
from .multipliers import Unknown

COST_SLACK = 1e-7  # share of the stage cost that is added, so that rounding cannot undo the bound
USABLE = ("optimal", "optimal_inaccurate")


def largest(setting: Setting, variables: tuple[Unknown, ...],
            inequalities: Callable[[Any, Mapping[str, Any]], dict[str, Any]], frame: Array) -> dict[str, Array] | str:
    """Return X and the variables of the largest ellipsoid in the sense of the claim, or why the solver gave none.

    frame (n, n): coordinates in which X = (frame'P frame)^-1. Maximizes log det X, or minimizes the largest (or the mean)
    t_j with [[t_j, f_j'], [f_j, X]] >= 0, d_j = frame f_j, so that t_j >= d_j'P d_j. inequalities: named matrices, linear in
    X and the variables, that must be >= 0. What is returned need not satisfy them to the last digit: whoever asks checks it.

    Raises SolverError when CVXPY or Clarabel is missing.
    """
    cp = _cvxpy()
    n = setting.loop.n
    X = cp.Variable((n, n), PSD=True)
    values = {unknown.name: _variable(cp, unknown) for unknown in variables}
    constraints = [_psd(cp, entry) for entry in inequalities(X, values).values()]
    for unknown in variables:
        if 0 not in unknown.shape:
            constraints += [values[unknown.name][unknown.signed] >= 0] if unknown.signed.any() else []
            constraints += [values[unknown.name][~unknown.free] == 0] if not unknown.free.all() else []
    goal, more = _goal(cp, setting, X, frame)
    status = _solve(cp, cp.Problem(goal, [*constraints, *more]))
    if status not in USABLE:
        return f"the solver found no ellipsoid: {status}"
    found = {"X": X, **values}
    return {name: np.asarray(getattr(value, "value", value), dtype=float) for name, value in found.items()}


def smallest(method: LocalMethod, setting: Setting, fixed: Mapping[str, Array], frame: Array,
             slack: float) -> dict[str, Array] | str:
    """Return P and the method's other values with the smallest P in the sense of the claim, for a method linear in P.

    log det P is replaced by its tangent tr(frame frame' P) at P = (frame frame')^-1; d_j'P d_j is linear as it is. fixed:
    the values that stay as they are; slack: what every condition is to exceed, in the frame and for multipliers of size 1.
    The cost is left out: `cheapest` finds it.
    """
    cp = _cvxpy()
    setting = without_cost(setting)
    wanted = [unknown for unknown in method.unknowns(setting) if unknown.name not in fixed]
    scaled = {unknown.name: _variable(cp, unknown) for unknown in wanted}
    back = np.linalg.inv(frame)
    values = {**fixed, **scaled, "P": back.T @ scaled["P"] @ back}
    constraints = [scaled[u.name][u.signed] >= 0 for u in wanted if u.signed.any()]
    constraints += [scaled[u.name][~u.free] == 0 for u in wanted if not u.free.all()]
    constraints += [entries >= slack for entries in method.signs(setting, values).values() if kind(entries) == "cvxpy"]
    for entry in method.conditions(setting, values).values():
        if kind(entry) == "cvxpy":
            constraints.append(_psd(cp, _framed(entry, frame) - slack * np.eye(entry.shape[0])))
    status = _solve(cp, cp.Problem(_small(cp, setting, scaled["P"], back), constraints))
    if status not in USABLE:
        return f"the solver found no ellipsoid: {status}"
    found = {unknown.name: _number(unknown, scaled[unknown.name]) for unknown in wanted}
    P = back.T @ found["P"] @ back
    return {**fixed, **found, "P": (P + P.T) / 2}


def _small(cp: Any, setting: Setting, P: Any, back: Array) -> Any:
    """The goal in P: its trace, or its form along the directions; P and back (n, n) in and to the frame."""
    if setting.claim.directions is None:
        return cp.Minimize(cp.trace(P))
    along = back @ setting.claim.directions
    sizes = cp.hstack([along[:, j] @ P @ along[:, j] for j in range(along.shape[1])])
    return cp.Minimize(cp.max(sizes) if setting.claim.shape == "reach" else cp.sum(sizes) / along.shape[1])


def _framed(entry: Any, frame: Array) -> Any:
    """Return a form over (e, ...) as one over (frame^-1 e, ...)."""
    n, wide = len(frame), np.eye(entry.shape[0])
    wide[:n, :n] = frame
    return wide.T @ entry @ wide


def cheapest(method: LocalMethod, setting: Setting, values: Mapping[str, Array]) -> dict[str, Array] | str:
    """Return P_cost, and the method's multipliers whose names end in "_cost", with the least mean of e'P_cost e.

    All other values stay as they are, which leaves the method's own conditions linear. The mean is over the uniform
    distribution on the ellipsoid, tr(P_cost P^-1) / (n + 2).
    """
    cp = _cvxpy()
    wanted = [unknown for unknown in method.unknowns(setting) if unknown.name.endswith("_cost")]
    n, frame = setting.loop.n, np.linalg.inv(np.linalg.cholesky(values["P"]).T)  # e = frame f, e'P e = f'f
    assert setting.claim.Q is not None
    size = float(np.trace(frame.T @ setting.claim.Q @ frame)) / n or 1.0  # of the stage cost in the ellipsoid
    scaled = {unknown.name: _variable(cp, unknown) for unknown in wanted}
    free = {name: size * variable for name, variable in scaled.items()}
    back = np.linalg.inv(frame)
    free["P_cost"] = back.T @ free["P_cost"] @ back
    constraints = [scaled[u.name][u.signed] >= 0 for u in wanted if u.signed.any()]
    constraints += [scaled[u.name][~u.free] == 0 for u in wanted if not u.free.all()]
    for entries in method.signs(setting, {**values, **free}).values():
        constraints += [entries / size >= COST_SLACK] if kind(entries) == "cvxpy" else []
    for entry in method.conditions(setting, {**values, **free}).values():
        if kind(entry) == "cvxpy":
            constraints.append(_psd(cp, _framed(entry, frame) / size - COST_SLACK * np.eye(entry.shape[0])))
    status = _solve(cp, cp.Problem(cp.Minimize(cp.trace(scaled["P_cost"])), constraints))
    if status not in USABLE:
        return f"no bound on the cost over the ellipsoid was found: {status}; a rate below 1 leaves room for one"
    found = {u.name: _number(u, scaled[u.name]) * size for u in wanted}
    cost = back.T @ found["P_cost"] @ back
    return found | {"P_cost": (cost + cost.T) / 2}


def _goal(cp: Any, setting: Setting, X: Any, frame: Array) -> tuple[Any, list[Any]]:
    claim, n = setting.claim, setting.loop.n
    if claim.directions is None:
        return cp.Maximize(cp.log_det(X)), []
    t = cp.Variable(claim.directions.shape[1])
    constraints = []
    for j, direction in enumerate(np.linalg.solve(frame, claim.directions).T):
        d = direction.reshape(n, 1)
        constraints.append(cp.bmat([[cp.reshape(t[j], (1, 1), order="C"), d.T], [d, X]]) >> 0)
    return cp.Minimize(cp.max(t) if claim.shape == "reach" else cp.sum(t) / t.size), constraints


def _psd(cp: Any, entry: Any) -> Any:
    return (entry + entry.T) / 2 >> 0


def _variable(cp: Any, unknown: Unknown) -> Any:
    if 0 in unknown.shape:
        return np.zeros(unknown.shape)
    return cp.Variable(unknown.shape, symmetric=unknown.is_symmetric and unknown.shape[0] > 1)


def _number(unknown: Unknown, variable: Any) -> Array:
    value = np.asarray(getattr(variable, "value", variable), dtype=float).reshape(unknown.shape)
    value = (value + value.T) / 2 if unknown.is_symmetric else value
    return np.where(unknown.signed, np.maximum(value, 0.0), np.where(unknown.free, value, 0.0))


def _solve(cp: Any, problem: Any) -> str:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # an inaccurate solution is measured, not warned about
        try:
            # Taken apart into its cliques, a sparse inequality is one that Clarabel more often gives up on.
            problem.solve(solver=cp.CLARABEL, ignore_dpp=True, chordal_decomposition_enable=False)
        except cp.error.SolverError as error:
            if cp.CLARABEL not in cp.installed_solvers():
                raise SolverError("the search for an ellipsoid needs Clarabel: pip install clarabel") from error
            return "failed"
    return str(problem.status)


def _cvxpy() -> Any:
    try:
        import cvxpy
    except ImportError as error:
        raise SolverError("the search for an ellipsoid needs CVXPY: pip install cvxpy clarabel") from error
    return cvxpy
