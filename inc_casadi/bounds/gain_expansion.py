"""The cost matrix P_F around a gain: its first and second derivatives, and what they leave over."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array
from .gain_algebra import Gains, Upper, both, norm, powers


@dataclass(frozen=True, eq=False)
class Expansion:
    """P0 + sum_j delta_j P_j + sum_{i<=j} delta_i delta_j P_ij around N gains, each at a discount of its own.

    With T(P) = Q + C'F'RFC + b A_F'P A_F the three equations of orders 0, 1 and 2 in delta of P = T(P).

    Parameters
    ----------
    P0 : (N, n, n); P1 : (N, d, n, n); P2 : (N, q, n, n) for the pairs i <= j
    missed : (N,) norms of what the equations leave over, each times its widths
    size : (N,) |P0| + sum_j w_j |P_j| + sum w_i w_j |P_ij|
    """

    P0: Array
    P1: Array
    P2: Array
    missed: Array
    size: Array


def expansion(gains: Gains, centers: Array, widths: Array, b: Array, operator: Array) -> Expansion:
    """Return the expansion of P_F around centres (N, d) for discounts b (N,).

    P0 - b A0'P0 A0 = Q + G0'R G0, and with He(X) = X + X'

        P_j - b A0'P_j A0 = He(G_j'R G0 + b B_j'P0 A0),
        sum over i, j of delta_i delta_j (G_i'R G_j + b B_i'P0 B_j + b He(B_i'P_j A0)) on the right for the P_ij.

    operator : (N, s, s) matrices of X -> A0'X A0

    >>> from inc_casadi import Box, Plant, Spec
    >>> gains = Gains(Plant(1.5, 1.0), Spec(1.0, 0.0, 1.0, Box(-1, 1)))  # P = 1 / (1 - b (1.5 + F)^2), b = 1, F = -1
    >>> found = expansion(gains, -np.ones((1, 1)), np.ones((1, 1)), np.ones(1), np.full((1, 1, 1), 0.25))
    >>> [round(float(part.item()), 6) for part in (found.P0, found.P1, found.P2)]  # P' = 2 x P^2, P''/2 = P^2 + 4 x^2 P^3
    [1.333333, 1.777778, 4.148148]
    """
    R, Q, N, n = gains.spec.R, gains.data.Q, len(centers), gains.plant.n
    G0, A0 = gains.closed(centers)
    solve = _Lyapunov(Upper(n), np.eye(operator.shape[-1]) - b[:, None, None] * operator)
    b4 = b[:, None, None, None]
    P0, missed0 = solve((Q + np.swapaxes(G0, 1, 2) @ R @ G0)[:, None])
    priced = np.einsum("iak,ab,Nbl->Nikl", gains.inputs, R, G0)
    P1, missed1 = solve(both(priced + b4 * gains.pushed(P0 @ A0[:, None])[:, :, 0]))
    square = np.einsum("iak,ab,jbl->ijkl", gains.inputs, R, gains.inputs)
    square = square + b4[..., None] * gains.pushed(gains.steered(P0)[:, 0])
    terms = square + b4[..., None] * both(gains.pushed(P1 @ A0[:, None]))
    P2, missed2 = solve((gains.sum_pairs @ terms.reshape(N, gains.d**2, n * n)).reshape(N, -1, n, n))
    areas = powers(widths, gains.pairs)
    missed = missed0[:, 0] + np.sum(widths * missed1, axis=1) + np.sum(areas * missed2, axis=1)
    size = norm(P0[:, 0]) + np.sum(widths * norm(P1), axis=1) + np.sum(areas * norm(P2), axis=1)
    return Expansion(P0[:, 0], P1, P2, missed, size)


def third_order(gains: Gains, found: Expansion, centers: Array, b: Array) -> Array:
    """Return the third-order terms M (N, t, n, n) of T(P) - P, one for each monomial i <= j <= k.

    They are b (He(B_delta'P_2 A0) + B_delta'P_1 B_delta) with P_1, P_2 the terms of first and second order.
    """
    N, n, d = len(centers), gains.plant.n, gains.d
    _, A0 = gains.closed(centers)
    mixed = both(gains.pushed(found.P2 @ A0[:, None])).reshape(N, -1, n * n)
    inner = gains.pushed(gains.steered(found.P1).reshape(N, d * d, n, n)).reshape(N, d**3, n * n)
    sums = gains.sum_mixed @ mixed + gains.sum_triples @ inner
    return b[:, None, None, None] * both(sums.reshape(N, -1, n, n)) / 2


@dataclass(frozen=True, eq=False)
class _Lyapunov:
    # X with X - b A0'X A0 = right, for several right-hand sides, and the norm of what is missed.
    upper: Upper
    left: Array

    @cached_property
    def inverse(self) -> Array:
        return inverse(self.left)

    def __call__(self, right: Array) -> tuple[Array, Array]:
        flat = np.swapaxes(self.upper.pack(right), 1, 2)
        found = self.inverse @ flat
        off = flat - self.left @ found
        return self.upper.unpack(np.swapaxes(found, 1, 2)), np.sqrt(2 * np.sum(off * off, axis=1))


def inverse(left: Array) -> Array:
    """Return the inverses of (N, s, s); of a singular matrix something finite, which no check will pass.

    >>> inverse(np.array([[[2.0]], [[0.0]]])).tolist()
    [[[0.5]], [[1.0]]]
    """
    try:
        return np.linalg.inv(left)
    except np.linalg.LinAlgError:
        singular = np.linalg.slogdet(left)[0] == 0
        return np.linalg.inv(np.where(singular[:, None, None], np.eye(left.shape[-1]), left))
