"""Trial moves whose motion stays near the one the solver found, however unstable the plant."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..plant import Plant
from ..spec import Spec


def steadied(plant: Plant, spec: Spec, root: Array, moves: Array, motion: Array) -> Array:
    """Return moves U_k + K_k (X_k - X~_k), X the motion under them and X~ the one found, which may depart from it.

    Both hold to the solver's tolerance, but X_k, rolled out from U alone, would be off by A^k times that, and the tangent
    of the cost would be taken far from the minimum. K_k: a Riccati recursion, so that the difference dies out. Any moves
    prove a bound; these prove a higher one over long horizons.

    root : L (n + 1, s); moves : U (N, m, n + 1); motion : X~_k L for k = 1..N, (N, n, s)

    >>> from inc_casadi import Box
    >>> plant, spec = Plant(2.0, 1.0), Spec(1.0, 0.0, 1.0, Box(-1, 1), Box(-1, 1))
    >>> moves, motion = np.array([[[-2.001, 0.0]], [[0.0, 0.0]]]), np.zeros((2, 1, 2))
    >>> steadied(plant, spec, np.eye(2), moves, motion).round(3).tolist()
    [[[-2.001, 0.0]], [[0.002, 0.0]]]
    """
    back, x = np.linalg.pinv(root), root[:-1]
    near = np.concatenate([x[None], motion])
    gains, found = _gains(plant, spec, len(moves)), moves.copy()
    for k in range(len(moves)):
        found[k] += gains[k] @ (x - near[k]) @ back
        x = plant.A @ x + plant.B @ (found[k] @ root)
    return found


def _gains(plant: Plant, spec: Spec, N: int) -> Array:
    assert spec.inputs is not None
    A, B, n = plant.A, plant.B, plant.n
    Q = spec.Q + 1e-3 * (np.trace(spec.Q) / n or 1.0) * np.eye(n)
    units = np.max(np.abs(spec.inputs.vertices), axis=1)
    R = spec.R + 1e-3 * np.diag(np.trace(B.T @ Q @ B * np.outer(units, units)) / units**2)
    P, gains = Q, np.empty((N, plant.m, n))
    for k in range(N - 1, -1, -1):
        gains[k] = -np.linalg.pinv(R + B.T @ P @ B, hermitian=True) @ B.T @ P @ A
        P = Q + A.T @ P @ (A + B @ gains[k])
        P = (P + P.T) / 2
    return gains
