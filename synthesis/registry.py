"""The starts by name: each a pure function that makes a law to begin with, or refuses with its reason."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import inf
from types import MappingProxyType
from typing import Any

import numpy as np

from inc_casadi import INC, Box, Plant, Spec
from inc_casadi.activations import Activation
from inc_casadi.arrays import Array
from inc_casadi.claims import DiscountedCost
from inc_casadi.errors import ConvergenceError, INCError, InvalidInputError
from inc_casadi.inc import inner_half
from inc_casadi.judgement.clipped import MOST_FOLLOWED
from inc_casadi.linear.kept_gain import best_kept_gain
from inc_casadi.linear.regulator import discounted_lqr
from inc_casadi.linear.static_gain import best_static_gain
from inc_casadi.sets import Polytope, Uniform

from .starts.linear_feedback import stabilizing_gain
from .starts.random_start import linear_start, random_start

MOST_MPC_UNITS = 40
MOST_EXPLICIT_STATES, EXPLICIT_PIECES, EXPLICIT_HORIZONS = 3, 20_000, (5, 4, 3, 2, 1)
IMITATION = 30  # iterations of each fit of a compressed law

Start = Callable[[Plant, Spec, int, Activation, float, int], INC]
"""(plant, spec, hidden, activation, kappa, seed) -> law; raises an INCError that says why there is none.

