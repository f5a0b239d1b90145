"""Sums along a stable linear motion by repeated squaring, and matrices that bound them for certain."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import Array

DOUBLINGS = 64
_ROOM = 10.0 ** np.arange(-13, -5)  # shares of its diagonal by which the matrix is raised until the bound can be proved


def discounted_sum(A: Array, stage: Array, discount: float = 1.0) -> Array | None:
    """Return P = sum_k discount^k (A^k)' stage A^k, or None when sqrt(discount) A is not stable.

    R. A. Smith's doubling: with P_j the sum of 2^j terms, P_{j+1} = P_j + M_j'P_j M_j and M_{j+1} = M_j^2, from
    M_0 = sqrt(discount) A. It keeps P positive semidefinite and does not mind a nilpotent A, of which shift registers
    are made. After 2^64 terms that do not die out, A is called unstable.

    Parameters
    ----------
    A : (n, n)
    stage : (n, n) symmetric positive semidefinite
    discount : in (0, 1]

    >>> discounted_sum(np.array([[0.5]]), np.eye(1)).round(6).tolist(), discounted_sum(np.eye(1), np.eye(1))
    ([[1.333333]], None)
    """
    M, P = np.sqrt(discount) * A, np.asarray(stage, dtype=float)
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        for _ in range(DOUBLINGS):
            P = P + M.T @ P @ M
            M = M @ M
            if not np.all(np.isfinite(P)) or not np.all(np.isfinite(M)):
                return None
            if np.max(np.abs(M), initial=0.0) < 1e-160:
                return (P + P.T) / 2
    return None


def bounding_sum(A: Array, stage: Array, discount: float, is_proved: Callable[[Array], bool]) -> Array | None:
    """Return the smallest P tried with P - discount A'P A - stage > 0 for certain, or None.

    P is the sum itself plus a share of 1e-13, 1e-12, ... 1e-6 of the sum of D, D the diagonal of the sum with its zeros
    filled: by the same share the inequality is strict, and the first share that outweighs rounding is taken.

    Parameters
    ----------
    is_proved : decides the inequality and P > 0 with rounding accounted for

    >>> P = bounding_sum(np.array([[0.5]]), np.eye(1), 1.0, lambda P: bool(0.75 * P[0, 0] > 1 + 1e-12))
    >>> bool(4 / 3 < P[0, 0] < 4 / 3 + 1e-11)
    True
    """
    P = discounted_sum(A, stage, discount)
    if P is None:
        return None
    diagonal = np.diag(P)
    filled = np.maximum(diagonal, 1e-3 * np.mean(diagonal) or 1.0)
    raised = discounted_sum(A, np.diag(filled), discount)
    if raised is None:
        return None
    return next((P + room * raised for room in _ROOM if is_proved(P + room * raised)), None)
