"""The best admissible linear dynamic controller found: how far linear controllers can go, certified."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InfeasibleError, InvalidInputError
from ..plant import Plant, as_plant
from ..reachability import uncontrollable_vertex
from ..sets.rules import whole
from ..spec import Spec
from .deadbeat import deadbeat_observer
from .input_limits import limit_weight
from .linear_cost import LinearCost, linear_cost
from .regulator import discounted_lqr
from .youla import Observed
from .youla_program import best_responses

_ROOMS = (1e-10, 1e-8, 1e-6, 1e-4)  # shares of the limits that are left free, so that rounding cannot break them


def best_dynamic_linear(plant: Any, spec: Spec, moves: int = 20) -> LinearCost:
    """Return an admissible linear controller of finite order whose cost is near the least of its class, certified.

    u_k = K xhat_k + sum_{j<N} Q_j e_{k-j} + c_k with the gain K of the regulator and the innovations e of a deadbeat
    observer (`Observed`): x_k and u_k are affine in (Q_j, c_j), so that the expected cost is a convex quadratic and the
    limits at the initial states are linear. Full state: e_k = 0 for k > 0, and the first N moves are any affine functions
    of x_0, with u = K x after them. The program of `affine_moves` has the same moves; so the gap to it closes as N grows.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    spec : Spec; initial on a bounded set when there are input limits
    moves : N >= 1; the order is n + (N - 1) m

    Returns
    -------
    LinearCost that holds: its `bound` is an upper bound on the infimum over linear controllers of any order.

    Raises
    ------
    NotStabilizableError : no input reaches an unstable mode
    InfeasibleError : no such controller was found: more moves, a smaller initial set, or more measurements may help
    InvalidInputError : a Gaussian initial state with input limits; a continuous plant; moves < 1
    SolverError : Clarabel or SciPy is missing

    Notes
    -----
    `bounds.affine_moves` is a lower bound on what this is an upper one of; on the two-state plant they agree to 1e-8, with
    the full state measured and with the first state alone.

    Examples
    --------
    >>> from inc_casadi import Box, Plant, Spec
    >>> scalar = Spec(Q=1.0, R=0.0, discount=0.5, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> found = best_dynamic_linear(Plant(1.5, 1.0), scalar, moves=2)
    >>> found.controller.order, round(found.bound, 6), found.holds()  # 1/3 + beta/12, the bound of thm:longrun_dyn
    (2, 0.375, True)
    """
    plant = as_plant(plant)
    spec.check(plant)
    N = whole("moves", moves, 1)
    if not plant.discrete:
        raise InvalidInputError("moves are counted, but the plant is continuous (dt = 0): use plant.sampled(dt)")
    _refuse_limits(spec)
    observed = Observed(plant, _gain(plant, spec), deadbeat_observer(plant.A, plant.C), spec.initial.mean, N)
    found = None
    for room in _ROOMS:
        try:
            found = linear_cost(plant, spec, observed.controller(best_responses(observed, spec, room)))
        except InfeasibleError as error:
            raise InfeasibleError(f"{error}, with {N} moves before the regulator takes over; "
                                  + (uncontrollable_vertex(plant, spec) or "try more of them")) from error
        if found.holds():
            return found
    assert found is not None
    raise InfeasibleError(f"the linear controller found with {N} moves is not certified: {found.reason}")


def _refuse_limits(spec: Spec) -> None:
    if spec.inputs is None:
        return
    if limit_weight(spec.inputs) is None:
        raise InfeasibleError("u = 0, where a stable linear loop ends, is not well inside the input limits")
    if spec.initial.support is None:
        spec.initial.vertices  # noqa: B018  # raises for what no bounded set carries


def _gain(plant: Plant, spec: Spec) -> Array:
    # Under limits the regulator has to be stable, which a discounted one need not be.
    K, _ = discounted_lqr(plant, spec)
    if spec.inputs is None or np.max(np.abs(np.linalg.eigvals(plant.A + plant.B @ K))) < 1 - 1e-6:
        return K
    weight = spec.Q + 1e-3 * (np.trace(spec.Q) / spec.n or 1.0) * np.eye(spec.n)
    return discounted_lqr(plant, replace(spec, Q=weight, discount=1.0))[0]
