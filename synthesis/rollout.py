"""Roll a saturated INC loop out from many states at once, with the gradient and the sensitivities of its cost.

Everything is batched over the N initial states and, behind the forward sweep, over the T steps too; the only loop is
the one over time. Arrays are laid out as (T, N, size), points in rows, because batched linear algebra reads them so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from inc_casadi.activations import Activation, stack
from inc_casadi.arrays import Array
from inc_casadi.inc import INC

TOLERANCE = 1e-11
NEWTON_STEPS = 200


class Parameters(NamedTuple):
    """The matrices of an INC, or the gradient to them: W (q, q), U (q, p), V (m, q), K (m, p), b (q,), d (m,)."""

    W: Array
    U: Array
    V: Array
    K: Array
    b: Array
    d: Array

    @classmethod
    def of(cls, inc: INC) -> Parameters:
        """Return the matrices of a controller."""
        return cls(inc.W, inc.U, inc.V, inc.K, inc.b, inc.d)


@dataclass(frozen=True, eq=False)
class Scenario:
    """What a rollout costs: the loop around the law, the cost, and the initial states with their weights.

    x+ = A x + B u, y = C x, u = clip(v, lower, upper), v = K y + V eta + d, with d = -V eta(y = 0) when `anchored`, and

        J = sum_i weights_i [ sum_{k < steps} discount^k (x_k'Q x_k + u_k'R u_k) + discount^steps x_T'terminal x_T ]
            + penalty sum_{k < steps} discount^k mean_i |max(H u_k - h, 0)|^2.

    A (n, n), B (n, m), C (p, n), Q (n, n), R (m, m), terminal (n, n); nodes (n, N), weights (N,); lower, upper (m,),
    infinite where the input is free; H (l, m), h (l,): half-spaces that inputs should keep, l may be 0; units: the
    activations of the hidden units; shrink < 1: a Newton step must reduce the residual by this factor, else a Picard
    step is taken.
    """

    A: Array
    B: Array
    C: Array
    Q: Array
    R: Array
    discount: float
    terminal: Array
    nodes: Array
    weights: Array
    steps: int
    lower: Array
    upper: Array
    H: Array
    h: Array
    penalty: float
    units: stack.Units
    anchored: bool = True
    shrink: float = 0.995

    @property
    def q(self) -> int:
        """Number of hidden units."""
        return len(self.units)

    @cached_property
    def groups(self) -> list[tuple[Activation, np.ndarray]]:
        """Each distinct activation with the indices of its units."""
        return stack.groups(self.units)

    def excess(self, u: Array) -> Array:
        """Return max(H u - h, 0) for inputs (..., m), as (..., l)."""
        return np.maximum(u @ self.H.T - self.h, 0.0)

    def activate(self, z: Array) -> Array:
        """Return phi(z) for rows z (N, q)."""
        return self._each(z, [unit for unit, _ in self.groups])

    def slopes(self, z: Array) -> Array:
        """Return phi'(z) for rows z (N, q); at a kink, the slope on its right."""
        return self._each(z, [unit.derivative for unit, _ in self.groups])

    def _each(self, z: Array, functions: list[Callable[[Array], Array]]) -> Array:
        if len(functions) == 1:
            return functions[0](z)
        out = np.empty_like(z)
        for function, (_, columns) in zip(functions, self.groups, strict=True):
            out[:, columns] = function(z[:, columns])
        return out


@dataclass(frozen=True, eq=False)
class Motion:
    """One rollout: x (T+1, N, n), v and u (T, N, m), eta and slope (T, N, q), both at y = 0 (q,), and the cost J."""

    x: Array
    v: Array
    u: Array
    eta: Array
    slope: Array
    origin_eta: Array
    origin_slope: Array
    cost: float


def roll(scenario: Scenario, law: Parameters, guess: Array | None = None) -> Motion:
    """Return the motion of the loop from all nodes; the cost is infinite when a state or a fixed point is lost.

    guess: eta (T, N, q) of a similar law, from which Newton starts; one step then mostly suffices.
    """
    T, N = scenario.steps, scenario.weights.size
    x = np.empty((T + 1, N, scenario.A.shape[0]))
    v, u = np.empty((2, T, N, scenario.B.shape[1]))
    eta, slope = np.zeros((2, T, N, scenario.q))
    x[0] = scenario.nodes.T
    with np.errstate(over="ignore", invalid="ignore"):
        origin_eta, origin_slope = hidden(scenario, law.W, law.b[None], np.zeros((1, scenario.q)))
        offset = -(origin_eta[0] @ law.V.T) if scenario.anchored else law.d
        for k in range(T):
            y = x[k] @ scenario.C.T
            eta[k], slope[k] = hidden(scenario, law.W, y @ law.U.T + law.b, eta[k] if guess is None else guess[k])
            v[k] = y @ law.K.T + eta[k] @ law.V.T + offset
            u[k] = np.clip(v[k], scenario.lower, scenario.upper)
            x[k + 1] = x[k] @ scenario.A.T + u[k] @ scenario.B.T
        cost = _cost(scenario, x, u)
    return Motion(x, v, u, eta, slope, origin_eta[0], origin_slope[0], cost)


def hidden(scenario: Scenario, W: Array, r: Array, eta: Array) -> tuple[Array, Array]:
    """Return eta = phi(W eta + r) and phi' there for rows r (N, q), starting from eta; rows not found are NaN.

    A semismooth Newton step stands in a row only where it shrinks the residual, else one Picard step replaces it: that
    converges whenever ||W||_inf < shrink and no slope exceeds 1.
    """
    if scenario.q == 0:
        return np.zeros_like(r), np.zeros_like(r)
    scale = TOLERANCE * np.maximum(1.0, np.max(np.abs(r), axis=1))
    z, residual, size = _residual(scenario, W, r, eta)
    eta, slope, rows = eta.copy(), scenario.slopes(z), np.flatnonzero(size > scale)
    for _ in range(NEWTON_STEPS):
        if not rows.size:
            break
        before, step, small = eta[rows], residual[rows], scale[rows]
        eta[rows] = before + np.linalg.solve(np.eye(scenario.q) - slope[rows][:, :, None] * W, step[:, :, None])[:, :, 0]
        z, residual[rows], found = _residual(scenario, W, r[rows], eta[rows])
        grown = (found > scenario.shrink * size[rows]) & (found > small)
        if grown.any():
            eta[rows[grown]] = before[grown] + step[grown]
            z, residual[rows], found = _residual(scenario, W, r[rows], eta[rows])
        slope[rows], size[rows] = scenario.slopes(z), found
        rows = rows[found > small]
    lost = ~(size <= scale)
    return (np.where(lost[:, None], np.nan, eta) if lost.any() else eta), slope


def _residual(scenario: Scenario, W: Array, r: Array, eta: Array) -> tuple[Array, Array, Array]:
    z = eta @ W.T + r
    residual = scenario.activate(z) - eta
    return z, residual, np.max(np.abs(residual), axis=1)


def gradient(scenario: Scenario, law: Parameters, motion: Motion) -> Parameters:
    """Return dJ / d(parameters) by one sweep back through time and the adjoint fixed points (prop:implicit_gradients).

    With D the slopes, v answers the hidden preactivation by S = V (I - D W)^{-1} D, so that dv/dy = K + S U. In an
    anchored law d is no parameter: its gradient is zero, and y = 0 enters like one more sample of opposite sign.
    """
    T, N = scenario.steps, scenario.weights.size
    S, free, gain = linearized(scenario, law, motion)
    weight = 2.0 * scenario.discount ** np.arange(T)[:, None, None] * scenario.weights[None, :, None]
    from_u, from_x = weight * (motion.u @ scenario.R), weight * (motion.x[:T] @ scenario.Q)
    if scenario.h.size:
        share = 2.0 * scenario.penalty / N * scenario.discount ** np.arange(T)[:, None, None]
        from_u += share * (scenario.excess(motion.u) @ scenario.H)
    costate = 2.0 * scenario.discount**T * scenario.weights[:, None] * (motion.x[T] @ scenario.terminal)
    to_v = np.empty_like(motion.v)
    for k in range(T - 1, -1, -1):
        to_v[k] = (from_u[k] + costate @ scenario.B) * free[k]
        costate = from_x[k] + costate @ scenario.A + np.einsum("im,imn->in", to_v[k], gain[k])
    g, eta = to_v.reshape(T * N, -1), motion.eta.reshape(T * N, -1)
    y = motion.x[:T].reshape(T * N, -1) @ scenario.C.T
    to_r = np.einsum("kim,kimq->kiq", to_v, S).reshape(T * N, -1)
    to = Parameters(to_r.T @ eta, to_r.T @ y, g.T @ eta, g.T @ y, to_r.sum(axis=0), g.sum(axis=0))
    if not scenario.anchored:
        return to
    at_origin = -to.d @ sensitivity(law, motion.origin_slope[None])[0]
    return to._replace(W=to.W + np.outer(at_origin, motion.origin_eta), V=to.V - np.outer(to.d, motion.origin_eta),
                       b=to.b + at_origin, d=np.zeros_like(to.d))


def sensitivity(law: Parameters, slope: Array) -> Array:
    """Return S = V (I - D W)^{-1} D for rows of slopes (N, q), as (N, m, q): how v answers the hidden preactivation.

    Rows with the same slopes share one solution: piecewise-affine units have few patterns for many points.

    >>> law = Parameters(W=np.array([[0.5]]), U=np.eye(1), V=np.eye(1), K=np.eye(1), b=np.zeros(1), d=np.zeros(1))
    >>> sensitivity(law, np.array([[1.0], [0.0]])).ravel().tolist()
    [2.0, 0.0]
    """
    first, back = _patterns(slope)
    D = slope[first]
    transposed = np.eye(D.shape[1]) - law.W.T * D[:, None, :]
    right = np.broadcast_to(law.V.T, (*D.shape, law.V.shape[0]))
    return (np.swapaxes(np.linalg.solve(transposed, right), 1, 2) * D[:, None, :])[back]


def _patterns(slope: Array) -> tuple[np.ndarray, np.ndarray]:
    """Return rows that stand for all different ones, and which of them each row is; only for up to 64 on-off units."""
    N, q = slope.shape
    everyone = np.arange(N)
    if not 0 < q <= 64 or N == 0:
        return everyone, everyone
    high = slope == np.max(slope)
    if not np.all(high | (slope == np.min(slope))):
        return everyone, everyone
    bits = np.zeros((N, 64), dtype=bool)
    bits[:, :q] = high
    codes = np.packbits(bits, axis=1).view(np.uint64).ravel()
    _, first, back = np.unique(codes, return_index=True, return_inverse=True)
    return first, back


def linearized(scenario: Scenario, law: Parameters, motion: Motion) -> tuple[Array, Array, Array]:
    """Return S (T, N, m, q), whether each input is inside its limits (T, N, m), and du/dx (T, N, m, n)."""
    T, N, m = motion.v.shape
    S = sensitivity(law, motion.slope.reshape(T * N, scenario.q)).reshape(T, N, m, scenario.q)
    free = (motion.v > scenario.lower) & (motion.v < scenario.upper)
    return S, free, free[..., None] * ((law.K + S @ law.U) @ scenario.C)


def _cost(scenario: Scenario, x: Array, u: Array) -> float:
    T = scenario.steps
    stage = np.einsum("kni,kni->kn", x[:T] @ scenario.Q, x[:T]) + np.einsum("kni,kni->kn", u @ scenario.R, u)
    last = np.einsum("ni,ni->n", x[T] @ scenario.terminal, x[T])
    total = scenario.discount ** np.arange(T) @ (stage @ scenario.weights)
    total += scenario.discount**T * (last @ scenario.weights)
    if scenario.h.size:
        outside = np.sum(scenario.excess(u) ** 2, axis=2).mean(axis=1)
        total += scenario.penalty * (scenario.discount ** np.arange(T) @ outside)
    return float(total) if np.isfinite(total) else np.inf
