"""Compression: from a large law to one with few hidden units, by imitation and then by training on the cost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from inc_casadi.activations import Activation, ReLU
from inc_casadi.errors import InvalidInputError
from inc_casadi.inc import INC
from inc_casadi.linear.regulator import discounted_lqr
from inc_casadi.output_range import within_limits
from inc_casadi.plant import Plant, as_plant
from inc_casadi.sets import Box
from inc_casadi.sets.rules import whole
from inc_casadi.spec import Spec

from .starts.imitation import Imitation, Law, imitate, lessons
from .starts.random_start import linear_start, random_start
from .starts.resting import resting
from .starts.yardstick import Yardstick, yardstick
from .training import Training, train

NEARLY = 1e-9  # an input at the origin below this is rounding


@dataclass(frozen=True, eq=False)
class Compression:
    """A small law made from a large one. Nothing about it is proved but its well-posedness.

    inc: with the input limits built in, at rest at the origin exactly where it can be (`resting`); inner: without;
    teacher_units: of the teacher, None for one that is no INC; each cost is a mean over the same initial states
    (`yardstick`): teacher_cost, start_cost before any fit, fitted_cost after imitation, cost after training; fits: one per
    round; training: None when none was asked for.
    """

    inc: INC
    inner: INC
    teacher_units: int | None
    teacher_cost: float
    start_cost: float
    fitted_cost: float
    cost: float
    fits: tuple[Imitation, ...]
    training: Training | None
    yardstick: Yardstick

    @property
    def closed(self) -> float:
        """The share of the gap between saturated LQR and optimum that the law closes."""
        return self.yardstick.closed(self.inc)

    @property
    def sentence(self) -> str:
        """What was made of what, in one sentence."""
        teacher = "A teacher" if self.teacher_units is None else f"A teacher of {self.teacher_units} units"
        return (f"{teacher} costs {self.teacher_cost:.6g}; {self.inner.q} units cost {self.start_cost:.6g} at the start, "
                f"{self.fitted_cost:.6g} after imitation and {self.cost:.6g} after training, which closes "
                f"{100 * self.closed:.3g} % of the gap between saturated LQR and the best input sequences.")


def compress(plant: Any, spec: Spec, teacher: Law, hidden: int = 8, *, activation: Activation | None = None,
             kappa: float = 0.95, start: INC | None = None, rounds: int = 2, points: int = 3000, iterations: int = 60,
             training_iterations: int = 60, time_limit: float | None = None, samples: int = 200,
             seed: int = 0) -> Compression:
    """Return a law with few hidden units that does what a teacher does, and then what costs less.

    Imitation on the teacher's motions, and from the second round on also on the student's own, where its errors lead
    (`lessons`, `imitate`); then `train` on the cost itself. Of the start and the rounds the one that costs least goes on.

    Parameters
    ----------
    plant, spec : discrete time; spec.inputs a Box
    teacher : an INC, or y (p, N) -> u (m, N), within the limits
    hidden : units of the student; activation: of them, ReLU when left out
    kappa : bound on ||W||_inf in (0, 1)
    start : the inner law to begin with, instead of hidden and activation; by default the LQR with random units where the
        state is measured, else `random_start`
    rounds, points, iterations : of imitation
    training_iterations : of `train`, 0 for none; time_limit: seconds for each fit and for training
    samples, seed : of the states that costs are measured from; seed also draws the student's units

    Raises
    ------
    InvalidInputError, DimensionError : as `imitate` and `train`; a teacher whose cost is infinite

    Notes
    -----
    The student can be better than a teacher that is not optimal: training knows the cost, not the teacher.

    >>> plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]])
    >>> spec = Spec(Q=np.eye(2), R=0.1, discount=0.95, initial=Box([-3, -1.5], [3, 1.5]), inputs=Box(-0.5, 0.5))
    >>> teacher = INC.from_mpc(plant, spec.Q, spec.R, 8, spec.inputs, discount=0.95)
    >>> small = compress(plant, spec, teacher, hidden=3, iterations=20, training_iterations=10)
    >>> small.inner.q, small.cost < small.start_cost, small.closed > 0.5
    (3, True, True)
    """
    plant = as_plant(plant)
    ends = yardstick(plant, spec, samples=samples, seed=seed + 1)
    teacher_cost = float(ends.costs(teacher).mean())
    if not np.isfinite(teacher_cost):
        raise InvalidInputError("the teacher loses the state from some initial states: its cost is infinite")
    inner = _student(plant, spec, hidden, activation, kappa, seed) if start is None else start
    laws, fits = [inner], list[Imitation]()
    taught = lessons(plant, spec, teacher, points=points, seed=seed)
    for turn in range(whole("rounds", rounds, 1)):
        fits.append(imitate(plant, spec, taught, laws[-1], kappa, iterations, time_limit))
        laws.append(fits[-1].inner)
        if turn + 1 < rounds and np.isfinite(_cost(ends, laws[-1])):
            taught = taught.joined(lessons(plant, spec, teacher, _limited(laws[-1], spec), points, seed + turn + 1))
    costs = [_cost(ends, law) for law in laws]
    best = int(np.argmin(costs))
    inner, training = laws[best], None
    if whole("training_iterations", training_iterations, 0):
        training = train(plant, spec, inner, kappa=kappa, max_iterations=training_iterations, time_limit=time_limit,
                         seed=seed)
        inner = training.inner
    inc = _resting(_limited(inner, spec), spec)
    return Compression(inc, inner, teacher.q if isinstance(teacher, INC) else None, teacher_cost, costs[0], costs[best],
                       float(ends.costs(inc).mean()), tuple(fits), training, ends)


def _student(plant: Plant, spec: Spec, hidden: int, activation: Activation | None, kappa: float, seed: int) -> INC:
    units = activation or ReLU()
    if plant.p != plant.n:
        return random_start(plant, spec, hidden, units, kappa, seed)
    K, _ = discounted_lqr(plant, spec)
    return linear_start(np.linalg.solve(plant.C.T, K.T).T, plant, spec, hidden, units, kappa, seed)


def _limited(inner: INC, spec: Spec) -> INC:
    assert isinstance(spec.inputs, Box)
    return inner.with_saturated_output(spec.inputs)


def _resting(inc: INC, spec: Spec) -> INC:
    """The law resting at the origin exactly where it does so nearly and its limits allow it; else the law as it is."""
    if float(np.max(np.abs(inc(np.zeros(inc.p))))) > NEARLY:
        return inc
    try:
        exact = resting(inc)
    except InvalidInputError:
        return inc
    return exact if spec.inputs is None or within_limits(exact, spec.inputs) else inc


def _cost(ends: Yardstick, inner: INC) -> float:
    return float(ends.costs(_limited(inner, ends.spec)).mean())
