"""The discounted linear-quadratic regulator: the start that is optimal as long as no limit is met."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InvalidInputError, NotStabilizableError, SolverError
from ..plant import Plant, as_plant
from ..spec import Spec

_RESIDUAL_TOL = 1e-8
_SWEEPS = 5000


def discounted_lqr(plant: Any, spec: Spec) -> tuple[Array, Array]:
    """Return the gain K and the cost matrix P of the best linear state feedback u = K x without input limits.

    P = Q + beta A'PA - beta A'PB (R + beta B'PB)^-1 beta B'PA and K = -(R + beta B'PB)^-1 beta B'PA, the solution that
    stabilizes sqrt(beta) (A + BK); E cost = tr(P S0). In continuous time Q + A'P + PA - PB R^-1 B'P = 0, K = -R^-1 B'P.

    Parameters
    ----------
    plant : Plant or control.StateSpace; its C is not used
    spec : Spec; its input limits are not used

    Returns
    -------
    K (m, n) with u = K x, and P (n, n).

    Raises
    ------
    NotStabilizableError : the input does not reach a mode that is unstable even discounted, sqrt(beta) |lambda| >= 1
    InvalidInputError : a continuous plant with a discount below 1 or a singular R
    SolverError : the Riccati equation has no stabilizing solution, for Q does not see a mode on the stability boundary

    Notes
    -----
    SciPy's ordered QZ is tried first; should its answer not satisfy the equation (R singular, say), value iteration
    from a positive definite start is run instead.

    Examples
    --------
    >>> from inc_casadi import Box, Plant, Spec
    >>> K, P = discounted_lqr(Plant(1.0, 1.0), Spec(Q=1.0, R=1.0, discount=1.0, initial=Box(-1, 1)))
    >>> K.round(6).tolist(), P.round(6).tolist()
    ([[-0.618034]], [[1.618034]])
    """
    plant = as_plant(plant)
    spec.check(plant)
    damped = damped_plant(plant, spec)
    modes = damped.unstabilizable_modes()
    if modes:
        raise NotStabilizableError(
            f"the input does not reach the unstable mode {_named(modes[0], spec, plant)}, so every controller lets it "
            "grow: change B, or leave the mode out of the model")
    P = _riccati(damped, spec)
    K = _gain(damped, spec, P) if P is not None else np.zeros((plant.m, plant.n))
    if P is None or not _stable(damped, K):
        unseen = Plant(damped.A, damped.B, C=spec.Q, dt=damped.dt).undetectable_modes() if np.any(spec.Q) else []
        which = f": Q does not see the mode {_named(unseen[0], spec, plant)}" if unseen else ""
        raise SolverError(f"the Riccati equation gives no gain that stabilizes the plant{which}")
    return K, P


def damped_plant(plant: Any, spec: Spec) -> Plant:
    """Return the plant whose undiscounted cost is the discounted cost of the given one.

    sqrt(beta) A, sqrt(beta) B in discrete time; A + log(beta)/2 I, B in continuous time, where beta is a factor per second:
    z(t) = beta^(t/2) x(t) turns int beta^t (x'Qx + u'Ru) dt into int (z'Qz + v'Rv) dt.

    >>> from inc_casadi import Box, Plant, Spec
    >>> damped_plant(Plant(2.0, 1.0), Spec(Q=1.0, R=1.0, discount=0.25, initial=Box(-1, 1))).A.tolist()
    [[1.0]]
    """
    plant = as_plant(plant)
    if plant.discrete:
        root = np.sqrt(spec.discount)
        return Plant(root * plant.A, root * plant.B, plant.C, plant.dt)
    return Plant(plant.A + np.log(spec.discount) / 2 * np.eye(plant.n), plant.B, plant.C, 0.0)


def _riccati(damped: Plant, spec: Spec) -> Array | None:
    from scipy.linalg import LinAlgError, LinAlgWarning, solve_continuous_are, solve_discrete_are

    if not damped.discrete and np.linalg.eigvalsh(spec.R)[0] <= 1e-12 * max(1.0, float(np.max(np.abs(spec.R)))):
        raise InvalidInputError("R must be positive definite for a continuous plant: else the best input is an impulse")
    solve = solve_discrete_are if damped.discrete else solve_continuous_are
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LinAlgWarning)  # the answer is judged by its residual below
        try:
            P = solve(damped.A, damped.B, spec.Q, spec.R)
        except (LinAlgError, ValueError):
            P = None
    if P is not None and np.all(np.isfinite(P)):
        P = (P + P.T) / 2
        if _residual(damped, spec, P) <= _RESIDUAL_TOL and _stable(damped, _gain(damped, spec, P)):
            return P
    return _iterated(damped, spec) if damped.discrete else None


def _iterated(damped: Plant, spec: Spec) -> Array | None:
    # From above zero in every direction value iteration comes to the stabilizing solution, where there is one.
    P = spec.Q + (np.trace(spec.Q) or 1.0) * np.eye(damped.n)
    for _ in range(_SWEEPS):
        before = P
        P = _swept(damped, spec, P)
        if np.linalg.norm(P - before) <= 1e-13 * np.linalg.norm(P):
            return P
    return None


def _swept(damped: Plant, spec: Spec, P: Array) -> Array:
    K = _gain(damped, spec, P)
    closed = damped.A + damped.B @ K
    after = spec.Q + K.T @ spec.R @ K + closed.T @ P @ closed
    return (after + after.T) / 2


def _gain(damped: Plant, spec: Spec, P: Array) -> Array:
    if not damped.discrete:
        return np.asarray(-np.linalg.solve(spec.R, damped.B.T @ P), dtype=float)
    S = spec.R + damped.B.T @ P @ damped.B
    return np.asarray(-np.linalg.lstsq(S, damped.B.T @ P @ damped.A, rcond=1e-13)[0], dtype=float)


def _residual(damped: Plant, spec: Spec, P: Array) -> float:
    if damped.discrete:
        return float(np.linalg.norm(_swept(damped, spec, P) - P) / (np.linalg.norm(P) + 1e-300))
    K = _gain(damped, spec, P)
    closed = damped.A + damped.B @ K
    terms = (spec.Q, K.T @ spec.R @ K, closed.T @ P, P @ closed)
    return float(np.linalg.norm(sum(terms)) / (sum(np.linalg.norm(term) for term in terms) + 1e-300))


def _stable(damped: Plant, K: Array) -> bool:
    eigenvalues = np.linalg.eigvals(damped.A + damped.B @ K)
    return bool(np.max(np.abs(eigenvalues)) < 1 - 1e-9 if damped.discrete else np.max(eigenvalues.real) < 0)


def _named(value: complex, spec: Spec, plant: Plant) -> str:
    value = value / np.sqrt(spec.discount) if plant.discrete else value - np.log(spec.discount) / 2
    return f"{value.real:.6g}" if abs(value.imag) < 1e-12 else f"{value.real:.6g} {value.imag:+.6g}i"
