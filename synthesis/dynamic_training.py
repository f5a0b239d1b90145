"""Train a controller with memory: the training of static laws, on the extended plant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inc_casadi.activations import Activation, ReLU
from inc_casadi.arrays import Array, number
from inc_casadi.brief import Brief
from inc_casadi.dynamic import DynamicINC, extended, extended_spec
from inc_casadi.estimate import Estimate, estimate
from inc_casadi.inc import INC
from inc_casadi.linear.lyapunov import discounted_sum
from inc_casadi.output_range import within_limits
from inc_casadi.plant import Plant, as_plant
from inc_casadi.sets import Box
from inc_casadi.sets.rules import whole
from inc_casadi.simulate import simulate
from inc_casadi.spec import Spec

from .closing import ordeal
from .input_box import box_and_limits
from .training import Training, train

_NODES, _MOST_NODES = 130, 800  # about so many points of quadrature over x_0; random ones where three per axis are more
_ROOM = 4.0  # xi may grow to this many times what the start visits before training clips it
_STEPS, _SEEN, _JUDGED = 50, 300, 5000
_RESTING, _BESIDE = 1e-6, 0.05  # of the root mean squares: a kink so near to rest is moved by so much at random
_FAR, _EXCESS = 1e12, 1e-9  # beyond what a state of the controller can come to; what a limit may be exceeded by for rounding


@dataclass(frozen=True, eq=False)
class DynamicTraining(Brief):
    """A trained controller with memory; nothing about it is proved but its well-posedness.

    dynamic: the controller, clipped to its box of inputs, or to the box around a polytope of them; start: what training
    began with, likewise; cost, start_cost: simulated costs of both on the same random initial states, whose `excess` is the
    largest H u - h met: for a polytope that it is not above 0 is evidence; training: of the extended law, with history and
    status.
    """

    dynamic: DynamicINC
    start: DynamicINC
    cost: Estimate
    start_cost: Estimate
    training: Training

    @property
    def improved(self) -> bool:
        """Whether the simulated cost fell."""
        return self.cost.mean < self.start_cost.mean


def train_dynamic(plant: Any, spec: Spec, start: DynamicINC, *, order: int | None = None, horizon: int | None = None,
                  terminal: ArrayLike | None = None, seed: int = 0, **options: Any) -> DynamicTraining:
    """Return the controller that one NLP makes of a start with memory: `train` on the extended plant.

    min E sum beta^k (x'Q x + u'R u) over all of the law (y, xi) -> (u, xi+), from (x_0, xi_0) with xi_0 as it is. u is
    clipped to its limits, as in `train`, a polytope to the box around it, its other half-spaces penalized and tightened;
    xi+ to a box of 4 times what the start visits, which keeps the search from running off and is no part of the controller
    returned. The initial distribution, of any kind, is flat, so its quadrature is that of x_0.

    Parameters
    ----------
    plant : discrete-time Plant or control.StateSpace
    spec : Spec of the plant
    start : such as `observer(...)`, perhaps `with_units`; a readout that has its limits built in may keep them
    order : quadrature points per axis of x_0; by default what about 130 nodes allow, random nodes in more than 6 dimensions
    horizon : steps; by default 30
    terminal : (n + l, n + l); by default the cost of the start's linearization at the origin, where that is stable, else
        the cost that `train` takes
    seed : of the random initial states that judge
    options : of `train`: kappa, anchored, frozen, method, hessian, max_iterations, time_limit, progress

    Raises
    ------
    InvalidInputError : as `train`
    DimensionError : as `extended`

    Notes
    -----
    The start is returned where the trained law costs no less on random initial states, or leaves the limits or no longer
    comes to rest where the start does neither. Of a start that leaves a polytope the trained law is taken if that keeps it,
    whatever it costs. Rollouts and quadrature see x_0 only through its own rule, so a flat distribution of (x_0, xi_0) is no
    special case.

    Examples
    --------
    >>> from inc_casadi.dynamic import observer
    >>> plant = Plant(A=[[1.0, 1.0], [0.0, 1.0]], B=[[0.5], [1.0]], C=[[1.0, 0.0]])
    >>> spec = Spec(Q=np.eye(2), R=0.1, discount=0.95, initial=Box([-1, -0.5], [1, 0.5]), inputs=Box(-0.5, 0.5))
    >>> begun = observer(plant, [[2.0], [1.0]], INC.saturated([[-0.5, -1.2]], 0.5))
    >>> train_dynamic(plant, spec, begun, order=5, horizon=15, max_iterations=5).improved
    True
    """
    plant = as_plant(plant)
    spec.check(plant)
    wide, law = extended(plant, start)
    memory = _memory(wide, start, spec, seed)
    problem = extended_spec(spec, start, memory)
    if order is None:
        order = max(3, int(round(_NODES ** (1 / spec.n)))) if 3**spec.n <= _MOST_NODES else None
    terminal = _terminal(wide, problem, law) if terminal is None else terminal
    found = train(wide, problem, law, order=order, horizon=30 if horizon is None else horizon, terminal=terminal, seed=seed,
                  **options)
    trained = DynamicINC(found.inner, start.xi_0)
    box = box_and_limits(spec.inputs)[0]
    if box is not None:
        trained, start = (_limited(one, box) for one in (trained, start))
    before, after = (simulated_dynamic(plant, spec, one, _JUDGED, seed) for one in (start, trained))
    if ordeal(after) >= ordeal(before):
        trained, after = start, before
    return DynamicTraining(trained, start, after, before, found)


def with_units(plant: Any, spec: Spec, dynamic: DynamicINC, hidden: int, activation: Activation | None = None,
               kappa: float = 0.95, seed: int = 0) -> DynamicINC:
    """Return the same controller with hidden units that read (y, xi) and that nothing reads yet, ready to be trained.

    ||W||_inf of the new units is kappa / 2, their rows of U are random directions over the root mean squares of (y, xi)
    along motions of the loop, and their kinks lie near random points of these.

    Parameters
    ----------
    plant, spec : for the motions
    dynamic : DynamicINC
    hidden : number of units; activation : of the units, ReLU when left out; kappa : in (0, 1)
    seed : of the random numbers

    >>> from inc_casadi.dynamic import observer
    >>> plant = Plant(A=[[1.0, 1.0], [0.0, 1.0]], B=[[0.5], [1.0]], C=[[1.0, 0.0]])
    >>> spec = Spec(Q=np.eye(2), R=0.1, discount=0.95, initial=Box([-1, -0.5], [1, 0.5]))
    >>> more = with_units(plant, spec, observer(plant, [[2.0], [1.0]], INC.linear([[-0.5, -1.2]])), 4)
    >>> more.q, more.step([0.5, 0.5], [1.0])[1].round(9).tolist()
    (4, [-0.85])
    """
    hidden, kappa = whole("hidden", hidden, 0), number("kappa", kappa, 0.0, 1.0, open_low=True, open_high=True)
    wide, law = extended(plant, dynamic)
    rng = np.random.default_rng(seed)
    seen = wide.C @ _motions(wide, dynamic, spec, seed)
    size = np.sqrt(np.mean(seen**2, axis=1))
    U = rng.standard_normal((hidden, law.p))
    U = U / np.linalg.norm(U, axis=1, keepdims=True) / np.where(size > 0, size, 1.0)
    W = rng.uniform(-1.0, 1.0, (hidden, hidden))
    W *= 0.5 * kappa / np.maximum(np.abs(W).sum(axis=1, keepdims=True), 1e-300)
    kinks = seen[:, rng.integers(seen.shape[1], size=hidden)]
    resting = np.all(np.abs(kinks) <= _RESTING * size[:, None], axis=0)  # proofs bear no kink where motions rest
    beside = _BESIDE * size[:, None] * rng.standard_normal(kinks.shape) * resting
    both = np.block([[law.W, np.zeros((law.q, hidden))], [np.zeros((hidden, law.q)), W]])
    units = (*law.activations, *((activation or ReLU()),) * hidden)
    return DynamicINC(INC(both, np.vstack([law.U, U]), np.hstack([law.V, np.zeros((law.m, hidden))]), law.K,
                          np.concatenate([law.b, -np.einsum("qp,pq->q", U, kinks + beside)]), law.d, units), dynamic.xi_0)


def _motions(wide: Plant, dynamic: DynamicINC, spec: Spec, seed: int) -> Array:
    """States (n + l, N) that the loop visits; those that run off are left out."""
    x = spec.initial.sample(_SEEN, np.random.default_rng(seed))
    start = np.vstack([x, np.repeat(dynamic.xi_0[:, None], x.shape[1], axis=1)])
    with np.errstate(over="ignore", invalid="ignore"):
        seen = simulate(wide, dynamic.law, start, steps=_STEPS).x.reshape(wide.n, -1)
    return seen[:, np.max(np.abs(seen), axis=0) < 1e3 * (1.0 + np.max(np.abs(start)))]


def simulated_dynamic(plant: Plant, spec: Spec, dynamic: DynamicINC, samples: int = 20_000, seed: int = 0) -> Estimate:
    """Return the simulated cost from random x_0 and xi_0, with the excess over the limits of u alone: xi may go anywhere.

    >>> delay = DynamicINC(INC.linear([[-1.0, -0.5], [1.0, 0.0]]), [0.0])
    >>> simulated_dynamic(Plant(1.5, 1.0), Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-3, 3)), delay, samples=100).settled
    True
    """
    anywhere = None if spec.inputs is None else Box(np.full(dynamic.order, -_FAR), np.full(dynamic.order, _FAR))
    wide, law = extended(plant, dynamic)
    return estimate(wide, law, extended_spec(spec, dynamic, anywhere), samples=samples, seed=seed)


def _memory(wide: Plant, dynamic: DynamicINC, spec: Spec, seed: int) -> Box:
    largest = np.max(np.abs(_motions(wide, dynamic, spec, seed)[-dynamic.order:]), axis=1)
    ends = _ROOM * np.where(largest > 0, largest, 1.0)
    return Box(-ends, ends)


def _terminal(wide: Plant, problem: Spec, law: INC) -> Array | None:
    """The discounted cost matrix of the loop linearized at the origin, or None where that is not stable."""
    gain = law.jacobian(np.zeros(law.p)) @ wide.C
    return discounted_sum(wide.A + wide.B @ gain, problem.Q + gain.T @ problem.R @ gain, problem.discount)


def _limited(dynamic: DynamicINC, limits: Box) -> DynamicINC:
    return dynamic if within_limits(dynamic.readout, limits) else dynamic.with_saturated_output(limits)
