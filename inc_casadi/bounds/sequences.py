"""The best input sequences from many initial states at once: interior-point steps by Riccati recursions, in NumPy.

min sum_{k<T} beta^k (x_k'Q x_k + u_k'R u_k) + beta^T x_T'P x_T over x_{k+1} = A x_k + B u_k, H u_k <= h, from every
column of x0. Nothing here is trusted: a bound is computed afterwards from the sequences found, whatever they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from ..plant import Plant
from ..sets import Box, Polytope
from ..spec import Spec
from .moves import costates, discount_powers, rollout, slopes

_ITERATIONS = 40
_TO_BOUNDARY = 0.995
_GOOD = 1e-7  # relative gap from which on a step that does not improve it ends the search
_STIFFEST = 1e11  # barrier weights beyond this many times the cost's own are as good as infinite


@dataclass(frozen=True, eq=False)
class Factors:
    """Backward Riccati sweep per column: gains (T, c, m, n), inverse input weights (T, c, m, m), Hessian (c, n, n)."""

    gains: Array
    inverses: Array
    hessian: Array


@dataclass(frozen=True, eq=False)
class Interior:
    """Strictly feasible sequences u (T, m, c), distances from the limits and multipliers (T, f, c), all positive."""

    u: Array
    slack: Array
    multipliers: Array

    def columns(self, kept: Array) -> Interior:
        """Return some of the columns."""
        return Interior(self.u[:, :, kept], self.slack[:, :, kept], self.multipliers[:, :, kept])

    def put(self, where: Array, columns: Interior) -> None:
        """Overwrite some of the columns."""
        for mine, theirs in zip((self.u, self.slack, self.multipliers),
                                (columns.u, columns.slack, columns.multipliers), strict=True):
            mine[:, :, where] = theirs


def optimal_sequences(plant: Plant, spec: Spec, limits: Box | Polytope, P: Array, x0: Array, T: int,
                      tol: float = 1e-11, price: Array | None = None) -> Interior:
    """Return sequences u (T, m, c) within `limits` that are optimal from the columns of x0 (n, c) up to `tol`, and their
    multipliers.

    Mehrotra's predictor-corrector method on each column with its own step lengths, started at the middle of the limits;
    columns that are done, or come no nearer for rounding, are left alone. The gap that the relative `tol` is for is the
    convexity gap grad f(u)'u - min_v grad f(u)'v over the limits.

    Parameters
    ----------
    P : (n, n) weight of the last state
    x0 : (n, c) initial states
    T : number of moves
    price : (r, m, c) what the first r inputs cost besides, price_k'u_k; nothing when left out

    >>> from inc_casadi import Box, Plant, Spec
    >>> plant, limits = Plant(1.0, 1.0), Box(-1, 1)
    >>> spec = Spec(Q=1.0, R=0.0, discount=1.0, initial=limits, inputs=limits)
    >>> found = optimal_sequences(plant, spec, limits, np.eye(1), np.array([[0.5, 2.5]]), 2)
    >>> found.u[:, 0].T.round(6).tolist(), found.multipliers[:, :, 1].round(6).tolist()
    ([[-0.5, -0.0], [-1.0, -1.0]], [[0.0, 4.0], [0.0, 1.0]])
    """
    middle = limits.vertices.mean(axis=1)
    price = np.zeros((0, plant.m, x0.shape[1])) if price is None else price
    u = np.broadcast_to(middle[None, :, None], (T, plant.m, x0.shape[1])).copy()
    point = Interior(u, limits.h[:, None] - limits.H @ u, np.empty(0))
    point = replace(point, multipliers=_first_multipliers(plant, spec, limits, P, x0, point, price))
    best = Interior(u, point.slack.copy(), point.multipliers.copy())
    active, least = np.arange(x0.shape[1]), np.full(x0.shape[1], np.inf)
    for _ in range(_ITERATIONS):
        x = rollout(plant.A, plant.B, x0[:, active], point.u)
        g = _gradient(plant, spec, P, x, point.u, price[:, :, active])
        now = costs(spec, P, x, point.u)
        gaps, scale = _gaps(limits, g, point.u), now + now.mean()
        better = gaps < least[active]
        unfinished = (gaps > tol * scale) & (better | (least[active] > _GOOD * scale))
        best.put(active[better], point.columns(better))
        least[active[better]] = gaps[better]
        active = active[unfinished]
        if not active.size:
            break
        point = _newton(plant, spec, limits, P, point.columns(unfinished), g[:, :, unfinished])
        sound = np.all(np.isfinite(point.u), axis=(0, 1)) & np.all(point.slack > 0, axis=(0, 1))
        active, point = active[sound], point.columns(sound)
    return best


def _gradient(plant: Plant, spec: Spec, P: Array, x: Array, u: Array, price: Array) -> Array:
    g = slopes(plant.B, spec.R, spec.discount, u, costates(plant.A, spec.Q, P, spec.discount, x))
    g[:len(price)] += price
    return g


def _first_multipliers(plant: Plant, spec: Spec, limits: Box | Polytope, P: Array, x0: Array, point: Interior,
                       price: Array) -> Array:
    # Such that multiplier times distance is, for each column, the average of what a move changes in the cost.
    x = rollout(plant.A, plant.B, x0, point.u)
    g = _gradient(plant, spec, P, x, point.u, price)
    scale = _gaps(limits, g, point.u) / point.slack[:, :, 0].size
    return (scale + 1e-12 * (1 + scale.max(initial=0.0))) / point.slack


def costs(spec: Spec, P: Array, x: Array, u: Array) -> Array:
    """Return the costs (c,) of inputs u (T, m, c) that lead through the states x (T + 1, n, c)."""
    T = len(u)
    stage = np.sum(x[:T] * (spec.Q @ x[:T]), axis=1) + np.sum(u * (spec.R @ u), axis=1)
    return discount_powers(spec.discount, T)[:, 0, 0] @ stage + spec.discount**T * np.sum(x[T] * (P @ x[T]), axis=0)


def _gaps(limits: Box | Polytope, g: Array, u: Array) -> Array:
    T, m, c = g.shape
    flat = -g.transpose(1, 0, 2).reshape(m, T * c)
    return np.sum(g * u, axis=(0, 1)) + np.asarray(limits.support(flat)).reshape(T, c).sum(axis=0)


def _newton(plant: Plant, spec: Spec, limits: Box | Polytope, P: Array, point: Interior, g: Array) -> Interior:
    # One predictor-corrector step from a point where the gradient of the cost is g.
    H, slack, multipliers = limits.H, point.slack, point.multipliers
    stiffest = _STIFFEST * float(np.linalg.norm(spec.R) + np.linalg.norm(plant.B.T @ P @ plant.B)) / np.sum(H**2)
    barrier = np.minimum(multipliers / slack, stiffest + np.min(multipliers / slack))
    factors = factor(plant, spec, P, H, barrier)
    size = slack[:, :, 0].size
    gap = np.sum(slack * multipliers, axis=(0, 1)) / size
    ds = -(H @ _solve(plant, factors, g))
    dl = -barrier * ds - multipliers
    short = np.minimum(_longest(slack, ds), _longest(multipliers, dl))
    reached = np.sum((slack + short * ds) * (multipliers + short * dl), axis=(0, 1)) / size
    target = (gap * (reached / gap) ** 3 - ds * dl) / slack
    du = _solve(plant, factors, g + H.T @ target)
    ds = -(H @ du)
    dl = target - multipliers - barrier * ds
    step, dual_step = _TO_BOUNDARY * _longest(slack, ds), _TO_BOUNDARY * _longest(multipliers, dl)
    return Interior(point.u + step * du, slack + step * ds, multipliers + dual_step * dl)


def _longest(value: Array, change: Array) -> Array:
    # The longest step (c,), at most 1 / _TO_BOUNDARY, that keeps value + step * change >= 0.
    worst = np.max(-change / value, axis=(0, 1))
    return 1 / np.maximum(worst, _TO_BOUNDARY)


def factor(plant: Plant, spec: Spec, P: Array, H: Array, barrier: Array) -> Factors:
    """Return the Riccati sweep of the cost where barrier (T, f, c) adds H'diag(barrier_k) H to the weight of the input."""
    n, m = plant.n, plant.m
    T, f, c = barrier.shape
    AB = np.hstack([plant.A, plant.B])
    curvature = np.einsum("fi,tfc,fj->tcij", H, barrier, H, optimize=True)
    gains, inverses = np.empty((T, c, m, n)), np.empty((T, c, m, m))
    value = np.broadcast_to(2 * spec.discount**T * P, (c, n, n))
    for k in range(T - 1, -1, -1):
        weight = 2 * spec.discount**k
        joint = AB.T @ (value.reshape(c * n, n) @ AB).reshape(c, n, n + m)
        inverses[k] = _inverse(joint[:, n:, n:] + weight * spec.R + curvature[k])
        across = joint[:, :n, n:]
        gains[k] = -inverses[k] @ across.transpose(0, 2, 1)
        value = joint[:, :n, :n] + weight * spec.Q + across @ gains[k]
    return Factors(gains, inverses, value)


