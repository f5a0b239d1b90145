"""A lower bound on the cost of every controller that measures y = C x: what is not measured costs, limits or none."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from time import perf_counter

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..exact import is_positive_definite
from ..figures import at_least
from ..integers import over_common_denominator
from ..plant import Plant
from ..sets import Box
from ..spec import Spec
from .bound import Bound
from .exact_steps import second_moment, unproved_steps
from .information import unseen
from .moves import UNIT
from .unknown_part import Chord, best_chords, unknown_part
from .value_iteration import settled_steps, step, value_iteration, weighed

_SHARE = 1 - 1e-9  # of the weight that counts: room for the rounding of the gain


@dataclass(frozen=True, eq=False)
class UnmeasuredBound(Bound):
    """The bound of `unmeasured`, with the directions that prove it.

    Parameters
    ----------
    steps : of value iteration from zero
    chords : what the controller is not told, of a box of initial states; other distributions need none
    """

    steps: int
    chords: tuple[Chord, ...] = field(repr=False)

    @property
    def statement(self) -> str:
        """One sentence for an engineer."""
        return (f"Every controller whatever that measures y = C x, even one without input limits, costs at least "
                f"{at_least(self.value)} on average over the initial states ({self.steps} steps of value iteration, and "
                f"what the first measurements leave unknown).")

    def dual(self) -> tuple[float, float]:
        """Return tr(P S0) and the price of what is unknown, and the rounding allowance."""
        P, _ = value_iteration(self.plant, self.spec, self.steps)
        base, allowance = weighed(P[-1], self.spec.initial)
        more = float(self._unknown(P))
        return base + more, allowance + 4 * UNIT * (abs(base) + more)

    def exact_value(self) -> Fraction | str:
        """Return the value in Fractions, each step of value iteration settled exactly, or why there is none."""
        P, _ = value_iteration(self.plant, self.spec, self.steps)
        trouble = unproved_steps(self.plant, self.spec, P)
        S0 = second_moment(self.spec.initial)
        if trouble or isinstance(S0, str):
            return trouble or str(S0)
        return Fraction(np.sum(exact(P[-1]) * S0)) + self._unknown(P)

    def _unknown(self, P: Array) -> Fraction:
        # In Fractions: only what is proved of it, step by step.
        total, power, A = Fraction(0), exact(np.eye(self.plant.n)), exact(self.plant.A)
        for k in range(min(self.steps, len(unseen(self.plant)))):
            K, W = missed(self.plant, self.spec, P[self.steps - 1 - k])
            M = unknown_part(self.plant, self.spec.initial, k, self.chords)
            if M is not None and counts(self.plant, self.spec, P[self.steps - 1 - k], P[self.steps - k], K, W):
                G = exact(K) @ power
                total += Fraction(self.spec.discount) ** k * Fraction(np.sum(exact(W) * (G @ M @ G.T)))
            power = A @ power
        return total


def unmeasured(plant: Plant, spec: Spec, steps: int | None = None) -> UnmeasuredBound:
    """Return a lower bound on the expected cost of every controller that measures y = C x, whether limits are kept or not.

    With P_0 = 0, P_1, ... of value iteration and its gains K, completing the square in every step gives, for any inputs,

        sum_{k<N} beta^k (x_k'Q x_k + u_k'R u_k) = x_0'P_N x_0 + sum_{k<N} beta^k |u_k - K_k x_k|^2 in R + beta B'P B.

    u_k is a function of y_0, ..., y_k. The inputs being known, these tell C x_0, ..., C A^k x_0 and no more, and x_k differs
    from A^k x_0 by what is known. The mean of |u_k - K_k x_k|^2 is least at the conditional mean, so with W a little below
    R + beta B'P B

        E cost >= tr(P_N S0) + sum_k beta^k tr(W K_k A^k E Cov(x_0 | C x_0, ..., C A^k x_0) A^k' K_k').

    The conditional covariance is that of the best estimator, linear or not; `unknown_part` is below it. Without limits, and
    where that is exact, this is the least cost of all.

    Parameters
    ----------
    steps : N, None: as many as it takes to settle

    >>> from inc_casadi import Box
    >>> plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.0], [1.0]], C=[[1.0, 0.0]])
    >>> bound = unmeasured(plant, Spec(np.eye(2), 1.0, 0.9, Box([-1, -1], [1, 1])))
    >>> round(bound.value, 4), bound.holds(), bound.prove().succeeded
    (4.5788, True, True)
    """
    begun = perf_counter()
    count = settled_steps(plant, spec) if steps is None else steps
    P, _ = value_iteration(plant, spec, count)
    chords: tuple[Chord, ...] = ()
    if isinstance(spec.initial.support, Box):
        width = spec.initial.support.upper - spec.initial.support.lower
        for k in range(min(count, len(unseen(plant)))):
            K, W = missed(plant, spec, P[count - 1 - k])
            G = K @ np.linalg.matrix_power(plant.A, k)
            chords += best_chords(plant, width, k, G.T @ W @ G) if np.all(width > 0) else ()
    found = UnmeasuredBound(plant, spec, -np.inf, 0.0, count, chords)
    value, allowance = found.dual()
    return UnmeasuredBound(plant, spec, value - allowance, perf_counter() - begun, count, chords)


def missed(plant: Plant, spec: Spec, P: Array) -> tuple[Array, Array]:
    """Return K and W (m, m) of a step to the cost-to-go x'P x: u costs (u - K x)'W (u - K x) more than the best input.

    >>> from inc_casadi import Box
    >>> [each.round(6).tolist() for each in missed(Plant(2.0, 1.0), Spec(1.0, 1.0, 1.0, Box(-1, 1)), np.eye(1))]
    [[[-1.0]], [[2.0]]]
    """
    _, K = step(plant, spec, P)
    W = _SHARE * (spec.R + spec.discount * plant.B.T @ P @ plant.B)
    return K, (W + W.T) / 2


def counts(plant: Plant, spec: Spec, before: Array, after: Array, K: Array, W: Array) -> bool:
    """Return whether x'Qx + u'Ru + beta (Ax + Bu)'before(Ax + Bu) >= x'after x + (u - Kx)'W(u - Kx), W >= 0: in integers.

    >>> from inc_casadi import Box
    >>> plant, spec, one = Plant(2.0, 1.0), Spec(1.0, 1.0, 1.0, Box(-1, 1)), np.eye(1)
    >>> [counts(plant, spec, one, 2.999 * one, -one, weight * one) for weight in (1.999, 2.001)]
    [True, False]
    """
    n, m = plant.n, plant.m
    AB, scale = over_common_denominator(np.hstack([plant.A, plant.B]))
    row, of_row = over_common_denominator(np.hstack([-K, np.eye(m)]))
    known = np.zeros((n + m, n + m))
    known[:n, :n], known[n:, n:] = spec.Q, spec.R
    (Q_R, of_weights), (old, of_old), (new, of_new), (W_, of_W) = (
        over_common_denominator(each) for each in (known, before, after, W))
    above, below = spec.discount.as_integer_ratio()
    common = of_weights * of_old * of_new * of_W * scale**2 * of_row**2 * below
    whole = Q_R * (common // of_weights) + AB.T @ old @ AB * (above * (common // (of_old * scale**2 * below)))
    whole = whole - row.T @ W_ @ row * (common // (of_W * of_row**2))
    whole[:n, :n] -= new * (common // of_new)
    return is_positive_definite(whole) and is_positive_definite(W_)
