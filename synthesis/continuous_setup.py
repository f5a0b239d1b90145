"""What training in continuous time works on: its grid, its scenarios, and the judge of its laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from inc_casadi.arrays import Array, number
from inc_casadi.errors import InvalidInputError
from inc_casadi.inc import INC
from inc_casadi.linear.regulator import damped_plant, discounted_lqr
from inc_casadi.plant import Plant
from inc_casadi.sets.rules import whole
from inc_casadi.spec import Spec

from .collocation import Collocated, Points, radau
from .flow import true_cost
from .rollout import Parameters, Scenario
from .training_nodes import finer, nodes_of, with_corners
from .training_setup import Setup, setup

COARSE, FINE, WATCHED, JUDGE = 25, 50, 100, 225  # most nodes of the phases, of the choice of iterates, of the judge
MOST_DEGREE = 9
_CONTRACTED = 0.01  # by default the horizon ends when the loop of the LQR has contracted to this
_CORNERS = 0.02  # the weight of all vertices of the initial set together
_FEWEST, _MOST = 12, 40  # intervals by default; about one for each radian or time constant of the fastest mode


@dataclass(frozen=True, eq=False)
class ContinuousSetup:
    """One training problem in continuous time: see `train_continuous` for the options.

    plant, spec: in continuous time; base: the layout, the scale and the gain of the undiscounted problem with
    A - gamma I / 2, which has the same linear regulator; horizon: seconds; steps: intervals.
    """

    plant: Plant
    spec: Spec
    base: Setup
    horizon: float
    steps: int
    points: Points
    order: int | None
    seed: int

    def form(self, budget: int, steps: int) -> Collocated:
        """Return the collocated form on at most `budget` nodes and so many intervals."""
        scenario = self._scenario(*self._nodes(budget, self.seed, self.order), steps)
        return Collocated(scenario, self.base.layout, self.base.scale, self.horizon / steps, self.points)

    def watched(self, steps: int) -> Scenario:
        """Return the scenario that iterates are compared on, with more nodes than the phases have."""
        order = None if self.order is None else self.order + 1
        return self._scenario(*self._nodes(WATCHED, self.seed + 2, order), steps)

    def judge(self, law: Parameters) -> float:
        """Return the true cost of a law on nodes that no phase trains on, followed until it settles."""
        return true_cost(self._judge, law, self.horizon)

    @cached_property
    def _judge(self) -> Scenario:
        order = finer(self.spec.initial, self.order)
        scenario = self._scenario(*nodes_of(self.spec.initial, JUDGE, self.seed + 1, order), 1)
        return replace(scenario, anchored=False)

    def _nodes(self, budget: int, seed: int, order: int | None) -> tuple[Array, Array]:
        """Return nodes and weights with the vertices of the initial set, all together of a small weight, among them.

        Else a law may lose the states between the outermost nodes and the boundary, and nothing would tell.
        """
        nodes, weights = with_corners(self.spec.initial, *nodes_of(self.spec.initial, budget, seed, order))
        corners = weights == 0
        share = _CORNERS if corners.any() else 0.0
        return nodes, np.where(corners, share / max(int(corners.sum()), 1), (1.0 - share) * weights)

    def _scenario(self, nodes: Array, weights: Array, steps: int) -> Scenario:
        plant, spec, base = self.plant, self.spec, self.base
        free = np.full(plant.m, np.inf)
        lower, upper = (-free, free) if base.box is None else (base.box.lower, base.box.upper)
        return Scenario(plant.A, plant.B, plant.C, spec.Q, spec.R, spec.discount, base.terminal, nodes, weights, steps,
                        lower, upper, np.zeros((0, plant.m)), np.zeros(0), 0.0, base.units, base.anchored)


def continuous_setup(plant: Plant, spec: Spec, start: INC, *, kappa: float, horizon: float | None, steps: int | None,
                     degree: int, order: int | None, anchored: bool, frozen: Sequence[str], seed: int) -> ContinuousSetup:
    """Return the training problem of a start; the arguments are those of `train_continuous`."""
    damped, plain = undiscounted(plant, spec)
    base = setup(damped, plain, start, kappa=kappa, horizon=1, order=None, anchored=anchored, frozen=frozen, terminal=None,
                 seed=seed)
    if base.limits is not None:
        raise InvalidInputError("the inputs are a polytope that is no box, but training in continuous time keeps limits by "
                                "clipping to a box: give a Box inside it")
    modes = np.linalg.eigvals(damped.A + damped.B @ base.gain)
    if horizon is None:
        horizon = float(np.log(1 / _CONTRACTED) / -np.max(modes.real))
    horizon = number("horizon", horizon, 0.0, open_low=True)
    if steps is None:
        steps = int(np.clip(np.ceil(horizon * np.max(np.abs(modes))), _FEWEST, _MOST))
    degree = whole("degree", degree, 1)
    if degree > MOST_DEGREE:
        raise InvalidInputError(f"degree = {degree} is above {MOST_DEGREE}, the largest whose points are tabulated")
    return ContinuousSetup(plant, spec, base, horizon, whole("steps", steps, 1), radau(degree),
                           None if order is None else whole("order", order, 1), seed)


def undiscounted(plant: Plant, spec: Spec) -> tuple[Plant, Spec]:
    """Return the undiscounted problem with the same linear regulator: A - gamma I / 2, gamma = -log(discount).

    x(t) exp(-gamma t / 2) is its state and u(t) exp(-gamma t / 2) its input, so costs under linear feedback are the same.

    >>> from inc_casadi import Box
    >>> spec = Spec(Q=1.0, R=1.0, discount=np.exp(-0.5), initial=Box(-1, 1))
    >>> undiscounted(Plant(1.0, 1.0, dt=0), spec)[0].A.round(6).tolist()
    [[0.75]]
    """
    return damped_plant(plant, spec), replace(spec, discount=1.0)


def continuous_lqr(plant: Plant, spec: Spec) -> tuple[Array, Array]:
    """Return the gain K (m, n), u = K x, and the cost matrix P (n, n) of the discounted regulator in continuous time.

    gamma P = Q + A'P + PA - PB R^-1 B'P and K = -R^-1 B'P; the expected integral is tr(P S0). Raises what `discounted_lqr`
    raises.

    >>> from inc_casadi import Box
    >>> K, P = continuous_lqr(Plant(1.0, 1.0, dt=0), Spec(Q=3.0, R=1.0, discount=1.0, initial=Box(-1, 1)))
    >>> K.round(9).tolist(), P.round(9).tolist()
    ([[-3.0]], [[3.0]])
    """
    spec.check(plant)
    if plant.discrete:
        raise InvalidInputError(f"the plant has dt = {plant.dt:g}, but must be in continuous time (dt = 0)")
    return discounted_lqr(plant, spec)
