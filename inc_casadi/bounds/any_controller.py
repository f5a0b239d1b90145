"""A lower bound on the cost of every controller whatever: least costs of cells of initial states, seen from trial inputs."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from fractions import Fraction
from time import perf_counter
from typing import Any

import numpy as np

from ..arrays import Array, number
from ..blocks import exact
from ..figures import at_least
from ..plant import as_plant
from ..sets.rules import whole
from ..spec import Spec
from .bound import Bound
from .cell_bounds import Trials, cell_bounds
from .cells import Cells
from .clock import Clock
from .exact_cells import exact_bounds
from .exact_moments import is_semidefinite
from .exact_steps import unproved_steps
from .moves import UNIT
from .partition import partition
from .refinement import FIRST_HORIZON, Search, refined
from .shapes import Shapes
from .value_iteration import discrete, settled_steps, unlimited, value_iteration, weighed

_LAST_HORIZON = 80
_EXACT_BATCH = 500  # cells at a time
_HALVED, _CUT = 600, 1600  # cells, where they can be halved and where not


@dataclass(frozen=True, eq=False)
class AnyControllerBound(Bound):
    """The bound of `any_controller`, with the cells and the trial inputs that prove it.

    Parameters
    ----------
    steps : of value iteration from zero, the horizon T of the trial inputs included
    cells : partition of the initial distribution
    trials : one group for each horizon; a cell in none counts with the cost without limits
    """

    steps: int
    cells: Cells = field(repr=False)
    trials: tuple[Trials, ...] = field(repr=False)

    @property
    def statement(self) -> str:
        """One sentence for an engineer."""
        return (f"Every controller whatever that keeps the input limits (nonlinear, dynamic or predictive, with the "
                f"full state measured) costs at least {at_least(self.value)} on average over the initial states.")

    def dual(self) -> tuple[float, float]:
        """Return the value proved by the stored trial inputs, and the rounding allowance."""
        P, _ = value_iteration(self.plant, self.spec, self.steps)
        values = np.full(self.cells.probabilities.size, -np.inf)
        for group in self.trials:
            shapes = self.cells.shapes.take(group.members)
            values[group.members] = cell_bounds(self.plant, self.spec, P[self.steps - len(group.u)], shapes, group)
        return expected(self.spec, P[self.steps], self.cells, values)

    def holds(self) -> bool:
        """Return whether the stored numbers prove the value: NumPy only, no solver.

        The cells must be a partition of the initial distribution, and each group of trial inputs must be about some.
        """
        return self._fits() and super().holds()

    def _fits(self) -> bool:
        if not self.cells.divide(self.spec.initial):
            return False
        n, m, cells = self.plant.n, self.plant.m, self.cells.probabilities.size
        return all(group.fits(n, m, cells) and len(group.u) <= self.steps for group in self.trials)

    def exact_value(self) -> Fraction | str:
        """Return the value in exact rational arithmetic, or in words why there is none.

        Value iteration is settled step by step (`unproved_steps`), the cells are taken in Fractions from the stored
        parameters of the distribution, of a polytope from its stored triangulation, and `exact_bounds` does the rest.
        """
        if not self._fits():
            return "the cells are no partition of the initial distribution, or the trial inputs are not about them"
        cells = self.cells.exact()
        if isinstance(cells, str):
            return cells
        P, _ = value_iteration(self.plant, self.spec, self.steps)
        trouble = unproved_steps(self.plant, self.spec, P)
        if trouble:
            return trouble
        Pi = exact(P[self.steps])
        values = smooth(cells, Pi)
        for group in self.trials:
            tail = P[self.steps - len(group.u)]
            if not is_semidefinite(exact(tail)):
                return "the weight of the last state has a negative eigenvalue, if only by rounding"
            for part in group.parts(_EXACT_BATCH):
                which = part.members
                found = exact_bounds(self.plant, self.spec, tail, self.cells.shapes.take(which), cells.take(which), part)
                if isinstance(found, str):
                    return found
                values[which] = found
        total: Any = np.sum(cells.probabilities * values)
        return Fraction(total)


def any_controller(plant: Any, spec: Spec, cells: int | None = None, horizon: int | None = None,
                   tol: float = 1e-6, seconds: float | None = None) -> Bound:
    """Return a lower bound on the expected cost of every admissible controller: nonlinear, dynamic, with full state.

    No controller does better from x_0 than the best input sequence chosen for that x_0,
    V(x_0) = min over u_k in the limits of sum_{k<T} beta^k (x_k'Q x_k + u_k'R u_k) + beta^T x_T'P x_T,
    where P is value iteration from zero, a lower bound on what follows. The initial distribution is cut into cells of
    probability p_i, and

        E cost >= sum_i p_i b_i,   b_i <= E[V(x_0) | cell i],

    b_i from trial inputs that are affine in x_0 on the cell (`cell_bounds`): exact where the limits that the best sequence
    meets are the same all over the cell, and a bound whatever trial inputs were found. So cells are needed only where
    they differ, and there they are halved again and again, most where most is to be gained.

    Of a Gaussian or an ellipsoid only probabilities and means c_i of cells are used: V(x) - x'Pi x is convex, Pi being the
    same value iteration T steps on (what limits cost is a minimum of sums of squares), so by Jensen's inequality

        E cost >= tr(Pi S0) + sum_i p_i (V(c_i) - c_i'Pi c_i).

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time; its C is not used, the bound covers full information
    spec : Spec; without input limits the bound is tr(P S0) of value iteration, the discounted LQR cost
    cells : how many cells to bound at most, those that are halved later included; more of them raise the bound. None: 600,
        or 1600 where they are cut beforehand
    horizon : T, or None: 10, doubled up to 80 for the cells whose states have not yet come to where the limits are
        never met again
    tol : relative gain, as estimated, at which to stop halving
    seconds : after which nothing is halved any more: a bound all the same, `cut_short`

    Raises
    ------
    DimensionError, InvalidInputError : spec does not fit the plant, a continuous plant, cells or horizon < 1, a negative tol
        or number of seconds

    Notes
    -----
    Necessary for every controller, so a controller that costs no more is optimal. Source: dynamic programming and
    Lagrange duality with multipliers affine in the state; compare prop:no_arbitrary_sof, which no bound for a subclass can
    improve on.

    Examples
    --------
    >>> from inc_casadi import Box, Plant, Spec
    >>> scalar = Spec(Q=1.0, R=0.0, discount=1.0, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> bound = any_controller(Plant(1.5, 1.0), scalar, cells=300)
    >>> round(float(bound), 5), bound.holds()  # 1/3 + 1/36 is attained by u = -sat(1.5 x)
    (0.36111, True)
    """
    begun, clock = perf_counter(), Clock.of(seconds)
    plant = discrete(as_plant(plant))
    spec.check(plant)
    budget = None if cells is None else whole("cells", cells, 1)
    last = _LAST_HORIZON if horizon is None else whole("horizon", horizon, 1)
    tol = number("tol", tol, 0.0)
    if spec.inputs is None:
        return unlimited(plant, spec)
    steps = settled_steps(plant, spec) + last
    P, K = value_iteration(plant, spec, steps)
    search = Search(plant, spec, P, K, min(FIRST_HORIZON, last) if horizon is None else last, last, clock)
    found = refined(search, *_start(spec, budget, P[steps]), tol)
    value, allowance = expected(spec, P[steps], found.cells, found.values)
    return AnyControllerBound(plant, spec, value - allowance, perf_counter() - begun, steps, found.cells, found.trials,
                              cut_short=clock.is_over)


def _start(spec: Spec, budget: int | None, Pi: Array) -> tuple[Cells, int]:
    coarse = partition(spec.initial, (_HALVED if budget is None else budget) // 4, Pi)
    if coarse.halving:
        return coarse, _HALVED if budget is None else budget
    count = _CUT if budget is None else budget
    return partition(spec.initial, count), count


def expected(spec: Spec, Pi: Array, cells: Cells, values: Array) -> tuple[float, float]:
    """Return the bound from those of the cells (c,), and its rounding allowance; Pi (n, n) is a bound without limits.

    A cell without a bound, -inf, counts with Pi, and so does what is unknown of the covariance inside the cells.

    >>> from inc_casadi import Box, Uniform
    >>> expected(Spec(1.0, 0.0, 1.0, Box(-1, 1)), np.eye(1), partition(Uniform(Box(-1, 1)), 2), np.array([2.0, -np.inf]))[0]
    1.1666666666666667
    """
    shapes, c = cells.shapes, cells.centroids
    without = smooth(shapes, Pi)
    known = np.where(np.isneginf(values), without, values)
    sizes = np.abs(known) + smooth(replace(shapes, centers=np.abs(c), spans=np.abs(shapes.spans)), np.abs(Pi))
    allowance = float(np.sum((4 * UNIT * (len(Pi) + 32) + shapes.doubt) * shapes.probabilities * sizes))
    if cells.complete:
        return float(np.sum(shapes.probabilities * known)), allowance
    mean, more = weighed(Pi, spec.initial)
    return mean + float(np.sum(shapes.probabilities * (known - without))), allowance + more


def smooth(shapes: Shapes, Pi: Array) -> Array:
    """Return E[x'Pi x] given each cell, (c,), in floats or Fractions.

    >>> from inc_casadi import Box, Uniform
    >>> smooth(partition(Uniform(Box(-1, 1)), 1).shapes, np.eye(1)).round(6).tolist()
    [0.333333]
    """
    at = np.sum(shapes.centers * (Pi @ shapes.centers), axis=0)
    n, q, c = shapes.spans.shape
    spans = shapes.spans.reshape(n, -1)
    return np.asarray(at + np.sum(spans * (Pi @ spans), axis=0).reshape(q, c).sum(axis=0) / shapes.divisor)
