"""The discounted quadratic cost, for every initial state and in expectation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, number, symmetric
from ..errors import DimensionError
from ..figures import at_most
from ..inc import INC
from ..loop import ClosedLoop
from ..multipliers.base import Multiplier, Unknown, constant
from ..plant import Plant
from ..rest import rest_output
from ..sets import Distribution, as_distribution
from .base import DECREASE, POSITIVE, Claim, Graphs, descent, positive, storage

REST_TOLERANCE = 1e-11  # ten times the tolerance of the fixed point


@dataclass(frozen=True, eq=False)
class DiscountedCost(Claim):
    """The discounted cost of every motion is at most x_0'P x_0, in expectation tr(P S0). Sufficient, not necessary.

    Discrete time (thm:performance): if P > 0 and X'PX - discount F'PF - X'QX - G'RG - M > 0, then

        sum_k discount^k (x_k'Q x_k + u_k'R u_k) <= x_0'P x_0      for every x_0.

    Continuous time, with exp(-gamma) = discount: if P > 0 and gamma X'PX - He(X'PF) - X'QX - G'RG - M > 0, then

        integral_0^inf exp(-gamma t) (x'Q x + u'R u) dt <= x_0'P x_0      for every x_0.

    For V(x) = x'P x the inequality reads d/dt (exp(-gamma t) V) <= -exp(-gamma t) (x'Q x + u'R u) along every motion, and
    V >= 0 ends the integral. For a linear law the least P solves the Lyapunov equation of A + B K C - gamma I / 2, and the
    bound is the cost. gamma is taken a little below -log(discount), by 1e-15 of it: that only makes the cost larger.

    In expectation the cost is at most tr(P S0), S0 = E[x_0 x_0']. With discount < 1 it can be finite without stability:
    ask for `Stability` too when it matters.

    A biased controller: the inequality bounds the cost of deviations from an equilibrium
    (eq:incremental_cost_bound), which is the cost itself only if u = 0 at x = 0. That is checked: to rounding by
    `Certificate.holds`, exactly by `Certificate.prove`; otherwise the claim is refused with the reason.

    Q: (n, n) positive semidefinite, cost per squared state unit and step, in continuous time per second; R: (m, m)
    positive semidefinite, per squared input unit; discount: in (0, 1], the factor per step, in continuous time per second;
    initial: a distribution of x_0, or a set for the uniform one.

    Raises InvalidInputError and DimensionError for what does not fit.

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
        """Raise DimensionError when Q or R do not fit the plant."""
        if self.Q.shape[0] != plant.n or self.R.shape[0] != plant.m:
            raise DimensionError(f"Q is {self.Q.shape[0]} x {self.Q.shape[0]} and R {self.R.shape[0]} x "
                                 f"{self.R.shape[0]}, but the plant has {plant.n} states and {plant.m} inputs")

    def unknowns(self, graphs: Graphs) -> tuple[Unknown, ...]:
        """Return P, symmetric, and P_0 (n, n) where V depends on hidden vectors too."""
        n = graphs[DECREASE].n
        return (storage(graphs), *((Unknown("P_0", (n, n), "symmetric"),) if POSITIVE in graphs else ()))

    def graphs(self, loop: ClosedLoop, multiplier: Multiplier) -> dict[str, ClosedLoop]:
        """Return the stack of a step, and where V depends on hidden vectors that of V itself, once more for its bound."""
        found = super().graphs(loop, multiplier)
        return {**found, **({"initial": found[POSITIVE]} if POSITIVE in found else {})}

    def conditions(self, graphs: Graphs, values: Mapping[str, Any], M: Mapping[str, Any]) -> dict[str, Any]:
        """Return V > 0, the decrease, and V < x'P_0 x where V depends on hidden vectors."""
        P, step = values["P"], graphs[DECREASE]
        Q, R = constant(step, self.Q), constant(step, self.R)
        x = step.X[: step.n, :]
        stage = x.T @ Q @ x + step.G.T @ R @ step.G
        found = {**positive(graphs, P, M), "decrease": self._drop(step, P) - stage - M[DECREASE]}
        if POSITIVE in graphs:
            rows = graphs["initial"].X
            x = rows[: step.n, :]
            found["initial"] = x.T @ values["P_0"] @ x - rows.T @ P @ rows - M["initial"]
        return found

    def _drop(self, step: ClosedLoop, P: Any) -> Any:
        """Return what the discounted V loses: V - discount V+, or gamma V - dV/dt."""
        if step.plant.discrete:
            return descent(step, P, constant(step, self.discount))
        drop = descent(step, P)
        return drop if self.discount == 1.0 else drop + constant(step, decay(self.discount)) * (step.X.T @ P @ step.X)

    def objective(self, graphs: Graphs, values: Mapping[str, Any]) -> Any:
        """Return tr(P S0) as a 1 x 1 matrix."""
        return mean_form(self._bounding(values), self.initial.second_moment)

    def bound(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return tr(P S0), a bound on the expected cost, rounded up."""
        return rounded_up_trace(self._bounding(values), self.initial.second_moment)

    @staticmethod
    def _bounding(values: Mapping[str, Any]) -> Any:
        """Return the matrix whose quadratic form bounds V."""
        return values.get("P_0", values["P"])

    def merit(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return minus the bound: the lower the cost the stronger."""
        return -self.bound(loop, values)

    def sentence(self, loop: ClosedLoop, values: Mapping[str, Any]) -> str:
        """Return the promise with its number."""
        name = "P_0" if "P_0" in values else "P"
        return (f"From every initial state x0 the discounted cost is at most x0'{name} x0, and its expectation over the "
                f"initial distribution is at most {at_most(self.bound(loop, values))}.")

    def growth(self, discrete: bool) -> float:
        """Return 1 / sqrt(discount), or half the rate at which costs to come lose their weight."""
        return float(self.discount**-0.5) if discrete else decay(self.discount) / 2

    def obstacle(self, plant: Plant, inc: INC, *, exactly: bool = False) -> str | None:
        """Return a sentence when u = 0 at x = 0 is not established: the cost is then counted from x*, not from 0.

        Without discount the slightest offset costs infinitely much in the end, so no tolerance is allowed then either.
        """
        if inc.preserves_origin:
            return None
        counted = ("so the bound counts the cost from the equilibrium x*, not from the origin: ask for DeviationCost, or "
                   "take u at x = 0 off d")
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


def decay(discount: float) -> float:
    """Return a rate gamma with exp(-gamma) >= discount for certain, below -log(discount) by about 1e-15 of it.

    >>> decay(1.0), bool(abs(decay(0.5) - np.log(2)) < 1e-15)
    (0.0, True)
    """
    # Logarithms of the mathematical libraries in use err by about one unit of rounding, 2^-53 of the value; this is eight.
    return float(-np.log(discount)) * (1.0 - 2.0**-50) + 0.0


def mean_form(P: Any, S: Array) -> Any:
    """Return tr(P S) as a 1 x 1 matrix of the kind of P."""
    rows = np.eye(len(S))
    return sum(rows[i:i + 1] @ P @ S[:, i:i + 1] for i in range(len(S)))


def rounded_up_trace(P: Array, S: Array) -> float:
    """Return a float that is at least tr(P S), by less than 1e-12 of the sum of the magnitudes of its terms."""
    terms = P * S.T
    return float(terms.sum() + 4 * terms.size * np.finfo(float).eps * np.abs(terms).sum())
