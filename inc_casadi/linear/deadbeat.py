"""The observer that is exact after as few measurements as possible."""

from __future__ import annotations

import numpy as np

from ..arrays import Array

_NEGLIGIBLE = 1e-9  # singular values below this share of the largest are zero


def deadbeat_observer(A: Array, C: Array) -> Array:
    """Return L (n, p) such that C (A - L C)^k = 0 from the observability index on: nothing is left to be measured.

    The error e_{k+1} = (A - L C) e_k dies out in all that is observable, and the modes that are not go their own way.
    Found for the dual, u = F x that brings x+ = A'x + C'u to the origin soonest: V_0 = 0, V_i = {x: A'x + C'u in V_{i-1}
    for some u}; each new direction of V_i gets the least such u.

    Parameters
    ----------
    A : (n, n); C : (p, n)

    Notes
    -----
    Source: the geometric construction of minimum-time control. Ranks are judged to 1e-9 relative; a wrong one makes
    an observer that is not deadbeat, and nothing false.

    >>> A, C = np.array([[1.1, 1.0], [0.0, 0.9]]), np.array([[1.0, 0.0]])
    >>> L = deadbeat_observer(A, C)
    >>> np.abs(np.linalg.matrix_power(A - L @ C, 2)).round(9).tolist()
    [[0.0, 0.0], [0.0, 0.0]]
    """
    n, p = A.shape[0], C.shape[0]
    sizes = np.linalg.norm(C, axis=1)
    factor = (float(np.linalg.norm(A, 2)) or 1.0) / np.where(sizes > 0, sizes, 1.0)
    scaled = factor[:, None] * C  # so that neither the units of a measurement nor those of time decide a rank
    V, F = np.zeros((n, 0)), np.zeros((p, n))
    for _ in range(n):
        outside = np.eye(n) - V @ V.T
        reaching = _kernel(outside @ np.hstack([A.T, scaled.T]))
        new = _directions(outside @ reaching[:n])
        if not new.shape[1]:
            break
        least = -np.linalg.pinv(outside @ scaled.T, rcond=_NEGLIGIBLE) @ outside @ A.T @ new
        F, V = F + least @ new.T, np.hstack([V, new])
    return -(F.T * factor)


def _kernel(M: Array) -> Array:
    _, sizes, right = np.linalg.svd(M)
    rank = int(np.sum(sizes > _NEGLIGIBLE * max(float(sizes[0]), 1e-300)))
    return right[rank:].T


def _directions(X: Array) -> Array:
    left, sizes, _ = np.linalg.svd(X, full_matrices=False)
    return left[:, sizes > _NEGLIGIBLE]
