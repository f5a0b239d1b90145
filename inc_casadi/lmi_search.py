"""Search for the numbers of a certificate: the CVXPY reading of a claim's matrix inequalities.

A solver's status is history, never a verdict: whatever numbers come back are judged by `MatrixCertificate`.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from .arrays import Array
from .certificate import MatrixCertificate
from .claims.base import Claim
from .claims.stability import Stability
from .errors import SolverError
from .inc import INC
from .lmi_frame import Frame, frame_of_loop
from .loop import ClosedLoop, close_loop
from .multipliers import Multiplier, Unknown
from .plant import Plant

SLACKS = (1e-7, 1e-6, 1e-5, 1e-4)
RATE_TOLERANCE = 1e-4
SLOWEST = 1e-9  # rate, relative to the loop's fastest conceivable one, below which none is named
LARGEST_SCALE = 1e4
TIE_BREAK = 1e-9
CLOSE = 1e-3  # a relative margin that other coordinates may still mend


def search(plant: Plant, inc: INC, claim: Claim, multiplier: Multiplier) -> MatrixCertificate:
    """Return the certificate with the best numbers found; it may not hold.

    Minimizes the claim's objective subject to S'(condition)S >= slack I, in coordinates where the loop is of size one,
    with the smallest slack of `SLACKS` whose numbers survive the check. Without an objective, or when nothing survives,
    the smallest eigenvalue is maximized instead, which ends with the least violated numbers.
    A `Stability` claim without a rate gets the best rate that is found.

    Raises SolverError when CVXPY or Clarabel is missing.

    >>> from inc_casadi.multipliers import Sector
    >>> found = search(Plant([[0.5]], [[1.0]]), INC.linear([[0.0]]), Stability(0.6), Sector())
    >>> found.holds()
    True
    """
    loop = close_loop(plant, inc)
    if isinstance(claim, Stability) and claim.rate is None:
        return _best_rate(loop, claim, multiplier)
    frame = frame_of_loop(loop, _at_zero(loop, claim, multiplier))
    minimizes = claim.objective(loop, _zeros(loop, claim, multiplier)) is not None
    found = _minimized(loop, claim, multiplier, frame) if minimizes else []
    if not any(worst_margin(certificate) > 0 for certificate in found):
        found += _widest(loop, claim, multiplier, frame)
        if minimizes and found and worst_margin(found[-1]) > 0:
            found += _minimized(loop, claim, multiplier, frame.refined(found[-1].values, loop))
    proved = [certificate for certificate in found if worst_margin(certificate) > 0]
    if proved and minimizes:
        return min(proved, key=lambda certificate: certificate.bound)
    if not found:
        return unsolved(plant, inc, claim, multiplier, "the solver returned no numbers")
    return max(found, key=worst_margin)


def _minimized(loop: ClosedLoop, claim: Claim, multiplier: Multiplier, frame: Frame) -> list[MatrixCertificate]:
    """Return what minimizing gives, at one slack after the other until the numbers survive the check."""
    found: list[MatrixCertificate] = []
    for slack in SLACKS:
        values = _solve(loop, claim, multiplier, frame, slack)
        if values is None:
            break
        found.append(MatrixCertificate(loop.plant, loop.inc, claim, multiplier, values))
        if worst_margin(found[-1]) > 0:
            break
        frame = frame.refined(values, loop)
    return found


def _widest(loop: ClosedLoop, claim: Claim, multiplier: Multiplier, frame: Frame) -> list[MatrixCertificate]:
    """Return what maximizing the smallest eigenvalue gives; once more in better coordinates when it is close."""
    found: list[MatrixCertificate] = []
    for _ in range(2):
        values = _solve(loop, claim, multiplier, frame, None)
        if values is None:
            break
        found.append(MatrixCertificate(loop.plant, loop.inc, claim, multiplier, values))
        if not -CLOSE < worst_margin(found[-1]) <= 0:
            break
        frame = frame.refined(values, loop)
    return found


def worst_margin(certificate: MatrixCertificate) -> float:
    """Return the smallest margin of a certificate, sign conditions counted only when they fail."""
    return min(value for name, value in certificate.margins().items() if not (name.endswith(">= 0") and value >= 0))


def unsolved(plant: Plant, inc: INC, claim: Claim, multiplier: Multiplier, note: str) -> MatrixCertificate:
    """Return a certificate of zeros, which never holds, for a loop on which no search makes sense."""
    loop = close_loop(plant, inc)
    return MatrixCertificate(plant, inc, claim, multiplier, _zeros(loop, claim, multiplier), note)


def _unknowns(loop: ClosedLoop, claim: Claim, multiplier: Multiplier) -> tuple[Unknown, ...]:
    return (*claim.unknowns(loop), *multiplier.unknowns(loop))


def _zeros(loop: ClosedLoop, claim: Claim, multiplier: Multiplier) -> dict[str, Array]:
    return {unknown.name: np.zeros(unknown.shape) for unknown in _unknowns(loop, claim, multiplier)}


def _at_zero(loop: ClosedLoop, claim: Claim, multiplier: Multiplier) -> dict[str, Array]:
    """Return the conditions with every unknown zero: minus the stage cost, or nothing for a homogeneous claim."""
    return claim.conditions(loop, _zeros(loop, claim, multiplier), np.zeros((loop.n + loop.q,) * 2))


def _solve(loop: ClosedLoop, claim: Claim, multiplier: Multiplier, frame: Frame,
           slack: float | None) -> dict[str, Array] | None:
    """Return the solver's numbers in the loop's own coordinates, or None when there are none.

    slack: least eigenvalue asked for while the objective is minimized; None to maximize it instead.
    """
    cp = _cvxpy()
    twin = frame.twin(loop)
    wanted, multipliers = claim.unknowns(loop), multiplier.unknowns(loop)
    variables = {unknown.name: _variable(cp, unknown) for unknown in (*wanted, *multipliers)}
    values = variables | {unknown.name: _in_loop(unknown, variables[unknown.name], frame) for unknown in wanted}
    constraints = [variables[u.name][u.signed] >= 0 for u in (*wanted, *multipliers) if u.signed.any()]
    level = cp.Variable() if slack is None else slack
    for condition in claim.conditions(twin, values, multiplier.matrix(twin, values)).values():
        # What the twin forms is in the frame already; a condition on P itself means the variable, P in the frame.
        in_frame = next((variables[u.name] for u in wanted if condition is values[u.name]), condition)
        constraints.append(in_frame - level * np.eye(condition.shape[0]) >> 0)
    sizes = [cp.trace(variables[u.name]) / u.shape[0] for u in wanted if u.is_symmetric]
    if slack is None:
        homogeneous = not any(np.any(part) for part in _at_zero(loop, claim, multiplier).values())
        constraints += [level <= 1.0] + [size <= (1.0 if homogeneous else LARGEST_SCALE) for size in sizes]
        goal = cp.Maximize(level)
    else:
        goal = cp.Minimize(_scaled_objective(loop, claim, frame, values) + TIE_BREAK * sum(sizes))
    if not _run(cp, cp.Problem(goal, constraints)):
        return None
    found = {unknown.name: _number(unknown, variables[unknown.name]) for unknown in (*wanted, *multipliers)}
    restored = multiplier.restored(loop, {u.name: found[u.name] for u in multipliers}, frame.S, frame.sizes)
    return {u.name: _in_loop(u, found[u.name], frame) for u in wanted} | restored


def _variable(cp: Any, unknown: Unknown) -> Any:
    """Return a CVXPY variable, or an empty array for an unknown without entries."""
    if 0 in unknown.shape:
        return np.zeros(unknown.shape)
    return cp.Variable(unknown.shape, symmetric=unknown.is_symmetric and unknown.shape[0] > 1)


def _in_loop(unknown: Unknown, value: Any, frame: Frame) -> Any:
    """Return what a claim's unknown of the frame is in the loop's coordinates: P = T'P~T, all else stays."""
    if unknown.kind != "symmetric" or unknown.shape[0] != len(frame.T):
        return value
    return frame.T.T @ value @ frame.T


