"""Is the fixed point eta = phi(W eta + c) unique for every c, and how steep is the controller (thm:wellposed)?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arrays import Array


@dataclass(frozen=True, eq=False)
class WellPosedness:
    """The Perron-Frobenius test of thm:wellposed with its Lipschitz bounds. Sufficient, not necessary.

    With S the diagonal of the units' largest absolute slopes, |phi(r) - phi(s)| <= S |r - s|. If
    lambda_pf(S |W|) < 1, the fixed point is unique for every c, because eta -> phi(W eta + c) contracts in the
    norm max_i |eta_i| / v_i for any v > 0 with S |W| v < v; and
    |eta(y1) - eta(y2)| <= (I - S|W|)^{-1} S |U| |y1 - y2|, |u(y1) - u(y2)| <= (|K| + |V| (I - S|W|)^{-1} S|U|) |y1 - y2|.
    For S = I these are eq:pf_condition, eq:hidden_lipschitz and eq:controller_lipschitz.

    radius: lambda_pf(S |W|). norm: ||S W||_inf. weights: v (q,), with `rate` = max_i (S|W| v)_i / v_i < 1 when it holds.
    hidden_lipschitz (q, p) and lipschitz (m, p): the bounds above, infinite when the test fails.
    """

    radius: float
    norm: float
    weights: Array
    rate: float
    hidden_lipschitz: Array
    lipschitz: Array

    @property
    def holds(self) -> bool:
        """Whether the weights prove the contraction: S |W| v < v in every component."""
        return self.rate < 1.0

    @property
    def test(self) -> str:
        """The test that decided, in words."""
        if self.norm < 1.0:
            return f"infinity norm {self.norm:.6g} < 1 (Perron-Frobenius radius {self.radius:.6g})"
        relation = "<" if self.holds else ">="
        return f"Perron-Frobenius radius {self.radius:.6g} {relation} 1"


def perron_frobenius(W: Array, U: Array, V: Array, K: Array, slope: Array) -> WellPosedness:
    """Return the test of thm:wellposed for one controller.

    W (q, q), U (q, p), V (m, q), K (m, p); slope (q,): the units' largest absolute slopes.

    >>> test = perron_frobenius(np.array([[0.5]]), np.eye(1), np.eye(1), np.zeros((1, 1)), np.ones(1))
    >>> test.holds, test.radius, test.lipschitz.tolist()
    (True, 0.5, [[2.0]])
    """
    q, p = U.shape
    M = slope[:, None] * np.abs(W)
    radius = float(np.max(np.abs(np.linalg.eigvals(M)), initial=0.0))
    norm = float(np.max(M.sum(axis=1), initial=0.0))
    weights, rate = _contraction_weights(M, radius)
    hidden = np.full((q, p), np.inf)
    if rate < 1.0:
        hidden = np.linalg.solve(np.eye(q) - M, slope[:, None] * np.abs(U))
    outer = np.abs(K) + np.abs(V) @ hidden if rate < 1.0 else np.full(K.shape, np.inf)
    return WellPosedness(radius, norm, weights, rate, hidden, outer)


def _contraction_weights(M: Array, radius: float) -> tuple[Array, float]:
    """Weights v > 0 that make max (M v)_i / v_i small: v = (c I - M)^{-1} 1 with c just above lambda_pf(M)."""
    q = M.shape[0]
    if q == 0:
        return np.ones(0), 0.0
    best = np.ones(q), float(M.sum(axis=1).max())
    for level in (radius + 1e-3 * (1.0 - radius), 0.5 * (1.0 + radius), 1.0):
        if level <= radius or radius >= 1.0:
            continue
        v = np.linalg.solve(level * np.eye(q) - M, np.ones(q))
        if np.all(v > 0) and np.all(np.isfinite(v)):
            v = v / v.max()
            rate = float(np.max((M @ v) / v))
            best = min(best, (v, rate), key=lambda pair: pair[1])
    return best
