"""What a training works on: the scenarios of its phases, the layout of its variables, and the judge of its laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from inc_casadi.activations import stack
from inc_casadi.arrays import Array, symmetric
from inc_casadi.errors import InvalidInputError
from inc_casadi.inc import INC
from inc_casadi.plant import Plant
from inc_casadi.sets import Box, Distribution, Empirical, Polytope
from inc_casadi.sets.rules import whole
from inc_casadi.spec import Spec

from .objective import Layout
from .rollout import Parameters, Scenario, hidden, roll
from .starts.lqr import discounted_lqr
from .starts.random_start import input_range, measurement_range

COARSE, FINE, JUDGE, CONSTRAINED = 130, 400, 900, 40  # most nodes: first phase, last phase, judge, input constraints
_HESSIAN_WORK, _HESSIAN_NODES = 5e8, 40  # multiplications that one Hessian may take; fewest nodes it is thinned to
_MOST_VERTICES = 64


@dataclass(frozen=True, eq=False)
class Setup:
    """One training problem: see `train` for the options.

    K, P: the discounted LQR; terminal (n, n); scale: the cost that LQR without limits would have; limits: (H, h) when
    the inputs are a polytope; layout: of the variables.
    """

    plant: Plant
    spec: Spec
    units: stack.Units
    terminal: Array
    scale: float
    horizon: int
    order: int | None
    anchored: bool
    seed: int
    layout: Layout
    limits: tuple[Array, Array] | None

    def scenario(self, budget: int, steps: int) -> Scenario:
        """Return the scenario on at most `budget` nodes, and on the vertices too when the inputs are a polytope."""
        nodes, weights = nodes_of(self.spec.initial, budget, self.seed, self.order)
        if self.limits is not None:
            corners = _corners(self.spec.initial)
            nodes = np.hstack([nodes, corners])
            weights = np.concatenate([weights, np.zeros(corners.shape[1])])
        return self._scenario(nodes, weights, steps, self.anchored)

    def coarse(self) -> Scenario:
        """Return the scenario of the first phase at full horizon."""
        return self.scenario(COARSE if self.limits is None else CONSTRAINED, self.horizon)

    def fine(self) -> Scenario:
        """Return the scenario of the last phase."""
        return self.scenario(FINE if self.limits is None else 2 * CONSTRAINED, self.horizon)

    def sketch(self, scenario: Scenario) -> Scenario | None:
        """Return the scenario of the Gauss-Newton Hessian, thinned to bound its work; None where that cannot be."""
        parameters = self.layout.fixed.size
        work = _HESSIAN_WORK / (scenario.steps * (self.plant.n + self.plant.m) * parameters**2)
        if work < _HESSIAN_NODES:
            return None
        budget = min(COARSE, int(work))
        return scenario if scenario.weights.size <= budget else self.scenario(budget, scenario.steps)

    def judge(self, law: Parameters) -> tuple[float, Array]:
        """Return the cost of a law and the largest H u - h per half-space, on nodes that no phase trains on."""
        motion = roll(self._judge, law)
        if self.limits is None:
            return motion.cost, np.zeros(0)
        H, h = self.limits
        return motion.cost, np.max(motion.u @ H.T - h, axis=(0, 1))

    def settled(self, law: Parameters) -> Parameters:
        """Return the law with its d written out: -V eta(0) when it is anchored."""
        if not self.anchored:
            return law
        eta, _ = hidden(self._judge, law.W, law.b[None], np.zeros((1, law.b.size)))
        return law._replace(d=-(law.V @ eta[0]))

    def inner(self, law: Parameters) -> INC:
        """Return the law as an INC, input limits not built in."""
        return INC(*law, activation=self.units)

    @cached_property
    def _judge(self) -> Scenario:
        order = None if self.order is None else 2 * self.order + 1
        nodes, weights = nodes_of(self.spec.initial, JUDGE, self.seed + 1, order)
        if self.limits is not None:
            corners = _corners(self.spec.initial)
            nodes, weights = np.hstack([nodes, corners]), np.concatenate([weights, np.zeros(corners.shape[1])])
        return self._scenario(nodes, weights, max(100, 4 * self.horizon), False)

    def _scenario(self, nodes: Array, weights: Array, steps: int, anchored: bool) -> Scenario:
        plant, spec = self.plant, self.spec
        free = np.full(plant.m, np.inf)
        lower, upper = (spec.inputs.lower, spec.inputs.upper) if isinstance(spec.inputs, Box) else (-free, free)
        return Scenario(plant.A, plant.B, plant.C, spec.Q, spec.R, spec.discount, self.terminal, nodes, weights, steps,
                        lower, upper, self.units, anchored)


def setup(plant: Plant, spec: Spec, start: INC, *, kappa: float, horizon: int | None, order: int | None, anchored: bool,
          frozen: Sequence[str], terminal: ArrayLike | None, seed: int) -> Setup:
    """Return the training problem of a start; the arguments are those of `train`."""
    K, P = discounted_lqr(plant, spec)
    S0 = spec.initial.second_moment
    anchored = anchored and (spec.inputs is None or bool(spec.inputs.contains(np.zeros(plant.m))))
    law = Parameters.of(start)
    # Without limits the inputs are measured by those that LQR would use.
    effort = np.sqrt(np.einsum("ij,jk,ik->i", K, S0, K))
    u = input_range(spec) if spec.inputs is not None else np.where(effort > 0, effort, 1.0)
    y, one = measurement_range(plant, spec), np.ones(start.q)
    scales = Parameters(np.ones_like(start.W), np.outer(one, 1 / y), np.outer(u, one), np.outer(u, 1 / y), one, u)
    layout = Layout.of(law, scales, (*frozen, "d") if anchored else frozen, row_bound(start.activations, kappa))
    if layout.size == 0:
        raise InvalidInputError(f"frozen = {tuple(frozen)} leaves nothing to train")
    scale = float(np.trace(P @ S0))
    return Setup(
        plant, spec, start.activations, P if terminal is None else symmetric("terminal", terminal, plant.n, "semi"),
        scale if scale > 0 else 1.0,
        default_horizon(plant, spec, K) if horizon is None else whole("horizon", horizon, 1),
        None if order is None else whole("order", order, 1), anchored, seed, layout,
        (spec.inputs.H, spec.inputs.h) if isinstance(spec.inputs, Polytope) else None)


def row_bound(units: stack.Units, kappa: float) -> float:
    """Return the bound on the row sums of |W|: kappa, or less where units are steeper than 1.

    >>> from inc_casadi import ReLU
    >>> row_bound((ReLU(),), 0.9)
    0.9
    """
    return kappa / max(1.0, float(np.max(stack.lipschitz(units), initial=0.0)))


def balanced(start: INC, bound: float) -> INC:
    """Return the same law with ||W||_inf <= bound, rescaling units that are linear on both half lines if need be.

    For v > 0 the hidden units eta / v give W' = diag(1/v) W diag(v); v = (c I - |W|)^{-1} 1 makes every row sum of |W'|
    less than c, for any c above lambda_pf(|W|).

    Raises
    ------
    InvalidInputError : the norm is above the bound and cannot be brought below

    >>> deep = INC(W=[[0.0, 0.0], [5.0, 0.0]], U=[[1.0], [0.0]], V=[[0.0, 1.0]], K=[[0.0]])
    >>> even = balanced(deep, 0.9)
    >>> even.well_posedness().norm < 0.9, even([2.0]).round(9).tolist()
    (True, [10.0])
    """
    norm = float(np.max(np.abs(start.W).sum(axis=1), initial=0.0))
    if norm <= bound:
        return start
    level = 0.9 * bound
    radius = float(np.max(np.abs(np.linalg.eigvals(np.abs(start.W)))))
    if radius >= level or any(unit.homogeneous is None for unit in start.activations):
        raise InvalidInputError(f"start has ||W||_inf = {norm:.6g}, above the bound {bound:.6g} of the training, and "
                                "its units cannot be rescaled to meet it: raise kappa, project W first, or freeze W")
    v = np.linalg.solve(level * np.eye(start.q) - np.abs(start.W), np.ones(start.q))
    return INC(start.W * v / v[:, None], start.U / v[:, None], start.V * v, start.K, start.b / v, start.d,
               start.activation)


def default_horizon(plant: Plant, spec: Spec, K: Array) -> int:
    """Return the steps in which sqrt(beta) (A + B K) contracts to a hundredth, within 15 and 50.

    >>> from inc_casadi import Box
    >>> default_horizon(Plant(0.9, 1.0), Spec(Q=1.0, R=1.0, discount=1.0, initial=Box(-1, 1)), np.zeros((1, 1)))
    44
    """
    radius = np.sqrt(spec.discount) * float(np.max(np.abs(np.linalg.eigvals(plant.A + plant.B @ K))))
    return int(np.clip(np.ceil(np.log(0.01) / np.log(radius)), 15, 50)) if 0 < radius < 1 else 15


def nodes_of(initial: Distribution, budget: int, seed: int, order: int | None = None) -> tuple[Array, Array]:
    """Return nodes (n, N) and weights (N,): the quadrature of this order, or the finest that a budget allows.

    Where a budget allows less than three points per axis, `budget` random nodes serve better.

    >>> from inc_casadi import Box, Uniform
    >>> nodes_of(Uniform(Box([0, 0], [1, 1])), 30, seed=0)[1].size
    25
    """
    if order is not None:
        return initial.quadrature(order)
    if isinstance(initial, Empirical) and initial.weights.size <= budget:
        return initial.quadrature(1)
    for points in range(int(min(round(budget ** (1 / initial.dimension)), 40)), 2, -1):
        try:
            nodes, weights = initial.quadrature(points)
        except InvalidInputError:
            continue  # too many nodes
        if weights.size <= budget:
            return nodes, weights
    return initial.sample(budget, np.random.default_rng(seed)), np.full(budget, 1 / budget)


def _corners(initial: Distribution) -> Array:
    try:
        vertices = initial.vertices
    except InvalidInputError:
        return np.zeros((initial.dimension, 0))
    return vertices if vertices.shape[1] <= _MOST_VERTICES else np.zeros((initial.dimension, 0))
