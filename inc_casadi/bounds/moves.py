"""The algebra of finite sequences of moves, on which every lower bound stands: an affine minorant of the cost.

Arrays of a sequence have time first and columns last: states (T + 1, n, c), inputs (T, m, c), where the c columns are
initial states, or coefficients of x_0 when the moves are affine in x_0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..plant import Plant
from ..spec import Spec

UNIT = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Minorant:
    """The inequality cost(x_0, u) >= sum over columns of state'x_0 + sum_k inputs_k'u_k - offset - slack.

    It holds for every input sequence with |u_k| <= u_reach (see `minorant`).

    state (n, c), inputs (T, m, c), offset (c,); slack (c,) is what rounding may have cost.
    """

    state: Array
    inputs: Array
    offset: Array
    slack: Array


def rollout(A: Array, B: Array, x0: Array, u: Array) -> Array:
    """Return the states (T + 1, n, c) of x_{k+1} = A x_k + B u_k from x0 (n, c) under u (T, m, c).

    >>> rollout(np.array([[2.0]]), np.array([[1.0]]), np.array([[1.0]]), np.array([[[0.0]], [[1.0]]])).ravel().tolist()
    [1.0, 2.0, 5.0]
    """
    x = np.empty((len(u) + 1, *x0.shape))
    x[0] = x0
    for k, move in enumerate(u):
        x[k + 1] = A @ x[k] + B @ move
    return x


def costates(A: Array, Q: Array, P: Array, discount: float, x: Array) -> Array:
    """Return p (T + 1, n, c): p_T = 2 beta^T P x_T and p_k = A'p_{k+1} + 2 beta^k Q x_k.

    >>> costates(np.array([[2.0]]), np.eye(1), np.eye(1), 0.5, np.ones((2, 1, 1))).ravel().tolist()
    [4.0, 1.0]
    """
    T = len(x) - 1
    p = np.empty_like(x)
    p[T] = 2 * discount**T * (P @ x[T])
    for k in range(T - 1, -1, -1):
        p[k] = A.T @ p[k + 1] + 2 * discount**k * (Q @ x[k])
    return p


def slopes(B: Array, R: Array, discount: float, u: Array, p: Array) -> Array:
    """Return the gradient of the cost with respect to the inputs, B'p_{k+1} + 2 beta^k R u_k, shape (T, m, c).

    >>> slopes(np.array([[3.0]]), np.eye(1), 0.5, np.ones((1, 1, 1)), np.ones((2, 1, 1))).ravel().tolist()
    [5.0]
    """
    return B.T @ p[1:] + 2 * discount_powers(discount, len(u)) * (R @ u)


def discount_powers(discount: float, T: int) -> Array:
    """Return beta^k for k = 0..T-1, shaped (T, 1, 1) to weigh sequences.

    >>> discount_powers(0.5, 3).ravel().tolist()
    [1.0, 0.5, 0.25]
    """
    return (discount ** np.arange(T, dtype=float))[:, None, None]


def minorant(plant: Plant, spec: Spec, P: Array, x: Array, u: Array, u_reach: Array,
             start: Array | None = None) -> Minorant:
    """Return the tangent of the cost at the numbers (x, u), which need not be a trajectory, nor admissible.

    cost(x_0, u) = sum_{k<T} beta^k (x_k'Q x_k + u_k'R u_k) + beta^T x_T'P x_T along x_{k+1} = A x_k + B u_k. For Q, R,
    P >= 0 each square lies above its tangents: x_k'Q x_k >= 2 y_k'Q x_k - y_k'Q y_k for any y_k. With the costates p
    of y, sum_k beta^k 2 y_k'Q x_k = sum_k (p_k - A'p_{k+1})'x_k telescopes along the trajectory, so

        cost(x_0, u) >= p_0'x_0 + sum_k (B'p_{k+1} + 2 beta^k R v_k)'u_k - offset,

    offset = sum_k beta^k (y_k'Q y_k + v_k'R v_k) + beta^T y_T'P y_T. Equality holds at y = x, v = u.

    Parameters
    ----------
    P : (n, n) weight of the last state
    x : (T + 1, n, c), u : (T, m, c) the tangent point (y, v)
    u_reach : broadcasts to (T, m, c), bounds |u_k| over the sequences that the minorant is meant for
    start : (n, c) bounds |x_0| over the initial states that it is meant for; None for |y_0|

    Notes
    -----
    The recursion for p is the only place where rounding could make a tangent that is none: an error e_k in it changes
    the right side by e_k'x_k. `slack` bounds that over all states reached under u_reach, and the rounding of the
    sums, by a multiple of the unit roundoff times the sums of absolute values. It also covers weights whose smallest
    eigenvalue is negative by rounding.
    """
    A, B, Q, R, beta = plant.A, plant.B, spec.Q, spec.R, spec.discount
    T = len(u)
    p = costates(A, Q, P, beta, x)
    weights = discount_powers(beta, T)
    last = beta**T * np.sum(x[T] * (P @ x[T]), axis=0)
    offset = np.sum(weights * (x[:T] * (Q @ x[:T])), axis=(0, 1)) + np.sum(weights * (u * (R @ u)), axis=(0, 1)) + last
    absA, absB, absQ, absR = np.abs(A), np.abs(B), np.abs(Q), np.abs(R)
    reach = np.broadcast_to(np.abs(u_reach), u.shape)
    states = reached(A, B, np.abs(x[0]) if start is None else start, reach)
    sizes = absA.T @ np.abs(p[1:]) + 2 * weights * (absQ @ np.abs(x[:T]))
    input_sizes = absB.T @ np.abs(p[1:]) + 2 * weights * (absR @ np.abs(u))
    ends = 2 * beta**T * np.sum((np.abs(P) @ np.abs(x[T])) * states[T], axis=0)
    total = np.abs(offset) + ends + np.sum(sizes * states[:T], axis=(0, 1)) + np.sum(input_sizes * reach, axis=(0, 1))
    slack = 4 * UNIT * (plant.n + plant.m + T + 4) * total
    slack += np.sum(weights * _indefinite(Q)[:, None] * (states[:T] + np.abs(x[:T])) ** 2, axis=(0, 1))
    slack += beta**T * np.sum(_indefinite(P)[:, None] * (states[T] + np.abs(x[T])) ** 2, axis=0)
    slack += np.sum(weights * _indefinite(R)[:, None] * (reach + np.abs(u)) ** 2, axis=(0, 1))
    return Minorant(p[0], slopes(B, R, beta, u, p), offset, slack)


def reached(A: Array, B: Array, x0: Array, reach: Array) -> Array:
    """Return bounds (T + 1, n, c) on |x_k| for |x_0| <= x0 (n, c) and |u_k| <= reach_k, reach (T, m, c).

    |x_k| <= |A^k| x0 + sum_{j<k} |A^j B| max_i reach_i: powers, not products of absolute values, so that oscillations do
    not look like growth.

    >>> reached(np.array([[-2.0]]), np.array([[1.0]]), np.array([[1.0]]), np.ones((2, 1, 1))).ravel().tolist()
    [1.0, 3.0, 7.0]
    """
    states = np.empty((len(reach) + 1, *x0.shape))
    power, pushed, most = np.eye(len(A)), np.zeros(B.shape), np.max(reach, axis=0)
    for k in range(len(states)):
        states[k] = np.abs(power) @ x0 + pushed @ most
        pushed = pushed + np.abs(power @ B)
        power = A @ power
    return states


def balance(M: Array) -> Array:
    """Return powers of two d (n,) for which diag(d) M diag(d) has a diagonal near one: no rounding in it.

    Entries below 1e-16 of the largest count as that much, so that a weight's kernel is not blown up.

    >>> balance(np.diag([4.0, 2.0**-20])).tolist()
    [0.5, 1024.0]
    """
    sizes = np.abs(np.diag(M))
    most = float(np.max(sizes))
    if not 0 < most < np.inf:
        return np.ones(len(M))
    return np.asarray(2.0 ** -np.rint(np.log2(np.maximum(sizes, 1e-16 * most)) / 2))


def _indefinite(M: Array) -> Array:
    # The diagonal (n,) of a matrix that makes M semidefinite when added, each entry in the units of M.
    d = balance(M)
    return max(0.0, -float(np.linalg.eigvalsh(d[:, None] * M * d)[0])) / d**2
