"""Constrained model predictive control, written as an implicit controller."""

from __future__ import annotations

import numpy as np

from inc_casadi import INC, MPC, Box, Plant, Spec, simulate
from inc_casadi.arrays import Array
from inc_casadi.dynamic import DynamicINC
from inc_casadi.errors import InvalidInputError

from ..plants.paper import Case
from .estimated import on_estimate
from .linear import control_lqr_gain

MOST_UNITS, WATCHED = 40, 200
TINY = 1e-6  # of B'QB, added to a singular R, for the program has to be strictly convex


def predictive(case: Case, seed: int = 0) -> INC | DynamicINC:
    """Return the predictive law of the stated cost and limits, with the regulator's cost at the end of the horizon.

    Full state: `inc_casadi.MPC`, exactly, as m N saturation units with W != 0; measured output: the same law of the estimate
    of an observer. The horizon N is that of `horizon`. From where x_N needs no clipping any more this is the best there is.

    case : a box of limits; seed is not used

    Raises
    ------
    InvalidInputError : the limits are no box

    >>> from ..plants import scalar
    >>> law = predictive(scalar(0.9, 0.05))
    >>> law.q, law([1.0]).round(6).tolist()
    (2, [-1.0])
    """
    plant, spec, _ = case
    if not isinstance(spec.inputs, Box):
        raise InvalidInputError(f"inputs is a {type(spec.inputs).__name__}, but the predictive law needs a Box")
    seen = Plant(plant.A, plant.B, dt=plant.dt)
    law = MPC(seen, spec.Q, _convex(plant, spec), horizon(case), spec.inputs, discount=spec.discount).inc()
    return law if plant.full_state else on_estimate(case, law)


def horizon(case: Case) -> int:
    """Return N: two more than the last step at which the clipped regulator meets a limit, from any vertex; m N <= 40.

    After the last clipped step the regulator itself is admissible, and its cost is the terminal one; the step more is room
    for a sequence that saves its input. At most 200 steps are watched, and at least one unit per input is kept.

    >>> from ..plants import two_state
    >>> horizon(two_state())
    4
    """
    plant, spec, _ = case
    assert isinstance(spec.inputs, Box)
    K = control_lqr_gain(plant, spec)
    seen = Plant(plant.A, plant.B, dt=plant.dt)
    law = INC.linear(K).with_saturated_output(spec.inputs)
    x = simulate(seen, law, spec.initial.vertices, steps=WATCHED).x
    wanted = np.tensordot(K, x, axes=1).reshape(plant.m, -1, WATCHED + 1)
    beyond = (wanted > spec.inputs.upper[:, None, None]) | (wanted < spec.inputs.lower[:, None, None])
    steps = np.flatnonzero(np.any(beyond, axis=(0, 1)))
    last = int(steps[-1]) if steps.size else -1
    return max(1, min(last + 2, MOST_UNITS // plant.m))


def _convex(plant: Plant, spec: Spec) -> Array:
    if np.linalg.eigvalsh(spec.R)[0] > 0:
        return spec.R
    scale = float(np.trace(plant.B.T @ spec.Q @ plant.B)) or 1.0
    return np.asarray(spec.R + TINY * scale * np.eye(plant.m))