The law's input limits may be built in or not: what is missing is added by whoever uses it.
"""


def may_suit(name: str, plant: Plant, spec: Spec) -> bool:
    """Return whether a start may apply and win, judged at once: what is refused for sure is not worth an attempt.

    >>> spec = Spec([[1.0]], [[1.0]], 0.9, Box([-1.0], [1.0]), Box([-1.0], [1.0]))
    >>> may_suit("MPC", Plant([[1.5]], [[1.0]]), spec), may_suit("sector inequality", Plant([[1.5]], [[1.0]]), spec)
    (True, False)
    """
    from .starts.lure import costs_without_end
    from .starts.predictive import why_not

    if name == "seldom clipped gain":  # elsewhere exact pieces follow gains that are clipped more often
        support = spec.initial.support if isinstance(spec.initial, Uniform) else None
        return plant.n > MOST_FOLLOWED or not isinstance(support, Box | Polytope)
    if name in ("MPC", "explicit MPC", "compressed MPC"):
        few = name != "explicit MPC" or plant.n <= MOST_EXPLICIT_STATES
        return few and not why_not(plant, spec, MOST_MPC_UNITS)
    if name == "sector inequality":
        state = plant.p == plant.n and np.linalg.matrix_rank(plant.C) == plant.n
        return state and (spec.inputs is None or isinstance(spec.inputs, Box) and not np.any(inner_half(spec.inputs)[0])
                          and not costs_without_end(plant, spec.discount))
    return True


def lqr_gain(plant: Plant, spec: Spec) -> Array:
    """Return the discounted LQR gain K (m, n), u = K x; the undiscounted one when the former does not stabilize.

    >>> spec = Spec([[1.0]], [[1.0]], 1.0, Box([-1.0], [1.0]))
    >>> lqr_gain(Plant([[1.0]], [[1.0]]), spec).round(4).tolist()
    [[-0.618]]
    """
    K, _ = discounted_lqr(plant, spec)
    if np.max(np.abs(np.linalg.eigvals(plant.A + plant.B @ K))) >= 1:
        K, _ = discounted_lqr(plant, replace(spec, discount=1.0))
    return K


def _around(gain: Callable[[Plant, Spec, int], Array]) -> Start:
    """Return the start that is u = F y with live hidden units beside it, F = gain(plant, spec, seed)."""
    def start(plant: Plant, spec: Spec, hidden: int, activation: Activation, kappa: float, seed: int) -> INC:
        return linear_start(gain(plant, spec, seed), plant, spec, hidden, activation, kappa, seed)
    return start


def _regulator(plant: Plant, spec: Spec, _: int) -> Array:
    if plant.p != plant.n or np.linalg.matrix_rank(plant.C) < plant.n:
        raise InvalidInputError(f"LQR reads the state, but C ({plant.p} x {plant.n}) does not give it")
    return np.asarray(np.linalg.solve(plant.C.T, lqr_gain(plant, spec).T).T)


def _limited_gain(plant: Plant, spec: Spec, seed: int) -> Array:
    return best_static_gain(plant, spec, seed=seed).F


def _kept_gain(plant: Plant, spec: Spec, seed: int) -> Array:
    return best_kept_gain(plant, spec, seed=seed).controller.D_c


def _seldom_clipped(plant: Plant, spec: Spec, seed: int) -> Array:
    from .starts.seldom_clipped import seldom_clipped_gain

    return seldom_clipped_gain(plant, spec, seed)


def _stabilizing_gain(plant: Plant, spec: Spec, seed: int) -> Array:
    return stabilizing_gain(plant, replace(spec, discount=1.0), seed)


def _halfway_gain(plant: Plant, spec: Spec, seed: int) -> Array:
    return (_limited_gain(plant, spec, seed) + stabilizing_gain(plant, spec, seed)) / 2


def _sector_feedback(plant: Plant, spec: Spec, *_: Any) -> INC:
    from .starts.lure import saturated_feedback, state_feedback

    claim = DiscountedCost(spec.Q, spec.R, spec.discount, spec.initial)
    if spec.inputs is None:
        return state_feedback(plant, claim)
    if not isinstance(spec.inputs, Box):
        raise InvalidInputError("the saturated feedback of the sector inequality needs a box of inputs")
    return saturated_feedback(plant, claim, spec.inputs)


def _certified(plant: Plant, spec: Spec, *rest: Any) -> INC:
    from .starts.linear_feedback import certified_linear_start

    return certified_linear_start(plant, spec, seed=rest[-1]).inc


def _predictive(plant: Plant, spec: Spec, *_: Any) -> INC:
    from .starts.predictive import predictive_start

    return predictive_start(plant, spec, MOST_MPC_UNITS).inc


def _explicit(plant: Plant, spec: Spec, *_: Any) -> INC:
    """The longest horizon up to that of "MPC" whose regions are few."""
    from .starts.explicit import explicit_start
    from .starts.predictive import predictive_start

    longest = predictive_start(plant, spec, MOST_MPC_UNITS).horizon
    reason: INCError = InvalidInputError(f"explicit MPC has too many regions with {plant.n} states")
    for horizon in [N for N in EXPLICIT_HORIZONS if N <= longest] if plant.n <= MOST_EXPLICIT_STATES else []:
        try:
            return explicit_start(plant, spec, horizon, MOST_MPC_UNITS, seconds=inf, pieces=EXPLICIT_PIECES).inc
        except (InvalidInputError, ConvergenceError) as error:
            reason = error
    raise reason


def _compressed(plant: Plant, spec: Spec, hidden: int, activation: Activation, kappa: float, seed: int) -> INC:
    from .compression import compress

    return compress(plant, spec, _predictive(plant, spec), hidden, activation=activation, kappa=kappa,
                    iterations=IMITATION, training_iterations=0, seed=seed).inner


STARTS: Mapping[str, Start] = MappingProxyType({
    "clipped LQR": _around(_regulator),               # the state is measured
    "static gain": _around(_limited_gain),            # best u = F y found that keeps the limits on the initial set
    "kept gain": _around(_kept_gain),                 # one that is proved to keep them at all times: never clipped
    "seldom clipped gain": _around(_seldom_clipped),  # between that and the best without limits, by its certified cost
    "clipped gain": _around(stabilizing_gain),              # best u = F y found without limits, to be clipped
    "stabilizing gain": _around(_stabilizing_gain),   # the same without discount, so that motions converge
    "halfway gain": _around(_halfway_gain),           # the mean of those two: clipped less often
    "certified linear": _certified,                   # the best of several such means that the gate certifies
    "sector inequality": _sector_feedback,            # certified in the same convex program that finds it
    "MPC": _predictive,                               # model predictive control, exactly, limits built in
    "explicit MPC": _explicit,                        # its regions on a box of states, as a network without loops
    "compressed MPC": _compressed,                    # a few units that imitate it
    "random": random_start,
})
