"""How the states and inputs of a rollout answer every parameter of the law, and the Gauss-Newton Hessian of its cost.

Sensitivities run forward in time with the rollout; parts are laid out as (size, N, P), P parameters last, so that a
matrix acts on them as one product and a Gram matrix is one symmetric product.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from inc_casadi.arrays import Array

from .rollout import Motion, Parameters, Scenario, linearized, sensitivity


def gauss_newton(scenario: Scenario, law: Parameters, motion: Motion) -> Array:
    """Return 2 sum_k discount^k E[X_k'Q X_k + U_k'R U_k] + (terminal), the positive semidefinite part of J's Hessian.

    X_k, U_k are the sensitivities of state and input to the P entries of W, U, V, K, b, d, each row by row.
    Active half-spaces add their share. What is left out is the curvature of the motion itself, weighted by the slope of
    the stage cost. Shape (P, P).
    """
    factors = [_root(weight) for weight in (scenario.Q, scenario.R, scenario.terminal)]
    H: Array = np.zeros(())
    for k, (X, U) in enumerate(_sensitivities(scenario, law, motion)):
        weight = np.sqrt(2.0 * scenario.discount**k * scenario.weights)[:, None]
        rows = _combined(factors[0 if k < scenario.steps else 2], X) * weight
        H = H + _gram(rows)
        if U is not None:
            H = H + _gram(_combined(factors[1], U) * weight)
            if scenario.h.size:
                share = 2.0 * scenario.penalty / scenario.weights.size * scenario.discount**k
                active = np.sqrt(share) * (scenario.excess(motion.u[k]) > 0.0)
                H = H + _gram(_combined(scenario.H, U) * active.T[:, :, None])
    return H


def _sensitivities(scenario: Scenario, law: Parameters, motion: Motion) -> Iterator[tuple[Array, Array | None]]:
    """Yield dx_k/d(parameters) (n, N, P) and du_k/d(parameters) (m, N, P) forward in time; None for u at the end."""
    S, free, gain = linearized(scenario, law, motion)
    offset: Array = np.zeros(())
    if scenario.anchored:
        at_origin = sensitivity(law, motion.origin_slope[None])
        offset = _explicit(at_origin, motion.origin_eta[None], np.zeros((1, scenario.C.shape[0])))
    X: Array | None = None
    for k in range(scenario.steps):
        U = (_explicit(S[k], motion.eta[k], motion.x[k] @ scenario.C.T) - offset) * free[k].T[:, :, None]
        if X is None:
            X = np.zeros((scenario.A.shape[0], *U.shape[1:]))
        for i, j in np.ndindex(*gain.shape[2:]):
            U[i] += gain[k, :, i, j, None] * X[j]
        yield X, U
        X = _combined(scenario.A, X) + _combined(scenario.B, U)
    assert X is not None
    yield X, None


def _explicit(S: Array, eta: Array, y: Array) -> Array:
    """dv/d(W, U, V, K, b, d) at fixed y, (m, N, P): the rows of W and U act through S, those of V and K directly."""
    N, m, q = S.shape
    through = np.swapaxes(S, 0, 1)
    ones = np.broadcast_to(np.eye(m)[:, None, :], (m, N, m))
    blocks = [(through, eta), (through, y), (ones, eta), (ones, y)]
    products = [(left[..., None] * right[None, :, None, :]).reshape(m, N, -1) for left, right in blocks]
    return np.concatenate([*products, through, ones], axis=2)


def _combined(matrix: Array, parts: Array) -> Array:
    """matrix (a, c) times parts (c, N, P) along the first axis, as one product of two matrices."""
    return (matrix @ parts.reshape(parts.shape[0], -1)).reshape(-1, *parts.shape[1:])


def _gram(parts: Array) -> Array:
    rows = parts.reshape(-1, parts.shape[2])
    return rows.T @ rows


def _root(weight: Array) -> Array:
    """Return L' with L L' = weight, for weight >= 0, without the rows that are zero."""
    values, vectors = np.linalg.eigh(weight)
    kept = values > 1e-14 * np.max(np.abs(values), initial=0.0)
    return np.sqrt(values[kept])[:, None] * vectors[:, kept].T