def _number(unknown: Unknown, variable: Any) -> Array:
    """Return the solver's value, exactly symmetric and without the tiny negative entries that it leaves."""
    value = np.asarray(getattr(variable, "value", variable), dtype=float).reshape(unknown.shape)
    if unknown.is_symmetric:
        value = (value + value.T) / 2
    return np.where(unknown.signed, np.maximum(value, 0.0), value)


def _scaled_objective(loop: ClosedLoop, claim: Claim, frame: Frame, values: Mapping[str, Any]) -> Any:
    """Return the objective divided by what it is at P = T'T, so that the solver's tolerances are relative."""
    stand_in = {u.name: _in_loop(u, np.eye(u.shape[0]) if u.is_symmetric else np.zeros(u.shape), frame)
                for u in claim.unknowns(loop)}
    size = abs(float(np.sum(claim.objective(loop, stand_in))))
    return claim.objective(loop, values)[0, 0] / (size if size > 0 else 1.0)


def _run(cp: Any, problem: Any) -> bool:
    """Solve, and say whether there are finite numbers to look at."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # an inaccurate solution is measured, not warned about
        try:
            problem.solve(solver=cp.CLARABEL, ignore_dpp=True)
        except cp.error.SolverError as error:
            if cp.CLARABEL not in cp.installed_solvers():
                raise SolverError("searching for a certificate needs Clarabel: pip install clarabel") from error
            return False
    return all(v.value is not None and np.all(np.isfinite(v.value)) for v in problem.variables())


def _cvxpy() -> Any:
    try:
        import cvxpy
    except ImportError as error:
        raise SolverError("searching for a certificate needs CVXPY: pip install cvxpy clarabel") from error
    return cvxpy


def _best_rate(loop: ClosedLoop, claim: Stability, multiplier: Multiplier) -> MatrixCertificate:
    """Return a certificate at the best rate, within a relative `RATE_TOLERANCE` of the speed 1 - rho or alpha.

    Each solve either fails, which lowers the ceiling, or gives numbers that are pushed as far as they prove. Bold steps
    bisect; cautious ones ask for a little more than what is proved, which converges fast and ends the search.
    """
    frame = frame_of_loop(loop, _at_zero(loop, claim, multiplier))
    start = max(_widest(loop, claim, multiplier, frame), key=worst_margin, default=None)
    if start is None or worst_margin(start) <= 0:
        return start or unsolved(loop.plant, loop.inc, claim, multiplier, "the solver returned no numbers")
    ceiling = 1.0 if loop.plant.discrete else 8.0 * float(np.linalg.norm(frame.T @ loop.F @ frame.S, 2))
    speed, best = _pushed(start, 0.0, ceiling)
    if speed == 0.0:
        return start
    bold = True
    while ceiling - speed > RATE_TOLERANCE * speed:
        middle = np.sqrt(speed * ceiling) if ceiling > 4 * speed else (speed + ceiling) / 2
        trial = float(middle if bold else min(middle, speed * (1 + 0.9 * RATE_TOLERANCE)))
        bold = not bold
        values = _solve(loop, _at_speed(loop, trial), multiplier, frame.refined(best.values, loop), None)
        found = None if values is None else replace(best, claim=_at_speed(loop, trial), values=values)
        if found is None or worst_margin(found) <= 0:
            ceiling = trial
        else:
            speed, best = _pushed(found, trial, ceiling)
    return best


def _at_speed(loop: ClosedLoop, speed: float) -> Stability:
    return Stability(1.0 - speed if loop.plant.discrete else speed)


def _pushed(found: MatrixCertificate, speed: float, ceiling: float) -> tuple[float, MatrixCertificate]:
    """Return a rate near the fastest one below the ceiling that the numbers of a certificate prove."""
    fastest, step = speed, ceiling
    while step > max(SLOWEST * ceiling, 0.1 * RATE_TOLERANCE * fastest):
        step /= 2.0
        trial = fastest + step
        if trial < ceiling and worst_margin(replace(found, claim=_at_speed(found.loop, trial))) > 0:
            fastest = trial
    if fastest == speed:
        return speed, found
    return fastest, replace(found, claim=_at_speed(found.loop, fastest))
