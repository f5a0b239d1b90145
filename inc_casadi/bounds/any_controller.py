"""A lower bound on the cost of every controller whatever: least costs of cells of initial states, seen from trial inputs."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

from ..arrays import Array, number
from ..figures import at_least
from ..plant import as_plant
from ..sets.rules import whole
from ..spec import Spec
from .bound import Bound
from .cells import Cells
from .cells_bound import CellsBound, expected
from .clock import Clock
from .partition import partition
from .refinement import FIRST_HORIZON, Search, refined
from .value_iteration import discrete, settled_steps, unlimited, value_iteration

LAST_HORIZON = 80
HALVED, _CUT = 600, 1600  # cells, where they can be halved and where not


@dataclass(frozen=True, eq=False)
class AnyControllerBound(CellsBound):
    """The bound of `any_controller`; a cell without trial inputs or proving less counts with the cost without limits."""

    @property
    def priced(self) -> bool:
        """No: whoever knows the whole state foresees everything."""
        return False

    def _price(self, which: np.ndarray, exactly: bool = False) -> None:
        return None

    @property
    def statement(self) -> str:
        """One sentence for an engineer."""
        return (f"Every controller whatever that keeps the input limits (nonlinear, dynamic or predictive, with the "
                f"full state measured) costs at least {at_least(self.value)} on average over the initial states.")


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
    last = LAST_HORIZON if horizon is None else whole("horizon", horizon, 1)
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
    coarse = partition(spec.initial, (HALVED if budget is None else budget) // 4, Pi)
    if coarse.halving:
        return coarse, HALVED if budget is None else budget
    count = _CUT if budget is None else budget
    return partition(spec.initial, count), count
