"""The discounted quadratic cost, for every initial state and in expectation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, number, symmetric
from ..errors import DimensionError, InvalidInputError
from ..figures import at_most
from ..inc import INC
from ..loop import ClosedLoop
from ..multipliers.base import Unknown, constant
from ..plant import Plant
from ..rest import rest_output
from ..sets import Distribution, as_distribution
from .base import Claim

REST_TOLERANCE = 1e-11  # ten times the tolerance of the fixed point


@dataclass(frozen=True, eq=False)
class DiscountedCost(Claim):
    """The discounted cost of every motion is at most x_0'P x_0, in expectation tr(P S0). Sufficient, not necessary.

    If P > 0 and X'PX - discount F'PF - X'QX - G'RG - M > 0 (thm:performance, discrete time), then

        sum_k discount^k (x_k'Q x_k + u_k'R u_k) <= x_0'P x_0      for every x_0,

    and its expectation is at most tr(P S0), S0 = E[x_0 x_0']. With discount < 1 the cost can be finite without
    stability: ask for `Stability` too when it matters.

    A biased controller: the inequality bounds the cost of deviations from an equilibrium
    (eq:incremental_cost_bound), which is the cost itself only if u = 0 at x = 0. That is checked: to rounding by
    `Certificate.holds`, exactly by `Certificate.prove`; otherwise the claim is refused with the reason.

    Q: (n, n) positive semidefinite, cost per squared state unit and step; R: (m, m) positive semidefinite, per squared
    input unit; discount: in (0, 1]; initial: a distribution of x_0, or a set for the uniform one.

    Raises InvalidInputError and DimensionError for what does not fit, or for a plant in continuous time.

    >>> from inc_casadi import Box
    >>> DiscountedCost([[1.0]], [[0.05]], 0.98, Box([-1.0], [1.0])).initial.second_moment.round(6).tolist()
    [[0.333333]]
    """

    Q: Array
    R: Array
    discount: float
    initial: Distribution

    def __post_init__(self) -> None:
        Q = symmetric("Q", self.Q, definite="semi")
        initial = as_distribution(self.initial)
        if initial.dimension != Q.shape[0]:
            raise DimensionError(f"Q is {Q.shape[0]} x {Q.shape[0]}, but initial is a distribution in "
                                 f"R^{initial.dimension}")
        values = {"Q": Q, "R": symmetric("R", self.R, definite="semi"), "initial": initial,
                  "discount": number("discount", self.discount, 0.0, 1.0, open_low=True)}
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def check(self, plant: Plant, inc: INC) -> None:
        """Raise InvalidInputError in continuous time, DimensionError when Q or R do not fit the plant."""
        if not plant.discrete:
            raise InvalidInputError("thm:performance sums the cost over steps, so DiscountedCost needs a discrete "
                                    "plant: sample it first, plant.sampled(dt)")
        if self.Q.shape[0] != plant.n or self.R.shape[0] != plant.m:
            raise DimensionError(f"Q is {self.Q.shape[0]} x {self.Q.shape[0]} and R {self.R.shape[0]} x "
                                 f"{self.R.shape[0]}, but the plant has {plant.n} states and {plant.m} inputs")

    def unknowns(self, loop: ClosedLoop) -> tuple[Unknown, ...]:
        """Return P, symmetric (n, n)."""
        return (Unknown("P", (loop.n, loop.n), "symmetric"),)

    def conditions(self, loop: ClosedLoop, values: Mapping[str, Any], M: Any) -> dict[str, Any]:
        """Return P (n, n) and the decrease (n+q, n+q)."""
        P, F, G, X = values["P"], loop.F, loop.G, loop.X
        Q, R, discount = constant(loop, self.Q), constant(loop, self.R), constant(loop, self.discount)
        stage = X.T @ Q @ X + G.T @ R @ G
        return {"P": P, "decrease": X.T @ P @ X - discount * (F.T @ P @ F) - stage - M}

    def objective(self, loop: ClosedLoop, values: Mapping[str, Any]) -> Any:
        """Return tr(P S0) as a 1 x 1 matrix."""
        P, S0, rows = values["P"], self.initial.second_moment, np.eye(loop.n)
        return sum(rows[i:i + 1] @ P @ S0[:, i:i + 1] for i in range(loop.n))

    def bound(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return tr(P S0), a bound on the expected cost."""
        return float(self.objective(loop, values).item())

    def merit(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return minus the bound: the lower the cost the stronger."""
        return -self.bound(loop, values)

    def sentence(self, loop: ClosedLoop, values: Mapping[str, Any]) -> str:
        """Return the promise with its number."""
        return (f"From every initial state x0 the discounted cost is at most x0'P x0, and its expectation over the "
                f"initial distribution is at most {at_most(self.bound(loop, values))}.")

    def obstacle(self, plant: Plant, inc: INC, *, exactly: bool = False) -> str | None:
        """Return a sentence when u = 0 at x = 0 is not established: the cost is then counted from x*, not from 0.

        Without discount the slightest offset costs infinitely much in the end, so no tolerance is allowed then either.
        """
        if inc.preserves_origin:
            return None
        counted = "so the bound counts the cost from the equilibrium x*, not from the origin"
        if exactly or self.discount == 1.0:
            rest = rest_output(inc)
            if rest is None:
                return ("u = 0 at x = 0 is not verified in rational arithmetic (a unit is not piecewise affine), "
                        f"{counted}")
            worst = max(abs(entry) for entry in rest)
            return None if worst == 0 else f"the controller answers |u| = {float(worst):.3g} at x = 0, {counted}"
        eta = inc.hidden(np.zeros(inc.p))
        offset = np.abs(inc.V @ eta + inc.d)
        if np.all(offset <= REST_TOLERANCE * (np.abs(inc.V) @ np.maximum(1.0, np.abs(eta)) + np.abs(inc.d))):
            return None
        return f"the controller answers |u| = {offset.max():.3g} at x = 0, {counted}"
