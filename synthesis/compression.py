"""Compression: from a large law to one with few hidden units, by imitation and then by training on the cost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from inc_casadi.activations import Activation, ReLU
from inc_casadi.arrays import Array
from inc_casadi.brief import Brief
from inc_casadi.errors import InvalidInputError
from inc_casadi.inc import INC
from inc_casadi.linear.regulator import discounted_lqr
from inc_casadi.output_range import within_limits
from inc_casadi.plant import Plant, as_plant
from inc_casadi.sets import Box
from inc_casadi.sets.rules import whole
from inc_casadi.spec import Spec

from .settling import SHARES, Rest, gives_way, local_gain, rest
from .starts.imitation import Imitation, Law, imitate, lessons
from .starts.random_start import linear_start, random_start
from .starts.resting import resting
from .starts.yardstick import Yardstick, yardstick
from .training import Training, train

NEARLY = 1e-9  # an input at the origin below this is rounding


@dataclass(frozen=True, eq=False)
class Compression(Brief):
    """A small law made from a large one. Nothing about it is proved but its well-posedness.

    inc: with the input limits built in, at rest at the origin exactly where it can be (`resting`); inner: without;
    teacher_units: of the teacher, None for one that is no INC; each cost is a mean over the same initial states
    (`yardstick`): teacher_cost, start_cost before any fit, fitted_cost after imitation, cost after training; fits: one per
    round; training: None when none was asked for; rest: whether motions come to rest; given_way: None where nothing had to
    be mended for that, else the share of the law that gave way to a gain, 0 where only its slope at the origin did, 1 where
    only the gain is left, NaN where nothing helps.
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
    rest: Rest
    given_way: float | None = None

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
                f"{100 * self.closed:.3g} % of the gap between saturated LQR and the best input sequences; {self._end}.")

    @property
    def _end(self) -> str:
        if self.given_way is None or np.isnan(self.given_way):
            return self.rest.sentence
        return (f"its slope at the origin and {100 * self.given_way:.3g} % of the rest had to give way to a linear gain, "
                f"and {self.rest.sentence}")


def compress(plant: Any, spec: Spec, teacher: Law, hidden: int = 8, *, activation: Activation | None = None,
             kappa: float = 0.95, start: INC | None = None, rounds: int = 2, points: int = 3000, iterations: int = 60,
             training_iterations: int = 60, time_limit: float | None = None, samples: int = 200,
             seed: int = 0) -> Compression:
    """Return a law with few hidden units that does what a teacher does, and then what costs less.

    Imitation on the teacher's motions, and from the second round on also on the student's own, where its errors lead
    (`lessons`, `imitate`); then `train` on the cost itself. Of the start and the rounds the one that costs least goes on.
    Of all of them and the trained law, those that bring simulated motions to rest come first, then the cost decides. Where
    none does, the best is mended: around the origin it gets the gain of the LQR, and if need be its units count less and
    less (`gives_way`) until motions come to rest. `rest` says what was seen in the end.

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
    _refuse_lost(teacher_cost)
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
        laws.append(inner)
    inner, inc, at_rest, given_way = _settled(ends, laws, inner, local_gain(plant, spec, teacher), seed)
    return Compression(inc, inner, teacher.q if isinstance(teacher, INC) else None, teacher_cost, costs[0], costs[best],
                       float(ends.costs(inc).mean()), tuple(fits), training, ends, at_rest, given_way)


def _settled(ends: Yardstick, laws: list[INC], last: INC, gain: Array, seed: int) -> tuple[INC, INC, Rest, float | None]:
    """The last law if it settles, else the cheapest that does, else the last one mended; with limits, and what was seen."""
    plant, spec = ends.plant, ends.spec

    def seen(inner: INC) -> tuple[INC, INC, Rest]:
        inc = _resting(_limited(inner, spec), spec)
        return inner, inc, rest(plant, spec, inc, seed)

    others = sorted((law for law in laws if law is not last), key=lambda law: _cost(ends, law))
    for law in (last, *others):
        tried = seen(law)
        if tried[2].holds:
            return *tried, None
    for share, law in zip(SHARES, gives_way(last, gain), strict=True):
        tried = seen(law)
        if tried[2].holds:
            return *tried, 1.0 - share
    return *seen(last), float("nan")


def _refuse_lost(teacher_cost: float) -> None:
    if not np.isfinite(teacher_cost):
        raise InvalidInputError("the teacher loses the state from some initial states: its cost is infinite")


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
