"""Controllers with memory to begin with: estimates of the state by several gains, under readouts of the full state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from scipy.linalg import solve_discrete_are

from inc_casadi import INC, Plant, Spec
from inc_casadi.arrays import Array
from inc_casadi.dynamic import DynamicINC, corrected, filter_gains, observer, scheduled_observer
from inc_casadi.errors import InfeasibleError, InvalidInputError, SolverError
from inc_casadi.linear import best_dynamic_linear, best_kept_gain
from inc_casadi.sets import Box, Polytope

from .input_box import inscribed_box
from .registry import lqr_gain
from .starts.predictive import predictive_start

NOISES = (1e-4, 1e-2, 1.0)  # of the measurement, relative to the variance that the initial state gives it
MOST_UNITS, SAMPLES = 24, 60  # of a predictive readout; initial states from which horizons are compared
MOVES = 20

DynamicStart = Callable[[Plant, Spec], DynamicINC]
"""(plant, spec) -> controller with memory; raises an INCError that says why there is none."""


def steady_gain(plant: Plant, spec: Spec, noise: float) -> Array:
    """Return the gain M (n, p) of the steady Kalman filter: xhat = xbar + M (y - C xbar), xbar+ = A xhat + B u.

    S = A (I - M C) S A' + cov x_0, M = S C'(C S C' + N)^-1: as if the state were thrown anew at each step, with N the share
    `noise` of the variances of C x_0. There is no noise: it says how fast the estimate settles.

    Raises InfeasibleError where the output does not show an unstable mode, SolverError where the equation is not solved.

    >>> from inc_casadi import Box
    >>> steady_gain(Plant(1.0, 1.0), Spec(1.0, 1.0, 1.0, Box(-1, 1)), 1.0).round(6).tolist()  # the golden ratio
    [[0.618034]]
    """
    modes = plant.undetectable_modes()
    if modes:
        raise InfeasibleError(f"the output does not show the mode {modes[0]:.6g}, which is not stable: measure more")
    W = np.asarray(spec.initial.covariance)
    seen = np.diag(plant.C @ W @ plant.C.T)
    N = noise * np.diag(np.where(seen > 0, seen, 1.0))
    try:
        S = solve_discrete_are(plant.A.T, plant.C.T, W, N)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise SolverError(f"the filter's Riccati equation was not solved: {error}") from error
    return np.linalg.solve(plant.C @ S @ plant.C.T + N, plant.C @ S).T


def _clipped(plant: Plant, spec: Spec) -> INC:
    """The discounted LQR of the full state, clipped to the limits, or to a box within a polytope of them."""
    law = INC.linear(lqr_gain(plant, spec))
    if spec.inputs is None:
        return law
    return law.with_saturated_output(inscribed_box(spec.inputs) if isinstance(spec.inputs, Polytope) else spec.inputs)


def _predictive(plant: Plant, spec: Spec) -> INC:
    return predictive_start(Plant(plant.A, plant.B, dt=plant.dt), spec, units=MOST_UNITS, samples=SAMPLES).inc


def _filtered(readout: DynamicReadout) -> DynamicStart:
    """The least mean square estimate of each of the first steps, then a steady filter (`scheduled_observer`)."""
    def start(plant: Plant, spec: Spec) -> DynamicINC:
        gains = filter_gains(plant, spec)
        return scheduled_observer(plant, spec, readout(plant, spec), gains, steady_gain(plant, spec, NOISES[1]))
    return start


def _observed(readout: DynamicReadout, noise: float) -> DynamicStart:
    """One steady filter all the time, from the mean of x_0."""
    def start(plant: Plant, spec: Spec) -> DynamicINC:
        M = steady_gain(plant, spec, noise)
        return observer(plant, plant.A @ M, corrected(readout(plant, spec), M, plant.C), spec.initial.mean)
    return start


def _linear(plant: Plant, spec: Spec) -> DynamicINC:
    return DynamicINC.from_linear(best_dynamic_linear(plant, spec, MOVES).controller)


def _kept(plant: Plant, spec: Spec) -> DynamicINC:
    """The best static gain found that keeps the limits, with a clip that it never reaches: what memory has to beat."""
    law = INC.linear(best_kept_gain(plant, spec).controller.D_c)
    return with_idle_memory(law.with_saturated_output(spec.inputs) if isinstance(spec.inputs, Box) else law)


def with_idle_memory(inc: INC) -> DynamicINC:
    """Return a static law as a controller with one state that stays 0 and that nothing reads.

    >>> with_idle_memory(INC.linear([[2.0]])).step([0.0], [3.0])[1].tolist()
    [6.0]
    """
    if inc.p == 0 or inc.m == 0:
        raise InvalidInputError("the law measures or sets nothing")
    law = INC(inc.W, np.hstack([inc.U, np.zeros((inc.q, 1))]), np.vstack([inc.V, np.zeros((1, inc.q))]),
              np.block([[inc.K, np.zeros((inc.m, 1))], [np.zeros((1, inc.p + 1))]]), inc.b, np.append(inc.d, 0.0),
              inc.activations)
    return DynamicINC(law, [0.0])


DynamicReadout = Callable[[Plant, Spec], INC]

DYNAMIC_STARTS: Mapping[str, DynamicStart] = MappingProxyType({
    "filter, clipped LQR": _filtered(_clipped),
    "kept gain": _kept,
    **{f"observer with noise {noise:g}, clipped LQR": _observed(_clipped, noise) for noise in NOISES},
    "filter, MPC": _filtered(_predictive),
    f"observer with noise {NOISES[1]:g}, MPC": _observed(_predictive, NOISES[1]),
    "best dynamic linear": _linear,
})
"""The starts by name, the most promising first: each a pure function that refuses with its reason."""
