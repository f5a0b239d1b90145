"""Improve a start for a plant in continuous time: the implicit controller is trained by collocation of its motions."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from inc_casadi.arrays import number
from inc_casadi.errors import InvalidInputError
from inc_casadi.inc import INC
from inc_casadi.plant import Plant, as_plant
from inc_casadi.sets.rules import whole
from inc_casadi.spec import Spec

from .ball import balanced, row_bound
from .collocation_search import LEVELS, minimize_collocated
from .continuous_setup import COARSE, FINE, ContinuousSetup, continuous_setup
from .phase_log import PhaseLog
from .rollout import Parameters
from .training import Training, ended
from .training_options import check_start

_GAIN = 1e-6  # relative; a smaller gain is within the error of the integrator, and the start is the simpler law


def train_continuous(plant: Any, spec: Spec, start: INC, *, kappa: float = 0.95, horizon: float | None = None,
                     steps: int | None = None, degree: int = 3, order: int | None = None, anchored: bool = True,
                     frozen: Sequence[str] = (), max_iterations: int = 60, time_limit: float | None = None,
                     progress: Callable[[dict[str, Any]], None] | None = None, seed: int = 0) -> Training:
    """Return the implicit controller that one NLP makes of a start, for dx/dt = A x + B u with u applied continuously.

    min sum_i w_i [ int_0^T exp(-gamma t) (x'Q x + u'R u) dt + exp(-gamma T) x(T)'P x(T) ] over W, U, V, K, b (and d), from
    node i of a quadrature of the initial distribution, with u = clip(v), v = K y + V eta + d, eta = phi(W eta + U y + b) at
    every instant, and ||W||_inf <= kappa (prop:projected_training_wp). Per second are A, B, Q, R and the discount:
    gamma = -log(spec.discount). The motions are polynomials of `degree` on `steps` intervals, which satisfy the equations
    at Radau points (`Collocated`); states, preactivations and inputs there are variables, so a start that is far off is no
    obstacle. Kinks are rounded and the rounding is driven to zero. P is the cost matrix of the discounted regulator.

    Nothing that the NLP says is reported: costs of the history are motions of the law as it is, and `cost` and `start_cost`
    come from an adaptive integrator on nodes that no phase saw, followed until they settle. The best of start and phases
    there is returned, so training never makes it worse there.

    Parameters
    ----------
    plant : Plant or control.StateSpace with dt = 0
    spec : Spec; its inputs a Box or None
    start : the inner law to begin with, as in `train`
    kappa : bound on ||W||_inf in (0, 1); tighter where an activation is steeper than 1
    horizon : T in seconds; by default until the loop of the regulator has contracted to a hundredth, which may be too short
        where inputs stay at their limits for long
    steps : intervals of the first phase; the second has as many and more nodes. By default about one for each radian or
        time constant of the regulator's fastest mode, within 12 and 40
    degree : of the polynomials, 1 to 9; between kinks of the law the error falls as h^(2 degree - 1)
    order : quadrature points per axis; by default what at most 25 and then 50 nodes allow, random nodes if need be
    anchored : d = -V eta(0), so that the origin stays an equilibrium; only where 0 is an admissible input
    frozen : names among W, U, V, K, b, d that keep the values of the start
    max_iterations : of the first phase; half as many follow on more nodes
    time_limit : seconds for the search; the comparison at the end is extra
    progress : called with dict(phase, iteration, cost, seconds) after each iteration
    seed : of random nodes

    Returns
    -------
    Training; a candidate. What can be certified of it in continuous time: `Stability`, `DiscountedCost`, `L2Gain`, `Margins`
    and, from a set, `Attraction`.

    Raises
    ------
    InvalidInputError : a discrete plant, inputs that are no box, an option out of its range
    DimensionError : the start or the spec does not fit the plant
    NotStabilizableError : no controller has a finite cost
    SolverError : CasADi is missing

    Examples
    --------
    >>> from inc_casadi import Box
    >>> from synthesis.starts.random_start import linear_start
    >>> plant = Plant(A=[[0.0, 1.0], [0.0, 0.0]], B=[[0.0], [1.0]], dt=0)
    >>> spec = Spec(Q=np.eye(2), R=0.1, discount=0.9, initial=Box([-3, -1.5], [3, 1.5]), inputs=Box(-1, 1))
    >>> start = linear_start([[-1.0, -0.8]], plant, spec, hidden=2)
    >>> result = train_continuous(plant, spec, start, horizon=5.0, steps=12, degree=2, order=3, max_iterations=8)
    >>> result.improved, result.inner.well_posedness().norm <= 0.95
    (True, True)
    """
    began = time.perf_counter()
    plant = as_plant(plant)
    _check(plant, spec, start, kappa, frozen)
    limit = np.inf if time_limit is None else number("time_limit", time_limit, 0.0)
    start = start if "W" in frozen else balanced(start, row_bound(start.activations, kappa))
    problem = continuous_setup(plant, spec, start, kappa=kappa, horizon=horizon, steps=steps, degree=degree, order=order,
                               anchored=anchored, frozen=frozen, seed=seed)
    iterations = whole("max_iterations", max_iterations, 0)
    log = PhaseLog(began, limit, progress)
    laws = _phases(problem, Parameters.of(start), iterations, log)
    judged = [(problem.judge(law), np.zeros(0), np.zeros(0)) for law in laws]
    return ended(log, laws, judged, problem.base.inner, problem.base.box, gain=_GAIN, form="collocated")


def _phases(problem: ContinuousSetup, law: Parameters, iterations: int, log: PhaseLog) -> list[Parameters]:
    """Return the law that is begun with and those that the phases end with, each beginning where the last one ended."""
    laws = [law]
    phases = (("coarse", COARSE, iterations, LEVELS), ("fine", FINE, (iterations + 1) // 2, LEVELS[1:]))
    for name, budget, share, levels in phases:
        if log.is_over or share == 0:
            break
        solve = partial(minimize_collocated, problem.form(budget, problem.steps), laws[-1], gain=problem.base.gain,
                        levels=levels, watched=problem.watched(problem.steps), max_iterations=share)
        laws.append(problem.base.settled(log.entered(name, solve)))
    return laws


def _check(plant: Plant, spec: Spec, start: INC, kappa: float, frozen: Sequence[str]) -> None:
    if plant.discrete:
        raise InvalidInputError(f"train_continuous is for plants in continuous time, but the plant has dt = {plant.dt:g}: "
                                "use train")
    check_start(plant, spec, start, kappa, frozen)
