"""Decide matrix inequalities in exact arithmetic: integers and fractions from the stored doubles, nothing rounded."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np

from .arrays import Array
from .blocks import exact
from .errors import InvalidInputError
from .integers import characteristic, over_common_denominator, product

WITNESS_BITS = 54


def is_positive_definite(matrix: Any) -> bool:
    """Return whether a symmetric matrix of Fractions or integers is positive definite; necessary and sufficient.

    The matrix is brought to integers by a congruence with powers of two and one common denominator. Then, in order:

    * a 2 x 2 minor with M_ii <= 0 or M_ij^2 >= M_ii M_jj refuses;
    * an integer matrix L with M - L L' strictly diagonally dominant, diagonal positive, accepts, since L L' >= 0;
    * an integer vector x != 0 with x'M x <= 0 refuses;
    * the leading minors by Bareiss' fraction-free elimination decide what is left (Sylvester's criterion), or, where
      python-flint is installed, the signs of the characteristic polynomial.

    Floating point only proposes L and x; every verdict rests on integers. python-flint (the extra `exact`) also does the
    products then, faster and with the same results. Raises InvalidInputError for a float entry or a matrix that is not
    symmetric.

    >>> is_positive_definite(exact(np.array([[2.0, 1.0], [1.0, 1.0]])))
    True
    >>> is_positive_definite(exact(np.array([[1.0, 1.0], [1.0, 1.0]])))
    False
    """
    numbers, scale = _integers(matrix)
    if numbers.size == 0:
        return True
    if _small_minor_fails(numbers):
        return False
    proposal = _float_eigenvectors(numbers, scale)
    if proposal is not None:
        smallest, vector, factor = proposal
        if factor is not None and _dominant_remainder(numbers, scale, factor):
            return True
        if smallest <= 0 and _is_descent(numbers, vector):
            return False
    return _signs_decide(numbers)


def is_nonnegative(array: Any) -> bool:
    """Return whether every entry of an array of Fractions or integers is at least 0.

    >>> is_nonnegative(exact(np.array([0.0, 1e-300])))
    True
    """
    return all(_rational(entry) >= 0 for entry in np.asarray(array, dtype=object).flat)


def contracts(slope: Array, W: Array, weights: Array) -> bool:
    """Return whether S |W| v < v and v > 0 hold exactly, the contraction behind thm:wellposed.

    slope: (q,) largest absolute slope of each unit, the diagonal of S; W: (q, q); weights: (q,), the vector v. Any
    such v proves that eta = phi(W eta + c) has exactly one solution for every c.

    >>> contracts(np.ones(1), np.array([[-0.5]]), np.ones(1)), contracts(np.ones(1), np.array([[-1.0]]), np.ones(1))
    (True, False)
    """
    if not np.all(np.isfinite(weights)):
        return False
    v, S, magnitude = exact(weights), exact(slope), exact(np.abs(W))
    return all(entry > 0 for entry in v) and all(
        S[i] * sum((magnitude[i, j] * v[j] for j in np.flatnonzero(W[i])), Fraction(0)) < v[i] for i in range(v.size))


def solve(A: Any, b: Any) -> np.ndarray | None:
    """Return the exact solution of A x = b, or None when A is singular.

    A: (k, k) and b: (k,) of Fractions.

    >>> solve(exact(np.array([[2.0, 1.0], [0.0, 4.0]])), exact(np.array([1.0, 1.0]))).tolist()
    [Fraction(3, 8), Fraction(1, 4)]
    """
    size = len(b)
    rows = np.empty((size, size + 1), dtype=object)
    rows[:, :size], rows[:, size] = A, b
    for k in range(size):
        pivot = next((i for i in range(k, size) if rows[i, k] != 0), None)
        if pivot is None:
            return None
        rows[[k, pivot]] = rows[[pivot, k]]
        rows[k, k:] = rows[k, k:] / rows[k, k]
        for i in range(size):
            if i != k and rows[i, k] != 0:
                rows[i, k:] = rows[i, k:] - rows[i, k] * rows[k, k:]
    return rows[:, size]


def _rational(entry: Any) -> Fraction | int:
    if isinstance(entry, Fraction | int | np.integer):
        return entry if isinstance(entry, Fraction) else int(entry)
    raise InvalidInputError(f"exact arithmetic met {entry!r} of type {type(entry).__name__}: a float slipped in")


def _integers(matrix: Any) -> tuple[np.ndarray, int]:
    """Return (N, c) with N / c = D M D for a diagonal D of powers of two that brings the diagonal near 1."""
    matrix = np.asarray(matrix, dtype=object)
    size = matrix.shape[0]
    if matrix.shape != (size, size):
        raise InvalidInputError(f"a matrix inequality needs a square matrix, but the shape is {matrix.shape}")
    numbers, common = over_common_denominator(
        np.array([_rational(entry) for entry in matrix.flat], dtype=object).reshape(size, size))
    if np.any(numbers != numbers.T):
        raise InvalidInputError("a matrix inequality needs a symmetric matrix")
    half = [(entry.bit_length() - common.bit_length()) // 2 if entry > 0 else 0 for entry in np.diag(numbers)]
    top = max(half, default=0)
    left = np.array([top - power for power in half], dtype=object)
    numbers = numbers << (left[:, None] + left[None, :] + max(0, -2 * top))
    return _without_common_twos(numbers, common << max(0, 2 * top))


def _without_common_twos(numbers: np.ndarray, scale: int) -> tuple[np.ndarray, int]:
    bits = scale
    for entry in numbers.flat:
        bits |= entry
    spare = (bits & -bits).bit_length() - 1
    return numbers >> spare, scale >> spare


def _small_minor_fails(numbers: np.ndarray) -> bool:
    size = numbers.shape[0]
    if any(numbers[i, i] <= 0 for i in range(size)):
        return True
    return any(numbers[i, j] ** 2 >= numbers[i, i] * numbers[j, j] for i in range(size) for j in range(i))


def _float_eigenvectors(numbers: np.ndarray, scale: int) -> tuple[float, Array, Array | None] | None:
    """Propose, in floats: the smallest eigenvalue, its vector, and a Cholesky factor of M minus half of it."""
    approximate = np.array([[entry / scale for entry in row] for row in numbers], dtype=float)
    if not np.all(np.isfinite(approximate)):
        return None
    values, vectors = np.linalg.eigh(approximate)
    factor = None
    if values[0] > 0:
        try:
            factor = np.linalg.cholesky(approximate - 0.5 * values[0] * np.eye(len(values)))
        except np.linalg.LinAlgError:
            factor = None
    return float(values[0]), vectors[:, 0], factor


def _fixed_point(array: Array, bits: int) -> np.ndarray:
    """Return round(array 2^bits) as Python integers; any integers would do, these are close."""
    out = np.empty(array.shape, dtype=object)
    out.ravel()[:] = [int(entry) for entry in np.rint(np.ldexp(array, bits)).ravel()]
    return out


def _dominant_remainder(numbers: np.ndarray, scale: int, factor: Array) -> bool:
    L = _fixed_point(factor, WITNESS_BITS)
    remainder = numbers * (1 << 2 * WITNESS_BITS) - scale * product(L, L.T)
    magnitude = np.abs(remainder)
    diagonal = np.diag(remainder)
    return bool(np.all(diagonal > 0) and np.all(2 * diagonal > magnitude.sum(axis=1)))


def _is_descent(numbers: np.ndarray, vector: Array) -> bool:
    x = _fixed_point(vector, WITNESS_BITS)
    return bool(np.any(x != 0) and x @ numbers @ x <= 0)


def _signs_decide(numbers: np.ndarray) -> bool:
    """Definiteness of a symmetric integer matrix without any proposal.

    All N roots of det(t I - M) are real. They are positive if and only if the coefficients c_N = 1, c_{N-1}, ..., c_0
    alternate in sign without a zero: (-1)^k c_{N-k} is the sum of the principal minors of order k, positive when M > 0;
    and if all of them are positive, no t <= 0 is a root.
    """
    coefficients = characteristic(numbers)
    if coefficients is None:
        return _bareiss(numbers)
    return all((-1) ** k * entry > 0 for k, entry in enumerate(reversed(coefficients)))


def _bareiss(numbers: np.ndarray) -> bool:
    """Leading minors of a symmetric integer matrix by fraction-free elimination: all positive?"""
    rest, previous = numbers.copy(), 1
    while True:
        pivot = rest[0, 0]
        if pivot <= 0:
            return False
        if rest.shape[0] == 1:
            return True
        column = rest[1:, 0]
        rest = (rest[1:, 1:] * pivot - column[:, None] * column[None, :]) // previous
        previous = pivot
