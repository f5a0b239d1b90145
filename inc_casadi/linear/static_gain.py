"""The best static linear gain u = F y that keeps the input limits on the initial set, by local search."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, number
from ..brief import Brief
from ..errors import InfeasibleError, InvalidInputError
from ..plant import Plant, as_plant
from ..reachability import uncontrollable_vertex
from ..sets import Gaussian
from ..sets.farthest import farthest
from ..sets.rules import whole
from ..spec import Spec
from .gain_search import ADMISSIBLE_TOL, Admissible, annealed, evaluate, excess
from .regulator import damped_plant, discounted_lqr

_INWARD = 1 - 1e-14  # so that rounding does not put a gain at the limits beyond them
_LISTED = 2000  # rows of constraints that are listed at once; more are added when violated


@dataclass(frozen=True, eq=False)
class StaticGain(Brief):
    """A static linear controller u = F y, what it costs, and whether it keeps the input limits on the initial set.

    F : (m, p); cost : tr(P_F S0), infinite if the loop is unstable in the discounted sense; admissible : at k = 0
    """

    F: Array
    cost: float
    admissible: bool


def best_static_gain(plant: Any, spec: Spec, *, seed: int = 0, starts: int = 6,
                     seconds: float | None = None) -> StaticGain:
    """Return the best static linear gain found among those that keep the input limits on the initial set.

    min over F of tr(P_F S0), P_F = Q + C'F'R F C + beta (A + BFC)'P_F (A + BFC), subject to H_u F C v <= h_u for every
    initial state v. The gradient is 2 (R F C + beta B'P_F (A + BFC)) S C' with S = S0 + beta (A + BFC) S (A + BFC)'.
    From each start a sequential quadratic program goes downhill, first with the future discounted so much that the cost
    is finite, then with the discount raised to beta. In continuous time the Lyapunov equations are the continuous ones.

    Parameters
    ----------
    plant : Plant or control.StateSpace
    spec : Spec; initial on a bounded set when there are input limits
    seed : of the random starts
    starts : how many: no feedback, the scaled LQR gain, and random admissible gains
    seconds : after which each search ends with what it has

    Returns
    -------
    StaticGain: an upper bound on the best, which need not be global, for the problem is not convex in F.

    Raises
    ------
    NotStabilizableError : no input reaches an unstable mode
    InfeasibleError : no gain keeps the limits, an unstable mode is not measured, or no start led to a stable loop
    InvalidInputError : a Gaussian initial state with input limits; a continuous plant with discount below 1
    SolverError : Clarabel or SciPy is missing

    Notes
    -----
    Source: eq:PF_lyap. Admissibility is on the initial set, as in sec:numerics, and so necessary for admissibility
    along trajectories.

    Examples
    --------
    >>> from inc_casadi import Box, Plant, Spec
    >>> scalar = Spec(Q=1.0, R=0.0, discount=0.5, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> gain = best_static_gain(Plant(1.5, 1.0), scalar)
    >>> gain.F.round(6).tolist(), round(gain.cost, 6), gain.admissible  # 1 / (3 (1 - beta / 4)), thm:lsof_sep
    ([[-1.0]], 0.380952, True)
    """
    plant = as_plant(plant)
    spec.check(plant)
    _refuse_gaussian(spec)
    K, _ = discounted_lqr(plant, spec)
    _refuse_unmeasured(plant, spec)
    admissible, damped = _listed(plant, spec), damped_plant(plant, spec)
    gains = _starts(admissible, K, np.random.default_rng(seed), whole("starts", starts, 1))
    if seconds is not None:
        admissible.until = time.monotonic() + number("seconds", seconds, 0.0)
    reached = [annealed(damped, admissible, F) for F in gains]
    found = [_judged(plant, spec, _scaled(plant, spec, F)) for F in reached if F is not None]
    if not found:
        obstacle = uncontrollable_vertex(plant, spec)
        raise InfeasibleError(
            f"no static gain u = F y was found that stabilizes the plant (discounted by {spec.discount:g}) and keeps "
            f"the input limits on the initial set, from {starts} starts{_within(seconds)}; that is evidence, not proof. "
            + (obstacle or "Try more starts, a smaller initial set, more measurements, or a dynamic controller."))
    return min(found, key=lambda gain: gain.cost)


def _within(seconds: float | None) -> str:
    return "" if seconds is None else f" in {seconds:g} s"


def scaled_lqr_gain(plant: Any, spec: Spec) -> StaticGain:
    """Return the discounted LQR gain, scaled down just enough to keep the input limits on the initial set.

    F = t K C^+ with the largest t in [0, 1] such that H_u F C x <= h_u for every initial state x.

    Parameters
    ----------
    plant : Plant or control.StateSpace
    spec : Spec; initial on a bounded set when there are input limits

    Returns
    -------
    StaticGain, of infinite cost if the scaled gain does not stabilize.

    Raises
    ------
    As discounted_lqr; InvalidInputError : a Gaussian initial state with input limits

    Examples
    --------
    >>> from inc_casadi import Box, Plant, Spec
    >>> scaled_lqr_gain(Plant(1.5, 1.0), Spec(1.0, 0.0, 1.0, Box(-1, 1), Box(-1, 1))).F.round(6).tolist()
    [[-1.0]]
    """
    plant = as_plant(plant)
    spec.check(plant)
    _refuse_gaussian(spec)
    K, _ = discounted_lqr(plant, spec)
    return _judged(plant, spec, _scaled(plant, spec, K @ np.linalg.pinv(plant.C)))


def _judged(plant: Plant, spec: Spec, F: Array) -> StaticGain:
    cost, _, _ = evaluate(damped_plant(plant, spec), spec, F, spec.initial.second_moment)
    admissible = spec.inputs is None or bool(np.max(excess(plant, spec, F)[0]) <= ADMISSIBLE_TOL)
    return StaticGain(F, cost, admissible)


def _scaled(plant: Plant, spec: Spec, F: Array) -> Array:
    # Times the largest t in [0, 1] that keeps the limits, if any does.
    if spec.inputs is None:
        return F
    rows = spec.inputs.H @ F @ plant.C
    most = np.sum(rows * farthest(spec.initial, rows.T).T, axis=1)
    room = np.divide(spec.inputs.h, most, out=np.ones_like(most), where=most > 0)
    return F * float(np.clip(_INWARD * np.min(room), 0.0, 1.0))


def _refuse_gaussian(spec: Spec) -> None:
    if spec.inputs is not None and isinstance(spec.initial, Gaussian):
        raise InvalidInputError("initial is a Gaussian, which no bounded set carries, so no gain but zero keeps the "
                                "input limits: use a distribution on a bounded set, or inputs=None")


def _refuse_unmeasured(plant: Plant, spec: Spec) -> None:
    modes = damped_plant(plant, spec).undetectable_modes()
    if modes:
        value = modes[0] / np.sqrt(spec.discount) if plant.discrete else modes[0] - np.log(spec.discount) / 2
        shown = f"{value.real:.6g}" if abs(value.imag) < 1e-12 else f"{value.real:.6g} {value.imag:+.6g}i"
        raise InfeasibleError(f"the output does not show the unstable mode {shown}, so no output feedback can "
                              "stabilize it: measure more")


def _listed(plant: Plant, spec: Spec) -> Admissible:
    admissible = Admissible(plant, spec)
    if spec.inputs is None:
        return admissible
    try:
        vertices = spec.initial.vertices
    except InvalidInputError:  # an ellipsoid, or a box of too many vertices: the violated ones are added as they come
        return admissible
    if vertices.shape[1] * len(spec.inputs.h) <= _LISTED:
        for facet in range(len(spec.inputs.h)):
            admissible.add(facet, vertices)
    return admissible


def _starts(admissible: Admissible, K: Array, rng: np.random.Generator, count: int) -> list[Array]:
    plant, spec = admissible.plant, admissible.spec
    full = K @ np.linalg.pinv(plant.C)
    size = np.linalg.norm(full) + 1e-3
    draws = [np.asarray(size * rng.standard_normal(full.shape)) for _ in range(count)]
    candidates = ([0 * full, full] + draws)[:count]
    if spec.inputs is not None and np.any(spec.inputs.h < 0):  # zero is not admissible: the nearest gains that are
        return [admissible.nearest(np.eye(F.size), -F.ravel(), F.shape) for F in candidates]
    return [_scaled(plant, spec, F) for F in candidates]
