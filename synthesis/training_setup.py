"""What a training works on: the scenarios of its phases, the layout of its variables, and the judge of its laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from inc_casadi.activations import stack
from inc_casadi.arrays import Array, symmetric
from inc_casadi.errors import InvalidInputError, SolverError
from inc_casadi.inc import INC
from inc_casadi.linear.regulator import discounted_lqr
from inc_casadi.plant import Plant
from inc_casadi.sets import Box, Distribution, Empirical, Polytope
from inc_casadi.sets.rules import whole
from inc_casadi.spec import Spec

from .ball import project_rows
from .objective import Layout
from .rollout import Parameters, Scenario, hidden, roll
from .starts.random_start import input_range, measurement_range

COARSE, FINE, JUDGE = 130, 400, 900  # most nodes of the first phase, the last phase, and the judge
LIFTED_COARSE, LIFTED_FINE = 25, 50  # the same for the lifted form, whose NLP grows with them
_HESSIAN_WORK, _HESSIAN_NODES = 5e8, 40  # multiplications that one Hessian may take; fewest nodes it is thinned to
_PENALTY = 100.0  # on inputs outside a polytope: this many times the cost scale, at once the polytope's size outside
_MOST_VERTICES = 64


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

    def scenario(self, budget: int, margin: Array | float = 0.0, steps: int | None = None, *,
                 corners: bool = False) -> Scenario:
        """Return the scenario on at most `budget` nodes, its half-spaces of the inputs tightened by a margin.

        corners: the vertices of the initial set are nodes too, without weight, for what must hold from there.
        """
        nodes, weights = nodes_of(self.spec.initial, budget, self.seed, self.order)
        if corners:
            nodes, weights = self._with_corners(nodes, weights)
        plain = self._scenario(nodes, weights, self.horizon if steps is None else steps, self.anchored)
        if self.limits is None or self.box is None:
            return plain
        H, h = self.limits
        reach = np.abs(H) @ (self.box.upper - self.box.lower) / 2
        return replace(plain, H=H, h=h - margin, penalty=_PENALTY * self.scale / float(np.mean(reach)) ** 2)

    def sketch(self, scenario: Scenario) -> Scenario | None:
        """Return the scenario of the Gauss-Newton Hessian, thinned to bound its work; None where that cannot be."""
        parameters = self.layout.fixed.size
        work = _HESSIAN_WORK / (scenario.steps * (self.plant.n + self.plant.m) * parameters**2)
        if work < _HESSIAN_NODES:
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
        seen = [(motion.u, self.limits), (motion.x[1:], self.states)]
        with np.errstate(over="ignore", invalid="ignore"):
            excess = [np.max(points @ pair[0].T - pair[1], axis=(0, 1)) for points, pair in seen if pair is not None]
        worst = np.concatenate(excess) if excess else np.zeros(0)
        return motion.cost, np.where(np.isnan(worst), np.inf, worst)

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
        order = None if self.order is None else 2 * self.order + 1
        budget = int(JUDGE * min(1.0, 12 / max(len(self.units), 1)))
        nodes, weights = nodes_of(self.spec.initial, budget, self.seed + 1, order)
        if self.rows:
            nodes, weights = self._with_corners(nodes, weights)
        return self._scenario(nodes, weights, max(100, 4 * self.horizon), False)

    def _with_corners(self, nodes: Array, weights: Array) -> tuple[Array, Array]:
        corners = _corners(self.spec.initial)
        return np.hstack([nodes, corners]), np.concatenate([weights, np.zeros(corners.shape[1])])

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
        None if order is None else whole("order", order, 1), anchored, seed, layout, *_box_and_limits(spec.inputs),
        None if states is None else (states.H, states.h), K)


def _box_and_limits(inputs: Box | Polytope | None) -> tuple[Box | None, tuple[Array, Array] | None]:
    if not isinstance(inputs, Polytope):
        return inputs, None
    axes = np.eye(inputs.dimension)
    box = Box(-np.asarray(inputs.support(-axes)), np.asarray(inputs.support(axes)))
    cutting = np.asarray(box.support(inputs.H.T)) > inputs.h + 1e-9 * (1.0 + np.abs(inputs.h))
    return box, (inputs.H[cutting], inputs.h[cutting]) if cutting.any() else None


def row_bound(units: stack.Units, kappa: float) -> float:
    """Return the bound on the row sums of |W|: kappa, or less where units are steeper than 1.

    >>> from inc_casadi import ReLU
    >>> row_bound((ReLU(),), 0.9)
    0.9
    """
    return kappa / max(1.0, float(np.max(stack.lipschitz(units), initial=0.0)))


def balanced(start: INC, bound: float) -> INC:
    """Return the same law with ||W||_inf <= bound, rescaling units that are linear on both half lines if need be.

    For v > 0 the hidden units eta / v have W' = diag(1/v) W diag(v), and ||W'||_inf <= c where |W| v <= c v. Units that
    cannot be rescaled keep v = 1; the others get the v that |W| v = c v - t asks of them, with the largest t that fits.

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
    v = _weights(np.abs(start.W), np.array([unit.homogeneous is not None for unit in start.activations]), 0.95 * bound)
    if v is None:
        raise InvalidInputError(f"start has ||W||_inf = {norm:.6g}, above the bound {bound:.6g} of the training, and "
                                "its units cannot be rescaled to meet it: raise kappa, project W first, or freeze W")
    return INC(start.W * v / v[:, None], start.U / v[:, None], start.V * v, start.K, start.b / v, start.d,
               start.activation)


