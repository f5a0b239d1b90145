"""The ties between moves as rows of a quadratic program, and back from its dual numbers to their multipliers."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arrays import Array
from ..plant import Plant


def tying_rows(plant: Plant, hidden: Array, F: Array, damping: Array, sparse: Any) -> list[list[Any]]:
    """Return N rows of 2 N blocks that say (G_k F_x - s_k / s_{k-1} G_{k-1} F_x A) Z V = 0; none without hidden states.

    They are (Y_k - Y_{k-1} A) Z = 0 for Y_k = G_k F_x / s_k, s the damping, made well conditioned: V as in `untangled`.

    hidden : Z (n, q); F = [F_x, f] (r, n + 1); damping : (N + 1,); sparse : scipy.sparse. The coefficients G_k (m, r) are in
    block N + k, row by row.
    """
    if not hidden.shape[1]:
        return []
    N, each = len(damping) - 1, sparse.eye_array(plant.m)
    Z = hidden @ _evened(hidden, F)
    now, before = (sparse.kron(each, (F[:, :-1] @ states).T) for states in (Z, plant.A @ Z))
    grid: list[list[Any]] = [[None] * (2 * N) for _ in range(N)]
    for k in range(N):
        grid[k][N + k] = now
        if k:
            grid[k][N + k - 1] = -damping[k] / damping[k - 1] * before
    return grid


def untangled(hidden: Array, F: Array, dual: Array) -> Array:
    """Return the multipliers (N, m, q) of equations E_k Z = 0 from those of E_k Z V = 0: <L, E Z V> = <L V', E Z>.

    The columns of F_x Z V are orthonormal.

    >>> untangled(np.array([[0.0], [2.0]]), np.eye(3), np.array([[[3.0]]])).round(9).tolist()
    [[[1.5]]]
    """
    return dual @ _evened(hidden, F).T if hidden.shape[1] else dual


def _evened(hidden: Array, F: Array) -> Array:
    # V (q, q), or its nearest kin should F not tell the hidden states apart.
    shown = F[:, :-1] @ hidden
    sizes = np.linalg.norm(shown, axis=0)
    sizes = np.where(sizes > 0, sizes, 1.0)
    _, values, Vt = np.linalg.svd(shown / sizes, full_matrices=False)
    kept = values > 1e-12 * values[0]
    return np.where(kept, Vt.T / np.where(kept, values, 1.0), 0.0) / sizes[:, None]
