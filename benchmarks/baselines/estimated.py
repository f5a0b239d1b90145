"""The regulator on an estimate of the state: scaled so that it keeps the limits, or clipped."""

from __future__ import annotations

from inc_casadi import INC, Box
from inc_casadi.dynamic import DynamicINC, corrected, observer
from inc_casadi.errors import InvalidInputError
from inc_casadi.linear import LinearController, lqg

from ..plants.paper import Case
from .filters import kalman, noise
from .linear import control_lqr_gain


def scaled_lqg(case: Case, seed: int = 0) -> LinearController:
    """Return u = t K xhat on the estimate of the Kalman filter, with the largest t found that keeps the limits at all times.

    It is `inc_casadi.linear.lqg` with the covariances of `noise`: order n, started at the mean of x_0.

    case : measured output; seed is not used

    Raises
    ------
    InvalidInputError : the full state is measured
    InfeasibleError : no t was found

    >>> from ..plants import output_feedback
    >>> scaled_lqg(output_feedback(0.5, 0.95, 0.3)).order
    2
    """
    _refuse_full_state(case)
    W, N = noise(case.plant, case.spec)
    return lqg(case.plant, case.spec, W, N)


def saturated_lqg(case: Case, seed: int = 0) -> DynamicINC:
    """Return u = sat(K xhat) on the estimate of an observer that knows the clipped input.

    xhat = xbar + M (y - C xbar), xbar+ = A xbar + B u + L (y - C xbar), with the gains of `kalman` and the discounted LQR
    gain K, from the mean of x_0. It keeps the limits by construction; that it settles is not promised.

    case : measured output, a box of limits; seed is not used

    Raises
    ------
    InvalidInputError : the full state is measured, or the limits are no box

    >>> from ..plants import output_feedback
    >>> law = saturated_lqg(output_feedback())
    >>> law.order, law.step(law.xi_0, [1.0])[1].tolist()
    (2, [-1.0])
    """
    _refuse_full_state(case)
    limits = case.spec.inputs
    if not isinstance(limits, Box):
        raise InvalidInputError(f"inputs is a {type(limits).__name__}, but clipping each input needs a Box")
    return on_estimate(case, INC.linear(control_lqr_gain(case.plant, case.spec)).with_saturated_output(limits))


def on_estimate(case: Case, law: INC) -> DynamicINC:
    """Return a law of the full state as one of the estimate: an observer with the gains of `kalman`, from the mean of x_0.

    law : of n measurements

    >>> from ..plants import output_feedback
    >>> on_estimate(output_feedback(), INC.linear([[-1.0, 0.0]])).q
    0
    """
    plant, spec, _ = case
    gains = kalman(plant, *noise(plant, spec))
    return observer(plant, gains.L, corrected(law, gains.M, plant.C), spec.initial.mean)


def _refuse_full_state(case: Case) -> None:
    if case.plant.full_state:
        raise InvalidInputError("the plant measures its full state, so there is nothing to estimate: its regulator is the "
                                "one on the state itself")
