"""Solve and test small linear systems in floats or, for object arrays, in exact fractions."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np

from ..arrays import Array
from ..exact import is_positive_definite


def solve(A: Array, B: Array) -> Array:
    """Return X with A X = B, in floats by LAPACK and in Fractions by Gauss elimination.

    Raises numpy.linalg.LinAlgError when A is singular.

    >>> from inc_casadi.blocks import exact
    >>> solve(exact([[2.0]]), exact([[1.0]])).tolist()
    [[Fraction(1, 2)]]
    """
    if A.dtype != object:
        return np.linalg.solve(A, B)
    n = A.shape[0]
    table = np.hstack([A, B])
    for k in range(n):
        pivot = next((i for i in range(k, n) if table[i, k] != 0), None)
        if pivot is None:
            raise np.linalg.LinAlgError("singular matrix")
        table[[k, pivot]] = table[[pivot, k]]
        table[k] = table[k] / table[k, k]
        for i in range(n):
            if i != k and table[i, k] != 0:
                table[i] = table[i] - table[i, k] * table[k]
    return table[:, n:]


def identity(n: int, like: Array) -> Array:
    """Return the n x n identity of the same kind of numbers as `like`."""
    if like.dtype != object:
        return np.eye(n)
    out = np.full((n, n), Fraction(0), dtype=object)
    out[np.arange(n), np.arange(n)] = Fraction(1)
    return out


def discounted_lyapunov(A: Array, M: Array, discount: float = 1.0) -> Array:
    """Return X = M + discount A' X A in floats, by doubling; the caller makes sure that sqrt(discount) A is stable.

    Doubling sums the series: after k rounds the first 2^k terms are in.

    >>> discounted_lyapunov(np.array([[0.5]]), np.array([[3.0]])).round(12).tolist()
    [[4.0]]
    """
    X, power = M, np.sqrt(discount) * A
    for _ in range(64):
        more = power.T @ X @ power
        X = X + more
        if np.max(np.abs(more), initial=0.0) <= 1e-17 * np.max(np.abs(X), initial=1e-300):
            break
        power = power @ power
    return (X + X.T) / 2


def positive_definite(M: Array) -> bool:
    """Whether a symmetric matrix is positive definite: exactly for Fractions, beyond rounding for floats.

    In floats the smallest eigenvalue must exceed 4 n eps times the largest, more than the error of computing it.

    >>> positive_definite(np.eye(2)), positive_definite(np.ones((2, 2)))
    (True, False)
    """
    if M.dtype == object:
        return is_positive_definite(M)
    n = M.shape[0]
    values = np.linalg.eigvalsh((M + M.T) / 2) if n else np.ones(1)
    return bool(values[0] > 4 * n * np.finfo(float).eps * abs(values[-1]))


def determinant(M: Array) -> Any:
    """Return the determinant of a square matrix: in floats by LAPACK, of Fractions by Gauss elimination.

    >>> determinant(np.array([[Fraction(1), Fraction(2)], [Fraction(3), Fraction(4)]], dtype=object))
    Fraction(-2, 1)
    """
    if M.dtype != object:
        return np.linalg.det(M)
    table, value = M.copy(), Fraction(1)
    for k in range(len(M)):
        pivot = next((i for i in range(k, len(M)) if table[i, k] != 0), None)
        if pivot is None:
            return Fraction(0)
        if pivot != k:
            table[[k, pivot]], value = table[[pivot, k]], -value
        value *= table[k, k]
        table[k + 1:] = table[k + 1:] - (table[k + 1:, k] / table[k, k])[:, None] * table[k][None, :]
    return value
