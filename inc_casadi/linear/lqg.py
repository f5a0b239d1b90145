"""The regulator on the estimate of a Kalman filter, scaled to keep the input limits: a baseline."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, symmetric
from ..errors import InfeasibleError, InvalidInputError, SolverError
from ..plant import Plant, as_plant
from ..spec import Spec
from .controller import LinearController
from .linear_cost import linear_cost
from .regulator import discounted_lqr

_GRID, _HALVINGS = 50, 12
_NOISE = 1e-2  # of the measurement, by default, relative to the variance that the initial state gives it


def lqg(plant: Any, spec: Spec, process: ArrayLike | None = None, measurement: ArrayLike | None = None, *,
        scaled: bool = True) -> LinearController:
    """Return the regulator u = t K xhat on the estimate of the steady Kalman filter, started at the mean of x_0.

    xhat = xbar + M (y - C xbar), xbar+ = A xhat + B u, M = S C'(C S C' + N)^-1 and S the stabilizing solution of
    S = A (S - M C S) A' + W: order n. K is that of `discounted_lqr`. For noise of covariance W and N it is optimal without
    limits when the discount is 1; here there is no noise, and W and N say how fast the estimate is to settle.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    spec : Spec
    process : W (n, n), None for the covariance of x_0, as if the state were disturbed at each step as at the start
    measurement : N (p, p), None for 1 % of the variances that x_0 gives to C x_0 (1e-6 of W's largest at least)
    scaled : with input limits, use the largest t in (0, 1] found with which `linear_cost` proves the limits kept for
        ever and the loop stable; else t = 1, whatever comes of it

    Raises
    ------
    NotStabilizableError, InvalidInputError : as `discounted_lqr`; a covariance that is not one; a continuous plant
    InfeasibleError : no t was found (50 were tried); an unstable mode is not measured
    SolverError : the filter's Riccati equation has no solution

    Examples
    --------
    >>> from inc_casadi import Box, Plant, Spec
    >>> spec = Spec(Q=1.0, R=1.0, discount=0.9, initial=Box(-1, 1), inputs=Box(-0.5, 0.5))
    >>> found = lqg(Plant(1.2, 1.0), spec)
    >>> found.order, linear_cost(Plant(1.2, 1.0), spec, found).holds()
    (1, True)
    """
    plant = as_plant(plant)
    K, _ = discounted_lqr(plant, spec)
    if not plant.discrete:
        raise InvalidInputError("the filter counts steps, but the plant is continuous (dt = 0): use plant.sampled(dt)")
    modes = plant.undetectable_modes()
    if modes:
        raise InfeasibleError(f"the output does not show the mode {modes[0]:.6g}, which is not stable, so no filter can "
                              "follow it: measure more")
    M = _filter(plant, *_covariances(plant, spec, process, measurement))
    if not scaled or spec.inputs is None:
        return _controller(plant, K, M, spec.initial.mean)
    return _largest(plant, spec, K, M)


def _covariances(plant: Plant, spec: Spec, process: ArrayLike | None, measurement: ArrayLike | None) -> tuple[Array, Array]:
    W = symmetric("process", spec.initial.covariance if process is None else process, plant.n, definite="semi")
    if measurement is not None:
        return W, symmetric("measurement", measurement, plant.p, definite="strict")
    seen = np.diag(plant.C @ spec.initial.covariance @ plant.C.T)
    least = 1e-6 * float(np.max(np.abs(plant.C @ W @ plant.C.T), initial=0.0)) or 1e-6
    return W, np.diag(_NOISE * np.maximum(seen, least))


def _filter(plant: Plant, W: Array, N: Array) -> Array:
    from scipy.linalg import LinAlgError, solve_discrete_are

    A, C = plant.A, plant.C
    raised = W + 1e-9 * (float(np.trace(W)) / plant.n or 1.0) * np.eye(plant.n)  # so that every unstable mode is driven
    try:
        S = solve_discrete_are(A.T, C.T, raised, N)
    except (LinAlgError, ValueError) as error:
        raise SolverError(f"the filter's Riccati equation was not solved: {error}") from error
    return np.asarray(np.linalg.solve(C @ S @ C.T + N, C @ S).T, dtype=float)


def _controller(plant: Plant, K: Array, M: Array, mean: Array) -> LinearController:
    # xi is the prediction xbar; the estimate is (I - M C) xbar + M y.
    A_K, seen = plant.A + plant.B @ K, np.eye(plant.n) - M @ plant.C
    return LinearController(A_K @ seen, A_K @ M, K @ seen, K @ M, mean)


def _largest(plant: Plant, spec: Spec, K: Array, M: Array) -> LinearController:
    def tried(t: float) -> LinearController | None:
        candidate = _controller(plant, t * K, M, spec.initial.mean)
        return candidate if linear_cost(plant, spec, candidate).holds() else None

    grid = np.linspace(1.0, 0.0, _GRID, endpoint=False)
    step = next((i for i, t in enumerate(grid) if tried(t) is not None), None)
    if step is None:
        raise InfeasibleError(f"no multiple t K of the regulator was found that keeps the input limits from every initial "
                              f"state and stabilizes the plant ({_GRID} values of t in (0, 1] were tried)")
    low, high = grid[step], grid[max(step - 1, 0)]
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if tried(middle) is not None else (low, middle)
    found = tried(low)
    assert found is not None
    return found
