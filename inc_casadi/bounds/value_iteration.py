"""Discounted Riccati value iteration from zero: a lower bound on the cost of every controller without input limits."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from time import perf_counter

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..errors import InvalidInputError
from ..figures import at_least
from ..plant import Plant
from ..sets import Distribution, Ellipsoid, Uniform
from ..spec import Spec
from .bound import Bound
from .exact_steps import second_moment, unproved_steps
from .moves import UNIT, balance

# With R + beta B'PB scaled to a unit diagonal, eigenvalues up to here are zero: inputs that repeat one another.
_NO_EFFECT = 1e-13


def step(plant: Plant, spec: Spec, P: Array) -> tuple[Array, Array]:
    """Return (P+, K): one step of value iteration from the cost-to-go x'P x, and its minimizing gain u = K x.

    P+ = Q + K'RK + beta (A + BK)'P(A + BK) with K = -(R + beta B'PB)^+ beta B'PA, lowered by a diagonal matrix that covers
    rounding, so that x'P+x <= min_u x'Qx + u'Ru + beta (Ax + Bu)'P(Ax + Bu) for every x.

    Notes
    -----
    An error e in K raises the formula by e'(R + beta B'PB)e, which is r'(R + beta B'PB)^-1 r for the residual r of the
    normal equations. That and the rounding of the sum, which is at most a multiple of the sum G of the absolute values, are
    counted in units of the state in which G has a diagonal near one: with a multiple of the identity, a state of small
    weight would lose all of it to the rounding of the large ones. Where R + beta B'PB is singular (R singular), the input
    directions in its kernel change neither the state's cost-to-go nor the cost, and get no gain.
    """
    A, B, Q, R, beta = plant.A, plant.B, spec.Q, spec.R, spec.discount
    S, N = R + beta * B.T @ P @ B, beta * B.T @ P @ A
    weights = np.sqrt(np.maximum(np.diag(S), 0.0))
    D = np.diag(np.divide(1.0, weights, out=np.zeros_like(weights), where=weights > 0))
    eigenvalues, V = np.linalg.eigh(D @ (S + S.T) @ D / 2)
    kept = eigenvalues > _NO_EFFECT
    V, eigenvalues = D @ V[:, kept], eigenvalues[kept]
    K = -V @ ((V.T @ N) / eigenvalues[:, None])
    closed = A + B @ K
    after = Q + K.T @ R @ K + beta * closed.T @ P @ closed
    return (after + after.T) / 2 - np.diag(_allowance(plant, spec, P, K, V, eigenvalues)), K


def _allowance(plant: Plant, spec: Spec, P: Array, K: Array, V: Array, eigenvalues: Array) -> Array:
    # The diagonal (n,) by which to lower: delta / d_i^2, d_i the units of the state.
    A, B, Q, R, beta = plant.A, plant.B, spec.Q, spec.R, spec.discount
    size, absV, absR, absP, moved = np.linalg.norm, np.abs(V.T), np.abs(R), np.abs(P), np.abs(K)
    unit = 4 * UNIT * (plant.n + plant.m + 4)
    reach = np.abs(A) + 2 * np.abs(B) @ moved
    G = np.abs(Q) + moved.T @ absR @ moved + beta * reach.T @ absP @ reach
    d = balance(G)
    delta = unit * size(G * np.outer(d, d))
    if eigenvalues.size:
        residual = V.T @ (R @ K + beta * B.T @ (P @ (A + B @ K)))
        off = size(residual * d) + unit * size((absV @ (absR @ moved + beta * np.abs(B.T) @ absP @ reach)) * d)
        delta += off**2 / eigenvalues[0]
    return np.asarray(delta / d**2)


def value_iteration(plant: Plant, spec: Spec, steps: int) -> tuple[Array, Array]:
    """Return P_0 = 0, ..., P_steps of value iteration, (steps + 1, n, n), and the gain (m, n) of the last step.

    By dynamic programming x'P_j x is at most the cost of the first j steps under any inputs whatever, hence at most the
    infinite-horizon cost: a certified lower bound on the cost-to-go, without assuming detectability.

    Parameters
    ----------
    steps : >= 1

    >>> from inc_casadi import Box, Plant, Spec
    >>> spec = Spec(Q=1.0, R=1.0, discount=1.0, initial=Box(-1, 1))
    >>> value_iteration(Plant(1.0, 1.0), spec, 50)[0][-1].round(6).tolist()  # the golden ratio
    [[1.618034]]
    """
    P, K = np.zeros((steps + 1, plant.n, plant.n)), np.zeros((plant.m, plant.n))
    for j in range(steps):
        P[j + 1], K = step(plant, spec, P[j])
    return P, K


def settled_steps(plant: Plant, spec: Spec, most: int = 1000, tol: float = 1e-13) -> int:
    """Return how many steps until value iteration changes by less than `tol` relative or is past all use; or `most`.

    >>> from inc_casadi import Box, Plant, Spec
    >>> 10 < settled_steps(Plant(1.0, 1.0), Spec(Q=1.0, R=1.0, discount=1.0, initial=Box(-1, 1))) < 30
    True
    """
    P = np.zeros((plant.n, plant.n))
    for count in range(1, most + 1):
        before = P
        P, _ = step(plant, spec, P)
        size = np.linalg.norm(P)
        if np.linalg.norm(P - before) <= tol * size or size > 1e12 * (1 + np.linalg.norm(spec.Q)):
            return count
    return most


@dataclass(frozen=True, eq=False)
class UnlimitedBound(Bound):
    """The bound tr(P S0) of `steps` steps of value iteration, on every controller, whatever inputs it uses."""

    steps: int

    @property
    def statement(self) -> str:
        """One sentence for an engineer."""
        return (f"Every controller whatever, even one without input limits, costs at least {at_least(self.value)} on "
                f"average over the initial states ({self.steps} steps of value iteration).")

    def dual(self) -> tuple[float, float]:
        """Return tr(P S0) and its rounding allowance."""
        return weighed(value_iteration(self.plant, self.spec, self.steps)[0][-1], self.spec.initial)

    def exact_value(self) -> Fraction | str:
        """Return tr(P S0) in Fractions, each step of value iteration settled exactly (`unproved_steps`), or why not."""
        P, _ = value_iteration(self.plant, self.spec, self.steps)
        trouble = unproved_steps(self.plant, self.spec, P)
        S0 = second_moment(self.spec.initial)
        if trouble or isinstance(S0, str):
            return trouble or str(S0)
        return Fraction(np.sum(exact(P[-1]) * S0))


def weighed(P: Array, initial: Distribution) -> tuple[float, float]:
    """Return tr(P S0) and a bound on its rounding, that of the second moment S0 included.

    >>> from inc_casadi import Box, Uniform
    >>> weighed(np.eye(2), Uniform(Box([-1, -1], [1, 1])))[0]
    0.6666666666666666
    """
    terms, units = P * initial.second_moment, P.size + moment_rounding(initial)
    return float(np.sum(terms)), 8 * UNIT * units * float(np.sum(np.abs(terms)))


def moment_rounding(initial: Distribution) -> float:
    """Return by how many units of rounding the covariance may be off, relative to itself: an ellipsoid's is an inverse.

    >>> from inc_casadi import Ellipsoid, Uniform
    >>> moment_rounding(Uniform(Ellipsoid([[1, 0], [0, 4]])))
    8.0
    """
    support = initial.support
    if isinstance(initial, Uniform) and isinstance(support, Ellipsoid):
        return support.dimension * float(np.linalg.cond(support.P))
    return 0.0


def unlimited(plant: Plant, spec: Spec, steps: int | None = None) -> UnlimitedBound:
    """Return the bound of value iteration on every controller; `steps` None means until it has settled.

    >>> from inc_casadi import Box, Plant, Spec
    >>> round(float(unlimited(Plant(1.0, 1.0), Spec(Q=1.0, R=1.0, discount=1.0, initial=Box(-1, 1)))), 6)
    0.539345
    """
    begun = perf_counter()
    count = settled_steps(plant, spec) if steps is None else steps
    value, allowance = weighed(value_iteration(plant, spec, count)[0][-1], spec.initial)
    return UnlimitedBound(plant, spec, value - allowance, perf_counter() - begun, count)


def discrete(plant: Plant) -> Plant:
    """Return the plant, refusing continuous time, for which these bounds are not stated.

    Raises
    ------
    InvalidInputError : dt = 0
    """
    if not plant.discrete:
        raise InvalidInputError("bounds of this kind count moves, but the plant is continuous (dt = 0): use "
                                "plant.sampled(dt), with Q and R of the sampled cost")
    return plant
