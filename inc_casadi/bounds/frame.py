"""The functions of the initial state that one move may use, and anchors by which to bound them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array
from .affine_problem import extended, measurement
from .measured import Rows

RANK_TOL = 1e-12  # singular values below this share of the largest are zero


@dataclass(frozen=True, eq=False)
class Frame:
    """The functions E [x; 1] = [R x; 1] that one move is a combination of, and anchors (n, a) by which to bound it.

    The anchors must not be within rounding of a hyperplane without lying on it (`exact_anchors.nearly_flat`).

    >>> Frame(Rows(np.eye(1), 0.0), np.array([[-1.0, 3.0]])).on_anchors(np.array([[2.0, 1.0]])).round(9).tolist()
    [[0.25, 0.75]]
    """

    rows: Rows
    anchors: Array

    @cached_property
    def E(self) -> Array:
        """(r + 1, n + 1)."""
        return measurement(self.rows)

    @cached_property
    def seen(self) -> Array:
        """E [v; 1] of the anchors, (r + 1, a)."""
        return self.E @ extended(self.anchors)

    @cached_property
    def scale(self) -> Array:
        """The largest entry of each row of `seen`, (r + 1, 1), so that units do not decide the rank."""
        scale = np.max(np.abs(self.seen), axis=1, initial=0.0, keepdims=True)
        return np.where(scale > 0, scale, 1.0)

    @cached_property
    def rank(self) -> int:
        """The rank of `seen` as `inverse` takes it."""
        values = np.linalg.svd(self.seen / self.scale, compute_uv=False)
        return int(np.sum(values > RANK_TOL * values[0]))

    @cached_property
    def inverse(self) -> Array:
        """The pseudoinverse (a, r + 1): [Y d] = u(anchors) @ inverse, as far as the anchors tell."""
        return np.linalg.pinv(self.seen / self.scale, rcond=RANK_TOL) / self.scale.T

    @cached_property
    def sizes(self) -> Array:
        """Sums (r + 1,) that bound [Y d] when multiplied by the largest input."""
        return np.sum(np.abs(self.inverse), axis=0)

    def on_anchors(self, M: Array) -> Array:
        """Return N (m, a) with <M, U> = sum_i N_i'u(v_i)."""
        return M @ self.E.T @ self.inverse.T

    def rounding(self, M: Array, reach: Array) -> float:
        """Return the sum of absolute values of what is lost when N is rounded."""
        return float(np.sum(np.abs(self.on_anchors(M)) @ np.abs(self.seen.T) * np.outer(reach, self.sizes)))

    def missed(self, M: Array, reach: Array) -> float:
        """Return how much <M, U> can lie below what the anchors and the rounded row basis see of it."""
        off = np.abs(self.on_anchors(M) @ self.seen.T - M @ self.E.T)
        return float(np.sum(off * np.outer(reach, self.sizes))) + self._unseen(M, reach)

    def _unseen(self, M: Array, reach: Array) -> float:
        R = self.rows.basis
        if self.rows.sine == 0:
            return 0.0
        unseen = M[:, :-1] - M[:, :-1] @ R.T @ R
        return self.rows.sine * float(np.linalg.norm(unseen) * np.linalg.norm(np.outer(reach, self.sizes[:-1])))
