"""The clipped regulator as an implicit controller."""

from __future__ import annotations

from inc_casadi import INC, Box, Plant, Spec
from inc_casadi.errors import InvalidInputError
from inc_casadi.linear.regulator import discounted_lqr


def saturated_lqr(plant: Plant, spec: Spec) -> INC:
    """Return u = sat(K x) with the discounted LQR gain K (eq:two_state_saturated_lqr), clipped to the box of limits.

    plant: measures its full state. Raises InvalidInputError when it does not, or when the limits are not a box.

    >>> saturated_lqr(Plant(1.5, 1.0), Spec(1.0, 0.0, 1.0, Box(-1, 1), Box(-1, 1)))([1.0]).tolist()
    [-1.0]
    """
    if not plant.full_state:
        raise InvalidInputError("the plant does not measure its full state, so u = sat(K x) is no output feedback")
    K, _ = discounted_lqr(plant, spec)
    if spec.inputs is None:
        return INC.linear(K)
    if not isinstance(spec.inputs, Box):
        raise InvalidInputError(f"inputs is a {type(spec.inputs).__name__}, but clipping each input needs a Box")
    return INC.linear(K).with_saturated_output(spec.inputs)
