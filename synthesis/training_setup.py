"""What a training works on: the scenarios of its phases, the layout of its variables, and the judge of its laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from inc_casadi.activations import stack
from inc_casadi.arrays import Array, symmetric
from inc_casadi.errors import InvalidInputError
from inc_casadi.inc import INC
from inc_casadi.linear.regulator import discounted_lqr
from inc_casadi.plant import Plant
from inc_casadi.sets import Box, Polytope
from inc_casadi.sets.rules import whole
from inc_casadi.spec import Spec

from .ball import project_rows, row_bound
from .input_box import box_and_limits
from .objective import Layout
from .rollout import Motion, Parameters, Scenario, hidden, roll
from .starts.random_start import input_range, measurement_range
from .training_nodes import COARSE, JUDGE, default_horizon, finer, nodes_of, with_corners

_HESSIAN_WORK, _HESSIAN_NODES = 5e8, 40  # multiplications that one Hessian may take; fewest nodes it is thinned to
_HESSIAN_SIZE = 1000  # variables above which a dense Hessian costs more, to pass on and to factor, than it gains
_PENALTY = 100.0  # on inputs outside a polytope: this many times the cost scale, at once the polytope's size outside


@dataclass(frozen=True, eq=False)
class Setup:
    """One training problem: see `train` for the options.

    units: activations of the law; terminal (n, n); scale: the cost that LQR without limits would have; layout: of the
    variables; box: the inputs, or the bounding box of a polytope, to which the law is clipped; limits: (H, h), the
    half-spaces of the polytope that cut into its bounding box, None if there are none; states: (G, g), the half-spaces
    that states should keep; gain (m, n): of the discounted LQR.
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
    box: Box | None
    limits: tuple[Array, Array] | None
    states: tuple[Array, Array] | None
    gain: Array

    def split(self, excess: Array) -> tuple[Array, Array]:
        """Return the entries of a vector over all half-spaces that concern inputs, and those that concern states."""
        cut = 0 if self.limits is None else self.limits[1].size
        return excess[:cut], excess[cut:]

    @property
    def rows(self) -> int:
        """Number of half-spaces that are watched: those of inputs that cut into their box, and those of states."""
        return sum(pair[1].size for pair in (self.limits, self.states) if pair is not None)

    @property
    def reach(self) -> Array:
        """The size of the sets along each half-space: half the width of the box of inputs, and |g| for states, or 1."""
        parts = [np.zeros(0)]
        if self.limits is not None and self.box is not None:
            parts.append(np.abs(self.limits[0]) @ (self.box.upper - self.box.lower) / 2)
        if self.states is not None:
            parts.append(np.where(self.states[1] == 0.0, 1.0, np.abs(self.states[1])))
        return np.concatenate(parts)

    def scenario(self, budget: int, margin: Array | float = 0.0, steps: int | None = None, *, corners: bool = False,
                 beside: Array | None = None) -> Scenario:
        """Return the scenario on at most `budget` nodes, its half-spaces of the inputs tightened by a margin.

        corners: the vertices of the initial set are nodes too, without weight, for what must hold from there; beside
        (n, k): further nodes without weight.
        """
        nodes, weights = nodes_of(self.spec.initial, budget, self.seed, self.order)
        if corners:
            nodes, weights = with_corners(self.spec.initial, nodes, weights)
        if beside is not None:
            nodes, weights = np.hstack([nodes, beside]), np.concatenate([weights, np.zeros(beside.shape[1])])
        plain = self._scenario(nodes, weights, self.horizon if steps is None else steps, self.anchored)
        if self.limits is None or self.box is None:
            return plain
        H, h = self.limits
        reach = float(np.mean(self.reach[:h.size]))
        return replace(plain, H=H, h=h - margin, penalty=_PENALTY * self.scale / reach**2)

    def sketch(self, scenario: Scenario) -> Scenario | None:
        """Return the scenario of the Gauss-Newton Hessian, thinned to bound its work; None where that cannot be."""
        parameters = self.layout.fixed.size
        work = _HESSIAN_WORK / (scenario.steps * (self.plant.n + self.plant.m) * parameters**2)
        if work < _HESSIAN_NODES or self.layout.size > _HESSIAN_SIZE:
            return None
        budget = min(COARSE, int(work))
        thin = self.scenario(budget)
        return scenario if scenario.weights.size <= thin.weights.size else replace(
            scenario, nodes=thin.nodes, weights=thin.weights)

    def judge(self, law: Parameters) -> tuple[float, Array]:
        """Return the cost of a law and the largest H u - h and G x - g per half-space, on nodes that no phase trains on.

        The initial state is no law's doing and not among the states.
        """
        motion = roll(self._judge, law)
        return motion.cost, np.max(self._excess(motion), axis=1)

    def worst_starts(self, law: Parameters) -> Array:
        """Return initial states (n, k) from which a law leaves its half-spaces farthest, up to two for each."""
        excess = self._excess(roll(self._judge, law))
        order = np.argsort(-excess, axis=1)[:, :2]
        left = np.take_along_axis(excess, order, axis=1) > 0.0
        return self._judge.nodes[:, np.unique(order[left])]

    def _excess(self, motion: Motion) -> Array:
        """Return the largest H u - h and G x - g along each motion, (half-spaces, N)."""
        seen = [(motion.u, self.limits), (motion.x[1:], self.states)]
        with np.errstate(over="ignore", invalid="ignore"):
            excess = [np.max(points @ pair[0].T - pair[1], axis=0).T for points, pair in seen if pair is not None]
        worst = np.concatenate([np.zeros((0, motion.x.shape[1])), *excess])
        return np.where(np.isnan(worst), np.inf, worst)

    def settled(self, law: Parameters) -> Parameters:
        """Return the law with its d written out, -V eta(0) when it is anchored, and ||W||_inf <= kappa to the last bit."""
        if self.layout.rows.size:
            law = law._replace(W=project_rows(law.W, self.layout.kappa))
        if not self.anchored:
            return law
        eta, _ = hidden(self._judge, law.W, law.b[None], np.zeros((1, law.b.size)))
        return law._replace(d=-(law.V @ eta[0]))

    def inner(self, law: Parameters) -> INC:
        """Return the law as an INC, input limits not built in."""
        return INC(*law, activation=self.units)

    @cached_property
    def _judge(self) -> Scenario:
        order = finer(self.spec.initial, self.order)
        budget = int(JUDGE * min(1.0, 12 / max(len(self.units), 1)))
        nodes, weights = nodes_of(self.spec.initial, budget, self.seed + 1, order)
        if self.rows:
            nodes, weights = with_corners(self.spec.initial, nodes, weights)
        return self._scenario(nodes, weights, max(100, 4 * self.horizon), False)

    def _scenario(self, nodes: Array, weights: Array, steps: int, anchored: bool) -> Scenario:
        plant, spec = self.plant, self.spec
        free = np.full(plant.m, np.inf)
        lower, upper = (-free, free) if self.box is None else (self.box.lower, self.box.upper)
        return Scenario(plant.A, plant.B, plant.C, spec.Q, spec.R, spec.discount, self.terminal, nodes, weights, steps,
                        lower, upper, np.zeros((0, plant.m)), np.zeros(0), 0.0, self.units, anchored)


def setup(plant: Plant, spec: Spec, start: INC, *, kappa: float, horizon: int | None, order: int | None, anchored: bool,
          frozen: Sequence[str], terminal: ArrayLike | None, seed: int, states: Box | Polytope | None = None) -> Setup:
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
        None if order is None else whole("order", order, 1), anchored, seed, layout, *box_and_limits(spec.inputs),
        None if states is None else (states.H, states.h), K)
