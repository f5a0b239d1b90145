"""The steady Kalman filter of a plant, by python-control: the estimates that baselines with measured output act on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inc_casadi import Plant, Spec
from inc_casadi.arrays import Array
from inc_casadi.errors import InfeasibleError, SolverError

NOISE = 1e-2  # of the measurement, relative to the variance that the initial state gives it


class Filter(NamedTuple):
    """Gains of xbar+ = A xbar + B u + L (y - C xbar) and xhat = xbar + M (y - C xbar), L = A M; both (n, p)."""

    L: Array
    M: Array


def noise(plant: Plant, spec: Spec) -> tuple[Array, Array]:
    """Return covariances W (n, n) of a disturbance per step and N (p, p) of the measurement, both small or made up.

    There is no noise in the benchmark: they say how fast the estimate settles. W is the covariance of x_0, as if the state
    were thrown anew at each step; N is 1 % of the variances of C x_0.

    >>> from inc_casadi import Box
    >>> [part.round(4).tolist() for part in noise(Plant(2.0, 1.0, 3.0), Spec(1.0, 1.0, 1.0, Box(-1, 1)))]
    [[[0.3333]], [[0.03]]]
    """
    W = np.asarray(spec.initial.covariance)
    return W, np.diag(NOISE * np.diag(plant.C @ W @ plant.C.T))


def kalman(plant: Plant, W: Array, N: Array) -> Filter:
    """Return the steady Kalman gains by python-control's dlqe.

    S = A (S - M C S) A' + W, M = S C'(C S C' + N)^-1, L = A M.

    Raises
    ------
    InfeasibleError : an unstable mode is not measured
    SolverError : python-control is missing, or its Riccati equation has no solution

    >>> kalman(Plant(1.0, 1.0), np.array([[1.0]]), np.array([[1.0]])).M.round(6).tolist()  # the golden ratio
    [[0.618034]]
    """
    modes = plant.undetectable_modes()
    if modes:
        raise InfeasibleError(f"the output does not show the mode {modes[0]:.6g}, which is not stable: measure more")
    try:
        import control
    except ImportError as error:
        raise SolverError("this baseline needs python-control: pip install control") from error
    try:
        L, S, _ = control.dlqe(plant.A, np.eye(plant.n), plant.C, W, N, method="scipy")
    except (np.linalg.LinAlgError, ValueError, control.ControlException) as error:
        raise SolverError(f"the filter's Riccati equation was not solved: {error}") from error
    M = np.linalg.solve(plant.C @ S @ plant.C.T + N, plant.C @ S).T
    return Filter(np.asarray(L, dtype=float), np.asarray(M, dtype=float))
