"""The clipped regulator and the clipped output gain as implicit controllers."""

from __future__ import annotations

from dataclasses import replace

from inc_casadi import INC, Box, Plant, Spec
from inc_casadi.errors import InvalidInputError
from inc_casadi.linear import best_static_gain
from inc_casadi.linear.regulator import discounted_lqr

from ..plants.paper import Case


def saturated_lqr(plant: Plant, spec: Spec) -> INC:
    """Return u = sat(K x) with the discounted LQR gain K (eq:two_state_saturated_lqr), clipped to the box of limits.

    plant: measures its full state. Raises InvalidInputError when it does not, or when the limits are not a box.

    >>> saturated_lqr(Plant(1.5, 1.0), Spec(1.0, 0.0, 1.0, Box(-1, 1), Box(-1, 1)))([1.0]).tolist()
    [-1.0]
    """
    if not plant.full_state:
        raise InvalidInputError("the plant does not measure its full state, so u = sat(K x) is no output feedback")
    K, _ = discounted_lqr(plant, spec)
    return INC.linear(K) if spec.inputs is None else clipped(INC.linear(K), spec)


def clipped_gain(case: Case, seed: int = 0) -> INC:
    """Return u = sat(F y) with the best static gain found without limits, clipped to the box of limits.

    It keeps the limits by construction; near the origin it is stable, from the initial set that is not promised.

    case : measured output; seed : of the random starts of the search

    Raises
    ------
    InvalidInputError : the full state is measured, where this is the clipped regulator; the limits are not a box
    InfeasibleError : no stabilizing gain was found

    >>> from ..plants import output_feedback
    >>> clipped_gain(output_feedback())([2.0]).tolist()
    [-1.0]
    """
    if case.plant.full_state:
        raise InvalidInputError("the plant measures its full state, so the best gain without limits is the regulator's, and "
                                "clipped it is the saturated LQR")
    return clipped(INC.linear(best_static_gain(case.plant, replace(case.spec, inputs=None), seed=seed).F), case.spec)


def clipped(law: INC, spec: Spec) -> INC:
    """Return the law clipped to the box of limits; raises InvalidInputError when there is none.

    >>> clipped(INC.linear([[2.0]]), Spec(1.0, 0.0, 1.0, Box(-1, 1), Box(-1, 1)))([3.0]).tolist()
    [1.0]
    """
    if not isinstance(spec.inputs, Box):
        raise InvalidInputError(f"inputs is a {type(spec.inputs).__name__}, but clipping each input needs a Box")
    return law.with_saturated_output(spec.inputs)
