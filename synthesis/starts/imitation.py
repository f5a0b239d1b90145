"""The start from a teacher: an INC with few units fitted to the inputs of another law on the states that are visited."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from inc_casadi.arrays import Array, matrix, number
from inc_casadi.brief import Brief
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.inc import INC
from inc_casadi.linear.regulator import discounted_lqr
from inc_casadi.plant import Plant, as_plant
from inc_casadi.sets import Box
from inc_casadi.sets.rules import whole
from inc_casadi.spec import Spec

from ..ball import balanced, row_bound
from ..objective import Layout, Objective
from ..rollout import Parameters, Scenario, hidden, roll
from ..training_nodes import default_horizon, nodes_of
from .random_start import input_range, measurement_range

Law = Callable[[Array], Array]
SKETCH = 400  # points of the Gauss-Newton Hessian
MOST_PARAMETERS = 700  # from here on the Hessian is a limited-memory one


@dataclass(frozen=True, eq=False)
class Lessons:
    """What a teacher does at visited states: measurements y (p, N), inputs u (m, N), weights (N,) that sum to 1."""

    y: Array
    u: Array
    weights: Array

    def joined(self, more: Lessons) -> Lessons:
        """Return both, each with half the weight."""
        return Lessons(np.hstack([self.y, more.y]), np.hstack([self.u, more.u]),
                       np.concatenate([self.weights, more.weights]) / 2)


@dataclass(frozen=True, eq=False)
class Imitation(Brief):
    """inner: the fitted law, input limits not built in; error, start_error: the weighted squared error of the fitted law and
    of the start, as a share of the teacher's own weighted square; status: how the fit ended.
    """

    inner: INC
    error: float
    start_error: float
    status: str


def lessons(plant: Any, spec: Spec, teacher: Law, along: Law | None = None, points: int = 3000, seed: int = 0) -> Lessons:
    """Return the teacher's inputs at the states that a law visits from the initial distribution.

    The state x_k that begins at node i has weight w_i beta^k: that of its stage cost.

    teacher: y (p, N) -> u (m, N); along: the law that is followed, the teacher itself when left out; points: about how
    many; seed: of random nodes.

    Raises InvalidInputError when the law that is followed loses the state.

    >>> spec = Spec(Q=1.0, R=1.0, discount=1.0, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> taught = lessons(Plant(0.5, 1.0), spec, lambda y: -0.4 * y, points=60)
    >>> taught.y.shape == taught.u.shape, round(float(taught.weights.sum()), 9)
    (True, 1.0)
    """
    plant = as_plant(plant)
    spec.check(plant)
    K, _ = discounted_lqr(plant, spec)
    steps = default_horizon(plant, spec, K)
    x, w = nodes_of(spec.initial, max(1, whole("points", points, 1) // steps), seed)
    y, u = [], []
    for _ in range(steps):
        y.append(plant.C @ x)
        u.append(teacher(y[-1]))
        x = plant.A @ x + plant.B @ (u[-1] if along is None else along(y[-1]))
    seen = np.hstack(y)
    if not np.all(np.isfinite(seen)) or np.max(np.abs(seen)) > 1e6 * np.max(np.abs(y[0])):
        raise InvalidInputError(f"the law that is to be followed loses the state within {steps} steps: there is nothing to "
                                "be learned on its way")
    weights = np.outer(spec.discount ** np.arange(steps), w).ravel()
    return Lessons(seen, np.hstack(u), weights / weights.sum())


def imitate(plant: Any, spec: Spec, taught: Lessons, start: INC, kappa: float = 0.95, iterations: int = 60,
            time_limit: float | None = None) -> Imitation:
    """Return the law nearest to the lessons that IPOPT finds from a start, ||W||_inf <= kappa.

        min over W, U, V, K, b, d of sum_j w_j (u_j - t_j)'M (u_j - t_j),   u_j = clip(law(y_j)),   M = R + beta B'P B,

    t_j the teacher's inputs. M is what a wrong input costs: without limits, J(law) - x'P x = sum_k beta^k
    (u_k - K x_k)'M (u_k - K x_k) along the law's own motion, P of the discounted LQR.

    It is one step of a rollout: from (y, t) the plant ( 0 0; 0 -I ), ( 0; I ) leads to (0, u - t), which the terminal cost
    weighs by M. Value, gradient and Gauss-Newton Hessian are those of training. As there, d = -V eta(y = 0) where 0 is an
    admissible input.

    Parameters
    ----------
    plant, spec : spec.inputs a Box, or None
    taught : `lessons`
    start : the inner law to begin with, p measurements, m outputs
    kappa, iterations, time_limit : as in `train`

    Raises
    ------
    DimensionError : plant, start and lessons do not fit each other
    InvalidInputError : inputs are a Polytope; ||W||_inf of the start above kappa for good

    Notes
    -----
    Not convex: a local minimum. Small errors cost little, but nothing is promised of the loop.

    >>> from .random_start import linear_start
    >>> plant, spec = Plant(0.9, 1.0), Spec(Q=1.0, R=1.0, discount=1.0, initial=Box(-2, 2), inputs=Box(-1, 1))
    >>> taught = lessons(plant, spec, lambda y: -np.tanh(y), points=300)
    >>> found = imitate(plant, spec, taught, linear_start([[-0.5]], plant, spec, 4), iterations=20)
    >>> found.error < 0.2 * found.start_error
    True
    """
    from ..nlp import minimize

    plant = as_plant(plant)
    _check(plant, spec, taught, start)
    start = balanced(start, row_bound(start.activations, number("kappa", kappa, 0.0, 1.0, open_low=True, open_high=True)))
    scenario, layout = _as_rollout(plant, spec, taught, start), _layout(plant, spec, start, kappa)
    law = Parameters.of(start)
    size, before = _size(scenario), roll(scenario, law).cost
    scale = before if 0 < before < np.inf else 1.0
    sketch = _thinned(scenario)
    hessian = "gauss-newton" if layout.fixed.size <= MOST_PARAMETERS else "limited-memory"
    found = minimize(Objective(scenario, layout, scale, sketch), law, hessian=hessian,
                     max_iterations=whole("iterations", iterations, 1), time_limit=time_limit)
    after = roll(scenario, found.law).cost
    best, error = (_settled(scenario, found.law), after) if after < before else (_settled(scenario, law), before)
    return Imitation(INC(*best, activation=start.activations), error / size, before / size, found.status)


def _as_rollout(plant: Plant, spec: Spec, taught: Lessons, start: INC) -> Scenario:
    p, m = plant.p, plant.m
    _, P = discounted_lqr(plant, spec)
    M = spec.R + spec.discount * plant.B.T @ P @ plant.B
    free = np.full(m, np.inf)
    lower, upper = (spec.inputs.lower, spec.inputs.upper) if isinstance(spec.inputs, Box) else (-free, free)
    A, terminal = np.zeros((p + m, p + m)), np.zeros((p + m, p + m))
    A[p:, p:], terminal[p:, p:] = -np.eye(m), (M + M.T) / 2
    return Scenario(A, np.vstack([np.zeros((p, m)), np.eye(m)]), np.eye(p, p + m), 0 * A, np.zeros((m, m)), 1.0, terminal,
                    np.vstack([taught.y, taught.u]), taught.weights, 1, lower, upper, np.zeros((0, m)), np.zeros(0), 0.0,
                    start.activations, anchored=_anchored(spec))


def _layout(plant: Plant, spec: Spec, start: INC, kappa: float) -> Layout:
    u, y, one = input_range(spec), measurement_range(plant, spec), np.ones(start.q)
    scales = Parameters(np.ones_like(start.W), np.outer(one, 1 / y), np.outer(u, one), np.outer(u, 1 / y), one, u)
    return Layout.of(Parameters.of(start), scales, ("d",) if _anchored(spec) else (), row_bound(start.activations, kappa))


def _anchored(spec: Spec) -> bool:
    return spec.inputs is None or bool(spec.inputs.contains(np.zeros(spec.m)))


def _settled(scenario: Scenario, law: Parameters) -> Parameters:
    """The law with its d written out."""
    if not scenario.anchored:
        return law
    eta, _ = hidden(scenario, law.W, law.b[None], np.zeros((1, scenario.q)))
    return law._replace(d=-(law.V @ eta[0]))


def _size(scenario: Scenario) -> float:
    """The teacher's own weighted square, or 1 when it does nothing."""
    m = scenario.B.shape[1]
    t = scenario.nodes[-m:]
    square = float(np.sum(t * (scenario.terminal[-m:, -m:] @ t), axis=0) @ scenario.weights)
    return square if square > 0 else 1.0


def _thinned(scenario: Scenario) -> Scenario:
    """The scenario with every so-many-th point, and weights that sum to what they did."""
    if scenario.weights.size <= SKETCH:
        return scenario
    kept = np.linspace(0, scenario.weights.size - 1, SKETCH).astype(int)
    weights = scenario.weights[kept]
    return replace(scenario, nodes=scenario.nodes[:, kept], weights=weights * (scenario.weights.sum() / weights.sum()))


def _check(plant: Plant, spec: Spec, taught: Lessons, start: INC) -> None:
    spec.check(plant)
    if spec.inputs is not None and not isinstance(spec.inputs, Box):
        raise InvalidInputError("the inputs are a Polytope, but a fitted law is clipped to a Box")
    if (start.p, start.m) != (plant.p, plant.m):
        raise DimensionError(f"start maps {start.p} measurements to {start.m} inputs, but the plant has {plant.p} "
                             f"measurements and {plant.m} inputs")
    matrix("y", taught.y, (plant.p, None))
    matrix("u", taught.u, (plant.m, taught.y.shape[1]))
