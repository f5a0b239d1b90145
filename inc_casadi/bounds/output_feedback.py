"""A lower bound on the cost of every controller that measures y = C x and keeps the limits, whatever else it is."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any

import numpy as np

from ..arrays import Array, number
from ..figures import at_least
from ..plant import Plant, as_plant
from ..sets import Box, Uniform
from ..sets.rules import whole
from ..spec import Spec
from .any_controller import HALVED, LAST_HORIZON, any_controller
from .bound import Bound
from .cells_bound import CellsBound, expected
from .clock import Clock
from .grid_price import GridPrice
from .halved_cells import Boxes
from .information import unseen
from .price import Price
from .price_search import best_price
from .refinement import FIRST_HORIZON, Search, refined
from .unmeasured import unmeasured
from .value_iteration import discrete, settled_steps, value_iteration

_PARTS = 8  # cells for each part of the grid of prices


@dataclass(frozen=True, eq=False)
class OutputFeedbackBound(CellsBound):
    """The bound of `any_output_feedback` with limits, with the cells, the trial inputs and the prices that prove it.

    Parameters
    ----------
    price : what it costs to foresee; every cell must have trial inputs, as the price cancels out only over all of them
    """

    price: GridPrice = field(repr=False)

    @property
    def statement(self) -> str:
        """One sentence for an engineer."""
        return (f"Every controller whatever that keeps the input limits and measures y = C x (nonlinear, dynamic or "
                f"predictive, started from a fixed state) costs at least {at_least(self.value)} on average over the initial "
                f"states.")

    @property
    def priced(self) -> bool:
        """Yes."""
        return True

    def _price(self, which: np.ndarray, exactly: bool = False) -> Price:
        assert isinstance(self.cells, Boxes)
        boxes = self.cells.leaves[which]
        return self.price.exactly(self.cells, boxes) if exactly else self.price.on(self.cells, boxes)

    def _fits(self) -> bool:
        box, cells = self.spec.initial.support, self.cells
        if not (isinstance(box, Box) and isinstance(cells, Boxes) and super()._fits() and self.price.fits(self.plant, box)):
            return False
        covered = np.zeros(cells.probabilities.size, dtype=bool)
        for group in self.trials:
            covered[group.members] = True
        long = all(len(group.u) >= len(self.price.offsets) for group in self.trials)
        return long and bool(np.all(covered)) and self.price.divides(cells)


def any_output_feedback(plant: Any, spec: Spec, cells: int | None = None, horizon: int | None = None, tol: float = 1e-6,
                        seconds: float | None = None) -> Bound:
    """Return a lower bound on the expected cost of every admissible controller that measures y = C x.

    A causal controller chooses u_k from y_0, ..., y_k alone, and what these do not tell of x_0 it cannot know: the bound
    counts that, where `any_controller` lets everything be foreseen. It is the largest of three:

    * without regard to the limits, `unmeasured`: completed squares and conditional covariances;
    * without regard to what is not measured, `any_controller`;
    * both at once, where x_0 is uniform on a box and y_0 does not depend on some of its coordinates: any prices pi_k(x_0)
      with E[pi_k(x_0) | y_0, ..., y_k] = 0 leave the cost of such a controller as it is (`GridPrice`), so

          E cost >= E min over u_k in the limits of cost(x_0, u) + sum_k pi_k(x_0)'u_k,

      the bound of `any_controller` with prices on the inputs. With the best prices, and where after the first moves
      everything is known, nothing is lost but what cells and grid are too coarse for.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time; where y = C x tells the state this is `any_controller`
    spec : Spec; without input limits the bound is that of `unmeasured`
    cells, horizon, tol, seconds : as for `any_controller`

    Raises
    ------
    DimensionError, InvalidInputError : as `any_controller`

    Notes
    -----
    Necessary for every controller whose own state starts from one fixed value, randomized ones included (for each outcome
    of the draw). Not for one whose state is started from the plant's: that is a measurement. Source: Brown, Smith and Sun,
    Operations Research 58, 2010, for the prices.

    Examples
    --------
    >>> from inc_casadi import Box, Plant, Spec
    >>> plant = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]], C=[[1.0, 0.0]])
    >>> spec = Spec([[1, 0], [0, 1]], 0.05, 0.98, initial=Box([-0.8, -0.8], [0.8, 0.8]), inputs=Box(-1, 1))
    >>> bound = any_output_feedback(plant, spec)
    >>> round(float(any_controller(plant, spec)), 2), round(float(bound), 2), bound.holds()
    (1.36, 3.48, True)
    """
    begun, clock = perf_counter(), Clock.of(seconds)
    plant = discrete(as_plant(plant))
    spec.check(plant)
    budget = HALVED if cells is None else whole("cells", cells, 1)
    last = LAST_HORIZON if horizon is None else whole("horizon", horizon, 1)
    tol = number("tol", tol, 0.0)
    if not unseen(plant):
        return any_controller(plant, spec, cells, horizon, tol, seconds)
    found: list[Bound] = [unmeasured(plant, spec)]
    if spec.inputs is not None:
        share = None if seconds is None else seconds / 3
        found.append(any_controller(plant, spec, cells, horizon, tol, share))
        if isinstance(spec.initial, Uniform) and isinstance(spec.initial.support, Box):
            first = min(FIRST_HORIZON, last) if horizon is None else last
            found += _priced(plant, spec, budget, (first, last), tol, clock)
    best = max(found, key=float)
    return replace(best, seconds=perf_counter() - begun, cut_short=clock.is_over)


def _priced(plant: Plant, spec: Spec, budget: int, horizons: tuple[int, int], tol: float,
            clock: Clock) -> list[Bound]:
    # With one price for all states, and with one for each part of a grid, which costs cells.
    steps = settled_steps(plant, spec) + horizons[1]
    P, K = value_iteration(plant, spec, steps)
    bounds: list[Bound] = []
    for parts in dict.fromkeys((1, max(1, budget // _PARTS))):
        begun = perf_counter()
        found = best_price(plant, spec, P[steps - horizons[0]], horizons[0], parts, clock)
        if found is None or (bounds and clock.is_over):
            break
        search = Search(plant, spec, P, K, *horizons, clock, found[0])
        bounds += _refined(search, *found, budget, tol, begun)
    return bounds


def _refined(search: Search, price: GridPrice, grid: Boxes, budget: int, tol: float, begun: float) -> list[Bound]:
    start = grid
    while 2 * start.leaves.size <= budget // 4:
        start = _finer(start, search.P[-1])
    found = refined(search, start, budget, tol)
    value, allowance = expected(search.spec, search.P[-1], found.cells, found.values, priced=True)
    if not np.isfinite(value):
        return []
    return [OutputFeedbackBound(search.plant, search.spec, value - allowance, perf_counter() - begun,
                                len(search.P) - 1, found.cells, found.trials, price)]


def _finer(cells: Boxes, weight: Array) -> Boxes:
    ways = cells.shapes.ways
    return cells.halved(cells.leaves, np.argmax(np.einsum("iwc,ij,jwc->wc", ways, weight, ways, optimize=True), axis=0))