def _inverse(S: Array) -> Array:
    if S.shape[1] == 1:
        return np.asarray(1 / S, dtype=float)
    try:
        return np.asarray(np.linalg.inv(S), dtype=float)
    except np.linalg.LinAlgError:  # some column is at a vertex of the limits already
        return np.asarray(np.linalg.pinv(S, hermitian=True), dtype=float)


def _solve(plant: Plant, factors: Factors, g: Array) -> Array:
    # The step du (T, m, c) that minimizes g'du + du'(Hessian)du / 2: backward for the offsets, forward for the moves.
    A, B = plant.A, plant.B
    T, m, c = g.shape
    offsets, q = np.empty((T, m, c)), np.zeros((plant.n, c))
    for k in range(T - 1, -1, -1):
        slope = g[k] + B.T @ q
        offsets[k] = -_apply(factors.inverses[k], slope)
        q = A.T @ q + _apply(factors.gains[k].transpose(0, 2, 1), slope)
    du, dx = np.empty((T, m, c)), np.zeros((plant.n, c))
    for k in range(T):
        du[k] = offsets[k] + _apply(factors.gains[k], dx)
        dx = A @ dx + B @ du[k]
    return du


def _apply(matrices: Array, columns: Array) -> Array:
    return np.einsum("cij,jc->ic", matrices, columns)