def _weights(M: Array, free: np.ndarray, level: float) -> Array | None:
    """Return v > 0 with M v <= level v and v = 1 outside `free`, or None when this way finds none."""
    inner = M[np.ix_(free, free)]
    if inner.size and np.max(np.abs(np.linalg.eigvals(inner))) >= level:
        return None
    fed = np.column_stack([M[np.ix_(free, ~free)].sum(axis=1), np.ones(inner.shape[0])])
    least, more = np.linalg.solve(level * np.eye(inner.shape[0]) - inner, fed).T
    room = level - M[np.ix_(~free, ~free)].sum(axis=1) - M[np.ix_(~free, free)] @ least
    use = M[np.ix_(~free, free)] @ more
    t = float(np.min(room[use > 0] / use[use > 0], initial=1.0))
    if t <= 0.0 or np.any(room < 0.0):
        return None
    v = np.ones(M.shape[0])
    v[free] = least + t * more
    return v


def inscribed_box(polytope: Polytope) -> Box:
    """Return a large box inside a polytope: first as large as possible in the shape of its bounding box, then widened.

    >>> diamond = Polytope([[1, 1], [1, -1], [-1, 1], [-1, -1]], [1, 1, 1, 1])
    >>> inscribed_box(diamond).upper.round(6).tolist()
    [0.5, 0.5]
    """
    from scipy.optimize import linprog

    m = polytope.dimension
    axes = np.eye(m)
    shape = (np.asarray(polytope.support(axes)) + np.asarray(polytope.support(-axes))) / 2
    # Unknowns: center c (m,), half widths r (m,), common scale s; H c + |H| r <= h, r >= s shape.
    within = np.hstack([polytope.H, np.abs(polytope.H), np.zeros((polytope.h.size, 1))])
    wide = np.hstack([np.zeros((m, m)), -np.eye(m), shape[:, None]])
    reward = np.concatenate([np.zeros(m), 1e-3 / shape, [1.0]])
    found = linprog(-reward, np.vstack([within, wide]), np.concatenate([polytope.h, np.zeros(m)]),
                    bounds=[(None, None)] * m + [(0.0, None)] * (m + 1))
    if found.x is None:
        raise SolverError(f"no box was found inside the polytope of inputs: {found.message}")
    c, r = found.x[:m], found.x[m:2 * m] * (1.0 - 1e-9)
    return Box(c - r, c + r)


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
