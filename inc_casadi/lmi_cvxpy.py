"""The CVXPY reading of a claim's matrix inequalities: the plain formulation, a reference for what `certify` uses.

Nothing is rescaled and nothing is exploited, so it shares no line with `lmi_assembly` and the interior-point method.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from .arrays import Array
from .certificate import MatrixCertificate
from .certificate_values import posed_values
from .claims.base import Claim
from .errors import InvalidInputError, SolverError
from .inc import INC
from .inequalities import Inequalities
from .loop import close_loop
from .multipliers import Multiplier, Unknown
from .plant import Plant

WIDEST = 1.0


def cvxpy_search(plant: Plant, inc: INC, claim: Claim, multiplier: Multiplier, *,
                 slack: float = 1e-7) -> tuple[MatrixCertificate, str]:
    """Return what CVXPY with Clarabel finds for a claim, with Clarabel's status; the certificate may not hold.

    A claim with an objective is minimized subject to condition >= slack I; any other has its smallest eigenvalue maximized
    with the trace of P fixed. The numbers are zeros when there are none.

    Raises InvalidInputError for a claim with an open level, SolverError when CVXPY or Clarabel is missing.

    >>> from inc_casadi.claims import Stability
    >>> from inc_casadi.multipliers import Sector
    >>> cvxpy_search(Plant([[0.5]], [[1.0]]), INC.linear([[0.0]]), Stability(0.6), Sector())[1]
    'optimal'
    """
    if claim.tunable:
        raise InvalidInputError(f"{type(claim).__name__} leaves its level open: name it")
    cp = _cvxpy()
    parts = Inequalities(close_loop(plant, inc), claim, multiplier)
    values = {unknown.name: _variable(cp, unknown) for unknown in parts.unknowns}
    constraints = [values[u.name][u.signed] >= 0 for u in parts.unknowns if u.signed.any()]
    constraints += [values[u.name][~u.free] == 0 for u in parts.unknowns if not u.free.all()]
    constraints += [sign >= 0 for sign in parts.signs(values).values()]
    goal = claim.objective(parts.graphs, values)
    level = cp.Variable() if goal is None else slack
    constraints += [condition - level * np.eye(condition.shape[0]) >> 0 for condition in parts.conditions(values).values()]
    if goal is None:
        sizes = [cp.trace(values[u.name]) == WIDEST * u.shape[0] for u in claim.unknowns(parts.graphs) if u.is_symmetric]
        problem = cp.Problem(cp.Maximize(level), [*constraints, *sizes, level <= 1.0])
    else:
        problem = cp.Problem(cp.Minimize(goal[0, 0]), constraints)
    status = _solve(cp, problem)
    found = {u.name: _number(u, values[u.name]) for u in parts.unknowns} | posed_values(inc)
    return MatrixCertificate(plant, inc, claim, multiplier, found, f"CVXPY and Clarabel: {status}"), status


def _variable(cp: Any, unknown: Unknown) -> Any:
    if 0 in unknown.shape:
        return np.zeros(unknown.shape)
    return cp.Variable(unknown.shape, symmetric=unknown.is_symmetric and unknown.shape[0] > 1)


def _number(unknown: Unknown, variable: Any) -> Array:
    value = getattr(variable, "value", variable)
    if value is None or not np.all(np.isfinite(value)):
        return np.zeros(unknown.shape)
    value = np.where(unknown.free, np.asarray(value, dtype=float).reshape(unknown.shape), 0.0)
    if unknown.is_symmetric:
        value = (value + value.T) / 2
    return np.where(unknown.signed, np.maximum(value, 0.0), value)


def _solve(cp: Any, problem: Any) -> str:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # an inaccurate solution is measured, not warned about
        try:
            problem.solve(solver=cp.CLARABEL, ignore_dpp=True)
        except cp.error.SolverError as error:
            if cp.CLARABEL not in cp.installed_solvers():
                raise SolverError("the reference search needs Clarabel: pip install clarabel") from error
            return "failed"
    return str(problem.status)


def _cvxpy() -> Any:
    try:
        import cvxpy
    except ImportError as error:
        raise SolverError("the reference search needs CVXPY: pip install cvxpy clarabel") from error
    return cvxpy
