"""The discounted cost of deviations from the equilibrium of a biased loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..arrays import Array
from ..errors import NoEquilibriumError
from ..exact_rest import rest_point
from ..figures import at_most
from ..inc import INC
from ..loop import ClosedLoop, equilibrium
from ..multipliers.base import Multiplier, Unknown
from ..plant import Plant
from ..sets import Distribution, Gaussian
from .base import DECREASE, Claim, Graphs
from .performance import DiscountedCost


@dataclass(frozen=True, eq=False)
class DeviationCost(Claim):
    """What the deviations from an equilibrium x*, u* cost, wherever it is (thm:incremental_certificate). Sufficient.

    Under the inequality of `DiscountedCost`, with slope ranges for sectors where biases move the equilibrium,

        sum_k discount^k ((x_k - x*)'Q (x_k - x*) + (u_k - u*)'R (u_k - u*)) <= (x_0 - x*)'P (x_0 - x*)

    (eq:incremental_cost_bound), in expectation tr(P Sigma_0) + (mu_0 - x*)'P (mu_0 - x*). x* is found: exactly where all
    units are piecewise affine and the loop is small, else by Newton's method to a residual of about 1e-10, and the
    expectation is as accurate as that. With discount < 1 there may be several equilibria: the statement holds for each,
    the figure is for the one found.

    Q (n, n), R (m, m), discount, initial: as in `DiscountedCost`. Raises what that raises.

    >>> from inc_casadi import Gaussian, Plant
    >>> inc = INC([[0.0]], [[-0.2]], [[1.0]], [[0.0]], b=[1.0])
    >>> claim = DeviationCost([[1.0]], [[0.0]], 1.0, Gaussian([0.0], [[1.0]]))
    >>> claim.at_rest(Plant([[0.5]], [[1.0]]), inc).round(6).tolist()
    [1.428571]
    """

    Q: Array
    R: Array
    discount: float
    initial: Distribution

    def __post_init__(self) -> None:
        cost = DiscountedCost(self.Q, self.R, self.discount, self.initial)
        for name in ("Q", "R", "discount", "initial"):
            object.__setattr__(self, name, getattr(cost, name))

    def check(self, plant: Plant, inc: INC) -> None:
        """Raise what `DiscountedCost` raises for a plant that does not fit."""
        DiscountedCost(self.Q, self.R, self.discount, self.initial).check(plant, inc)

    def at_rest(self, plant: Plant, inc: INC) -> Array:
        """Return x* (n,).

        Raises NoEquilibriumError when none is found.
        """
        exactly = rest_point(plant, inc)
        return equilibrium(plant, inc).x if exactly is None else exactly.x.astype(float)

    def graphs(self, loop: ClosedLoop, multiplier: Multiplier) -> dict[str, ClosedLoop]:
        """Return those of `DiscountedCost`."""
        return self._cost.graphs(loop, multiplier)

    def unknowns(self, graphs: Graphs) -> tuple[Unknown, ...]:
        """Return those of `DiscountedCost`."""
        return self._cost.unknowns(graphs)

    def conditions(self, graphs: Graphs, values: Mapping[str, Any], M: Mapping[str, Any]) -> dict[str, Any]:
        """Return those of `DiscountedCost`, read in deviations."""
        return self._cost.conditions(graphs, values, M)

    def objective(self, graphs: Graphs, values: Mapping[str, Any]) -> Any:
        """Return the expected bound as a 1 x 1 matrix."""
        return self._moved(graphs[DECREASE]).objective(graphs, values)

    def bound(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return the bound on the expected cost of deviations, rounded up."""
        return self._moved(loop).bound(loop, values)

    def merit(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return minus the bound: the lower the cost the stronger."""
        return -self.bound(loop, values)

    def sentence(self, loop: ClosedLoop, values: Mapping[str, Any]) -> str:
        """Return the promise with its number and the equilibrium."""
        x = ", ".join(f"{entry:.6g}" for entry in self.at_rest(loop.plant, loop.inc))
        name = "P_0" if "P_0" in values else "P"
        return (f"From every initial state x0 the discounted cost of the deviations from the equilibrium x* = ({x}) is at "
                f"most (x0 - x*)'{name} (x0 - x*), and its expectation over the initial distribution is at most "
                f"{at_most(self.bound(loop, values))}.")

    def growth(self, discrete: bool) -> float:
        """Return that of `DiscountedCost`."""
        return self._cost.growth(discrete)

    def obstacle(self, plant: Plant, inc: INC, *, exactly: bool = False) -> str | None:
        """Return a sentence when no equilibrium is found."""
        try:
            self.at_rest(plant, inc)
        except NoEquilibriumError as error:
            return str(error)
        return None

    @property
    def _cost(self) -> DiscountedCost:
        return DiscountedCost(self.Q, self.R, self.discount, self.initial)

    def _moved(self, loop: ClosedLoop) -> DiscountedCost:
        """Return the cost with the distribution of x_0 - x*."""
        about = Gaussian(self.initial.mean - self.at_rest(loop.plant, loop.inc), self.initial.covariance)
        return DiscountedCost(self.Q, self.R, self.discount, about)
