"""Downhill over static linear gains: cost and derivatives by Lyapunov equations, steps by quadratic programs."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from math import inf

import numpy as np

from ..arrays import Array
from ..errors import InfeasibleError, SolverError
from ..plant import Plant
from ..sets.farthest import farthest
from ..spec import Spec

_LEVELS, _STEPS_PER_LEVEL, _LAST_STEPS = 40, 6, 200
ADMISSIBLE_TOL = 1e-9  # relative to the size of the limits


@dataclass
class Admissible:
    """The gains F (m, p) with H_u F C v <= h_u for the initial states v listed so far; the list grows.

    Constraints that a found gain violates are added, so sets of very many vertices, or none, can be handled. until: the
    time.monotonic() at which a search among them ends with what it has.
    """

    plant: Plant
    spec: Spec
    until: float = inf
    rows: list[Array] = field(default_factory=list)
    limits: list[float] = field(default_factory=list)

    def add(self, facet: int, points: Array) -> None:
        """List the constraint of one facet at initial states (n, c)."""
        assert self.spec.inputs is not None
        self.rows.extend(np.kron(self.spec.inputs.H[facet], y) for y in (self.plant.C @ points).T)
        self.limits.extend([float(self.spec.inputs.h[facet])] * points.shape[1])

    def nearest(self, model: Array, linear: Array, shape: tuple[int, ...]) -> Array:
        """Return the admissible gain that minimizes f'(model)f / 2 + linear'f over f = vec F, rows first.

        Raises
        ------
        InfeasibleError : no gain is admissible
        SolverError : Clarabel is missing
        """
        scale = float(np.max(np.abs(np.append(linear, np.diag(model))))) or 1.0
        F = np.zeros(shape)
        for _ in range(20):
            F = _quadratic_program(model / scale, linear / scale, self.rows, self.limits).reshape(shape)
            if self.spec.inputs is None:
                return F
            over, points = excess(self.plant, self.spec, F)
            violated = np.flatnonzero(over > ADMISSIBLE_TOL)
            if not violated.size:
                return F
            for facet in violated:
                self.add(int(facet), points[:, [facet]])
        return F


def _quadratic_program(model: Array, linear: Array, rows: list[Array], limits: list[float]) -> Array:
    try:
        import clarabel
        from scipy import sparse
    except ImportError as error:
        raise SolverError("the search for static gains needs scipy and clarabel: pip install clarabel") from error
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    G = sparse.csc_matrix(np.array(rows).reshape(-1, linear.size))
    cones = [clarabel.NonnegativeConeT(len(limits))] if limits else []
    upper = sparse.triu(sparse.csc_matrix(model)).tocsc()
    found = clarabel.DefaultSolver(upper, linear, G, np.array(limits), cones, settings).solve()
    if "Infeasible" in str(found.status) or not np.all(np.isfinite(found.x)):
        raise InfeasibleError("no static gain u = F y keeps the input limits at all initial states")
    return np.array(found.x)


def excess(plant: Plant, spec: Spec, F: Array) -> tuple[Array, Array]:
    """Return by how much each facet of the limits is exceeded, relative to their size (f,), and where (n, f).

    >>> from inc_casadi import Box, Plant, Spec
    >>> excess(Plant(1.0, 1.0), Spec(1.0, 1.0, 1.0, Box(-1, 1), Box(-1, 1)), np.array([[2.0]]))[0].tolist()
    [0.5, 0.5]
    """
    assert spec.inputs is not None
    H = spec.inputs.H
    rows = H @ F @ plant.C
    points = farthest(spec.initial, rows.T)
    sizes = np.asarray(spec.inputs.support(H.T)) + np.asarray(spec.inputs.support(-H.T))
    return (np.sum(rows * points.T, axis=1) - spec.inputs.h) / sizes, points


def evaluate(damped: Plant, spec: Spec, F: Array, S0: Array) -> tuple[float, Array, Array]:
    """Return tr(P_F S0), its gradient (m, p), and a positive semidefinite part of its Hessian (mp, mp).

    That part is the Kronecker product of 2 (R + B'PB), or 2 R in continuous time, and C S C'.
    The cost is infinite, and the derivatives are zero, when A + BFC is not stable.

    Parameters
    ----------
    damped : plant with the discount in it, so that the cost is undiscounted
    F : (m, p); S0 : (n, n)

    >>> from inc_casadi import Box, Plant, Spec
    >>> spec = Spec(Q=1.0, R=0.0, discount=1.0, initial=Box(-1, 1))
    >>> cost, gradient, _ = evaluate(Plant(1.5, 1.0), spec, np.array([[-1.0]]), np.eye(1))
    >>> round(cost, 6), round(float(gradient[0, 0]), 6)  # 1 / (1 - f^2) and 2 f / (1 - f^2)^2 at f = 0.5
    (1.333333, 1.777778)
    """
    from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov

    A, B, C, Q, R = damped.A, damped.B, damped.C, spec.Q, spec.R
    closed = A + B @ F @ C
    eigenvalues = np.linalg.eigvals(closed)
    unstable = np.inf, np.zeros_like(F), np.zeros((F.size, F.size))
    if not (np.max(np.abs(eigenvalues)) < 1 if damped.discrete else np.max(eigenvalues.real) < 0):
        return unstable
    stage = Q + C.T @ F.T @ R @ F @ C
    if damped.discrete:
        P, S = solve_discrete_lyapunov(closed.T, stage), solve_discrete_lyapunov(closed, S0)
        slope, weight = R @ F @ C + B.T @ P @ closed, R + B.T @ P @ B
    else:
        P, S = solve_continuous_lyapunov(closed.T, -stage), solve_continuous_lyapunov(closed, -S0)
        slope, weight = R @ F @ C + B.T @ P, R
    cost = float(np.sum(P * S0))
    if not np.isfinite(cost) or cost < 0:
        return unstable
    return cost, 2 * slope @ S @ C.T, 2 * np.kron(weight, C @ S @ C.T)


def annealed(damped: Plant, admissible: Admissible, F: Array) -> Array | None:
    """Return a locally best gain reached from F, or None when no stable loop was reached.

    Downhill first at a level of damping that makes the cost of F finite, then as far up as the loop allows, and so on
    until there is no more damping than the discount. The number of steps is bounded.
    """
    level, C = 0.0, admissible.plant.C
    for _ in range(_LEVELS):
        reachable = _level(damped, F, C)
        if reachable <= level + 1e-4:
            F = _descend(_at_level(damped, level), admissible, F, _LAST_STEPS)
            reachable = _level(damped, F, C)
        if reachable <= level + 1e-4:
            return None
        level = reachable
        F = _descend(_at_level(damped, level), admissible, F, _LAST_STEPS if level == 1.0 else _STEPS_PER_LEVEL)
        if level == 1.0:
            return F
    return None


def _level(damped: Plant, F: Array, C: Array) -> float:
    # The level in (0, 1] at which the loop is stable with a margin; level 1, which is no damping, needs none.
    eigenvalues = np.linalg.eigvals(damped.A + damped.B @ F @ C)
    if damped.discrete:
        radius = float(np.max(np.abs(eigenvalues)))
        return 1.0 if radius < 1 - 1e-6 else min(1 - 1e-3, (0.97 / radius) ** 2)
    rate = float(np.max(eigenvalues.real))
    return 1.0 if rate < -1e-9 else 1 / (1 + 1.2 * rate + 1e-3)


def _at_level(damped: Plant, level: float) -> Plant:
    if level == 1.0:
        return damped
    if damped.discrete:
        return Plant(np.sqrt(level) * damped.A, np.sqrt(level) * damped.B, damped.C, damped.dt)
    return Plant(damped.A - (1 / level - 1) * np.eye(damped.n), damped.B, damped.C, damped.dt)


def _descend(damped: Plant, admissible: Admissible, F: Array, steps: int) -> Array:
    # Sequential quadratic programming: the admissible gains are convex, so every point of a step stays admissible.
    spec = admissible.spec
    S0 = spec.initial.second_moment
    S0 = S0 + 1e-9 * np.trace(S0) / len(S0) * np.eye(len(S0))  # so that no unstable mode goes unnoticed
    cost, gradient, hessian = evaluate(damped, spec, F, S0)
    for _ in range(steps):
        if time.monotonic() >= admissible.until:
            break
        floor = 1e-9 * (np.trace(hessian) / F.size + 1e-300)
        model = hessian + floor * np.eye(F.size)
        target = admissible.nearest(model, gradient.ravel() - model @ F.ravel(), F.shape)
        step = target - F
        slope = float(np.sum(gradient * step))
        if slope >= -1e-13 * cost:
            break
        length, trial = 1.0, evaluate(damped, spec, target, S0)
        while not trial[0] <= cost + 1e-4 * length * slope and length > 1e-8:
            length /= 2
            trial = evaluate(damped, spec, F + length * step, S0)
        if not trial[0] < cost:
            break
        hessian = _updated(hessian, length * step.ravel(), (trial[1] - gradient).ravel())
        F, cost, gradient = F + length * step, trial[0], trial[1]
    return F


def _updated(hessian: Array, step: Array, change: Array) -> Array:
    # Powell's damped BFGS update, which keeps the model positive semidefinite.
    along = hessian @ step
    curvature = float(step @ along)
    if curvature <= 0:
        return hessian
    damping = 1.0 if step @ change >= 0.2 * curvature else 0.8 * curvature / (curvature - float(step @ change))
    change = damping * change + (1 - damping) * along
    return hessian - np.outer(along, along) / curvature + np.outer(change, change) / float(step @ change)
