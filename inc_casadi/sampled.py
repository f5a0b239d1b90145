"""A continuous-time problem seen under a zero-order hold: the sampled plant, and what its exact cost asks of the samples."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from .arrays import Array, number
from .brief import Brief
from .errors import InvalidInputError
from .plant import Plant, as_plant
from .spec import Spec

_EXACT = 1e-9  # what the cross term may leave, relative to the sampled cost's matrix
_HALVINGS = 40


@dataclass(frozen=True, eq=False)
class SampledProblem(Brief):
    """The discrete problem of a continuous one under a zero-order hold of a period h.

    The integral of exp(-gamma t) (x'Q x + u'R u) over all time is sum_k b^k [x_k; u_k]'M [x_k; u_k], b = exp(-gamma h),
    for every sequence u_k (Van Loan). M has a cross term, of which a `Spec` knows nothing. For any symmetric S

        x'S x - b x+'S x+ = [x; u]' ([S, 0; 0, 0] - b [A, B]'S [A, B]) [x; u],      x+ = A x + B u,

    telescopes to x_0'S x_0 along every motion with b^k x_k'S x_k -> 0. So S may be chosen such that M less this matrix
    is block diagonal, diag(Q, R) of `spec`, and then

        E integral = E sum_k b^k (x_k'Q x_k + u_k'R u_k) + tr(S S0):      `offset` = tr(S S0) depends on no controller.

    Where there is such an S and it leaves Q and R positive semidefinite (one input, and a period that is not long, as a
    rule), this is an identity, `exact`. Else S takes the cross term by least squares, what is left of it is dropped and
    negative eigenvalues of Q and R are raised to zero; `error` measures what that does on the loop of the discrete LQR.
    S is the one nearest to that of the trapezoidal rule, -Q h / 2, so for short periods Q is near Q h and R near R h.

    Attributes
    ----------
    plant : the sampled Plant, exact at the sampling instants
    spec : Spec with Q and R per step, discount b per step, the same initial distribution and the same limits, which a
        held input keeps between samples too
    M : (n + m, n + m), the exact cost of one step
    S : (n, n)
    exact : whether the identity holds, up to rounding
    """

    plant: Plant
    spec: Spec
    M: Array
    S: Array
    exact: bool

    @property
    def offset(self) -> float:
        """What is to be added to a cost of the discrete problem to have that of the continuous one."""
        return float(np.sum(self.S * self.spec.initial.second_moment))

    def cost(self, K: Any) -> float:
        """Return the exact continuous cost of the held linear law u_k = K x_k, infinite where it does not converge."""
        from .linear.lyapunov import discounted_sum

        K = np.asarray(K, dtype=float)
        rows = np.vstack([np.eye(self.plant.n), K])
        P = discounted_sum(self.plant.A + self.plant.B @ K, rows.T @ self.M @ rows, self.spec.discount)
        return np.inf if P is None else float(np.sum(P * self.spec.initial.second_moment))

    @cached_property
    def error(self) -> float:
        """Relative error of the discrete cost with its offset against the exact integral, for the discrete LQR."""
        from .linear.regulator import discounted_lqr

        K, P = discounted_lqr(self.plant, self.spec)
        exact = self.cost(K)
        return abs(float(np.sum(P * self.spec.initial.second_moment)) + self.offset - exact) / max(exact, 1e-300)


def sampled_problem(plant: Any, spec: Spec, period: float) -> tuple[Plant, Spec]:
    """Return the sampled plant and the spec per step of a continuous problem: `sample(...).plant` and `.spec`.

    Costs of the two problems differ by `sample(...).offset`, whatever the controller: see `SampledProblem`.

    Parameters
    ----------
    plant : continuous-time Plant or control.StateSpace
    spec : Spec whose Q and R are per second, and whose discount is the factor per second, exp(-gamma)
    period : in seconds, > 0

    Raises
    ------
    InvalidInputError : a discrete plant, or a period that is not positive
    DimensionError : the spec does not fit the plant

    Examples
    --------
    >>> from inc_casadi import Box
    >>> spec = Spec(Q=1.0, R=1.0, discount=0.9, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> plant, per_step = sampled_problem(Plant(0.5, 1.0, dt=0), spec, 0.1)
    >>> plant.dt, round(per_step.discount, 6)
    (0.1, 0.989519)
    """
    found = sample(plant, spec, period)
    return found.plant, found.spec


def sample(plant: Any, spec: Spec, period: float) -> SampledProblem:
    """Return the discrete problem of a continuous one, with what is known about its cost; see `sampled_problem`.

    >>> from inc_casadi import Box
    >>> found = sample(Plant([[0, 1], [0, 0]], [[0], [1]], dt=0), Spec(np.eye(2), 1.0, 1.0, Box([-1, -1], [1, 1])), 0.1)
    >>> found.exact, found.error < 1e-9
    (True, True)
    """
    plant = as_plant(plant)
    spec.check(plant)
    if plant.discrete:
        raise InvalidInputError(f"the plant is sampled already, with dt = {plant.dt:g}")
    period = number("period", period, 0.0, open_low=True)
    discrete = plant.sampled(period)
    per_step = replace(spec, discount=spec.discount**period)
    M = step_cost(plant, spec, period)
    S = _shift(discrete, per_step.discount, M, spec.Q * (-period / 2))
    rest = M - _telescoping(discrete, per_step.discount, S)
    n, allowed = plant.n, _EXACT * float(np.max(np.abs(M)))
    Q, R = rest[:n, :n], rest[n:, n:]
    least = min(float(np.linalg.eigvalsh(part)[0]) for part in (Q, R))
    exact = least >= -allowed and float(np.max(np.abs(rest[:n, n:]))) <= allowed
    return SampledProblem(discrete, replace(per_step, Q=_raised(Q), R=_raised(R)), M, S, exact)


def _raised(weight: Array) -> Array:
    """Return the nearest positive semidefinite matrix: negative eigenvalues raised to zero."""
    values, vectors = np.linalg.eigh(weight)
    if values[0] >= 0:
        return weight
    raised = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return (raised + raised.T) / 2


def step_cost(plant: Plant, spec: Spec, period: float) -> Array:
    """Return M (n + m, n + m): [x; u]'M [x; u] is the discounted cost of one period from x with u held.

    M = int_0^h exp(-gamma s) exp(F s)'diag(Q, R) exp(F s) ds, F = [A, B; 0, 0], is a block of one matrix exponential
    (Van Loan, IEEE Transactions on Automatic Control 23(3), 1978), taken over a short time and then doubled:
    M(2 h) = M(h) + exp(-gamma h) exp(F h)'M(h) exp(F h), so that no growing exponential is cancelled.

    >>> from inc_casadi import Box
    >>> step_cost(Plant(0.0, 1.0, dt=0), Spec(Q=3.0, R=1.0, discount=1.0, initial=Box(-1, 1)), 1.0).round(6).tolist()
    [[3.0, 1.5], [1.5, 2.0]]
    """
    from scipy.linalg import block_diag, expm

    n, size = plant.n, plant.n + plant.m
    F = np.zeros((size, size))
    F[:n] = np.hstack([plant.A, plant.B])
    F -= np.eye(size) * (-np.log(spec.discount) / 2)
    doublings = int(np.clip(np.ceil(np.log2(max(float(np.linalg.norm(F, 1)) * period, 1.0))), 0, _HALVINGS))
    short = expm(np.block([[-F.T, block_diag(spec.Q, spec.R)], [np.zeros((size, size)), F]]) * (period / 2**doublings))
    step = short[size:, size:]
    M = step.T @ short[:size, size:]
    for _ in range(doublings):
        M, step = M + step.T @ M @ step, step @ step
    return (M + M.T) / 2


def _telescoping(plant: Plant, discount: float, S: Array) -> Array:
    """Return the matrix over [x; u] of x'S x - discount x+'S x+."""
    ahead = np.hstack([plant.A, plant.B])
    found = -discount * (ahead.T @ S @ ahead)
    found[:plant.n, :plant.n] += S
    return (found + found.T) / 2


def _shift(plant: Plant, discount: float, M: Array, near: Array) -> Array:
    """Return the symmetric S nearest to `near` whose telescoping sum takes the cross term of M, by least squares."""
    n = plant.n
    pairs = list(zip(*np.triu_indices(n), strict=True))
    basis = np.zeros((len(pairs), n, n))
    for k, (i, j) in enumerate(pairs):
        basis[k, i, j] = basis[k, j, i] = 1.0 if i == j else np.sqrt(0.5)
    cross = -discount * np.einsum("ai,kab,bj->kij", plant.A, basis, plant.B)
    missing = M[:n, n:] + discount * plant.A.T @ near @ plant.B
    weights = np.linalg.lstsq(cross.reshape(len(pairs), -1).T, missing.ravel(), rcond=1e-13)[0]
    return near + np.tensordot(weights, basis, 1)
