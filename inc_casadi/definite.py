"""Decide definiteness in floating point with every rounding bounded: a Cholesky factor that is judged by its residual.

Milliseconds where exact arithmetic takes seconds, and no weaker as a proof: only matrices closer to singular than
rounding can tell are left undecided.
"""

from __future__ import annotations

import numpy as np

from .arrays import Array
from .errors import DimensionError, InvalidInputError
from .readings import EPS, FLUSHED, Rounded

EIGENVALUE_ROUNDING = 8.0  # eigvalsh errs by less than this times size eps norm


def is_surely_positive(condition: Rounded) -> bool:
    """Return True only with a proof that a symmetric matrix M, known up to an error bound, is positive definite.

    Let A be the floats, E >= |M - A| the bound, both scaled by powers of two to a diagonal in [1/2, 2), which is exact.
    The proof is a matrix L with a remainder M - L L' that is strictly diagonally dominant with positive diagonal, for
    then x'M x = |L'x|^2 + x'(M - L L') x > 0. L is the Cholesky factor of A - diag(c), and

        c_i = 2 (n + 4) eps sqrt(a_ii) sum_j sqrt(a_jj) + 9/8 sum_j E_ij

    is so large that the factorization can run to its end only if M > 0, by the backward error bound
    gamma_{n+1} / (1 - gamma_{n+1}) tr A of Cholesky in floating point (S. M. Rump, Verification of positive
    definiteness, BIT 46, 2006). That bound holds for every order of summation, so for blocks, threads and fused
    multiply-add. The proof does not even rest on it: L L' is multiplied out with a bound on its rounding, which also
    holds for every order of summation and covers underflow, gradual or to zero, so a wrong L proves nothing.

    condition: (n, n), with M symmetric. False means undecided: M may have an eigenvalue, relative to its diagonal, below
    about 2 n (n + 4) eps plus what E allows, or an overflow stood in the way.

    Raises DimensionError when it is not square, InvalidInputError when the bounds say that M is not symmetric.

    >>> is_surely_positive(Rounded.lift(np.array([[2.0, 1.0], [1.0, 1.0]])))
    True
    >>> is_surely_positive(Rounded.lift(np.array([[1.0, 1.0], [1.0, 1.0]])))
    False
    """
    with np.errstate(all="ignore"):
        A, E = _scaled(condition)
        if not (np.all(np.isfinite(A)) and np.all(np.isfinite(E)) and np.all(np.diag(A) > 0)):
            return False
        root = np.sqrt(np.diag(A))
        c = 2 * (len(A) + 4) * EPS * root * root.sum() + 1.125 * E.sum(axis=1)
        try:
            L = np.linalg.cholesky(A - np.diag(c))
        except np.linalg.LinAlgError:
            return False
        return _remainder_is_dominant(A, E, L)


def is_surely_not(condition: Rounded) -> bool:
    """Return True only with a proof that a symmetric matrix M, known up to an error bound, is not positive definite.

    The proof is a negative diagonal entry, or a vector x with x'A x + |x|'E |x| < 0, A and E as in
    `is_surely_positive`: then x'M x < 0. x is the eigenvector of the smallest eigenvalue of A as computed; the form
    is evaluated with a bound on its own rounding, so a wrong x proves nothing.

    condition: (n, n), with M symmetric. False means undecided. Raises as `is_surely_positive` does.

    >>> is_surely_not(Rounded.lift(np.array([[1.0, 2.0], [2.0, 1.0]])))
    True
    >>> is_surely_not(Rounded.lift(np.array([[1.0, 1.0], [1.0, 1.0]])))
    False
    """
    with np.errstate(all="ignore"):
        A, E = _scaled(condition)
        if not (np.all(np.isfinite(A)) and np.all(np.isfinite(E))) or A.size == 0:
            return False
        if np.any(np.diag(A) < -np.diag(E)):
            return True
        try:
            x = np.linalg.eigh(A)[1][:, :1]
        except np.linalg.LinAlgError:
            return False
        form = Rounded.lift(x.T) @ (Rounded.lift(A) @ x)
        spread = np.abs(x.T) @ E @ np.abs(x)
        # One per cent, and more than can underflow, for the rounding of `spread` and of this comparison.
        return bool(form.value.item() < -1.01 * (form.error.item() + spread.item()) - FLUSHED * A.size)


def definiteness(condition: Rounded) -> bool | None:
    """Return True when M > 0 is proved, False when the contrary is, and None when rounding leaves it undecided.

    condition: (n, n), with M symmetric. Raises as `is_surely_positive` does.

    >>> [definiteness(Rounded.lift(np.array([[entry]]))) for entry in (1e-200, -1e-200, 0.0)]
    [True, False, None]
    """
    if is_surely_positive(condition):
        return True
    return False if is_surely_not(condition) else None


def _scaled(condition: Rounded) -> tuple[Array, Array]:
    """Return D A D and a bound on |D (M - A) D|, D powers of two, from the lower half of the reading.

    Each entry is scaled once, so that only underflow can round it.
    """
    value, error = condition.value, condition.error
    if value.ndim != 2 or value.shape[0] != value.shape[1]:
        raise DimensionError(f"a matrix inequality needs a square matrix, but the shape is {value.shape}")
    apart = np.abs(value - value.T) > 2 * (error + error.T)
    if np.any(apart):
        i, j = np.argwhere(apart)[0]
        raise InvalidInputError(f"a matrix inequality needs a symmetric matrix, but entry ({i}, {j}) is {value[i, j]:.6g} "
                                f"and entry ({j}, {i}) is {value[j, i]:.6g}")
    half = np.frexp(np.abs(np.diag(value)))[1] // 2
    shift = -(half[:, None] + half[None, :])
    return _mirrored(np.ldexp(value, shift)), _mirrored(np.ldexp(error + FLUSHED, shift) + FLUSHED)


def _mirrored(array: Array) -> Array:
    return np.tril(array) + np.tril(array, -1).T


def _remainder_is_dominant(A: Array, E: Array, L: Array) -> bool:
    """Whether every matrix within E of A, less L L', is strictly diagonally dominant with a positive diagonal."""
    product = Rounded.lift(L) @ Rounded.lift(L.T)
    remainder = A - product.value
    others = np.abs(remainder)
    slack = E + product.error + EPS * others
    np.fill_diagonal(others, 0.0)
    # A sum of n nonnegative numbers, each formed with a few roundings, is too small by less than (n + 8) eps of itself.
    needed = (1 + (len(A) + 8) * EPS) * (others + slack).sum(axis=1)
    return bool(np.all(np.diag(remainder) > needed))


def smallest_eigenvalue(condition: Rounded) -> tuple[float, float]:
    """Return the smallest eigenvalue of D^-1 M D^-1 and a bound on its error; (-inf, 0) after an overflow."""
    value, size, error = condition.value, condition.size, condition.error
    if not np.all(np.isfinite(size)):
        return -np.inf, 0.0
    scale = np.sqrt(np.diag(size))
    scale = np.where(scale > 0, scale, 1.0)
    scaled, room = value / np.outer(scale, scale), error / np.outer(scale, scale)
    rounding = EIGENVALUE_ROUNDING * len(scaled) * np.finfo(float).eps * np.linalg.norm(scaled)
    return float(np.linalg.eigvalsh((scaled + scaled.T) / 2)[0]), float(np.linalg.norm(room) + rounding)


def with_sign(estimate: float, positive: bool) -> float:
    """Return a floating-point estimate of a margin whose sign is known."""
    return max(estimate, np.finfo(float).tiny) if positive else min(estimate, 0.0)
