"""Weak duality for moves that are affine in the initial state: a value that no admissible moves can undercut."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array
from ..plant import Plant
from ..spec import Spec
from .affine_problem import Cuts, extended, measurement, moment_root
from .measured import Rows, measured_rows
from .moves import UNIT, minorant, rollout


@dataclass(frozen=True, eq=False)
class Lagrangian:
    """The Lagrangian of the program over affine moves at trial moves and multipliers; fields as `AffineMovesBound`."""

    plant: Plant
    spec: Spec
    moves: Array
    cuts: Cuts
    multipliers: Array
    anchors: Array

    @cached_property
    def reach(self) -> Array:
        """The largest size (m,) of each input."""
        assert self.spec.inputs is not None
        return np.max(np.abs(self.spec.inputs.vertices), axis=1)

    def lower(self) -> tuple[float, float]:
        """Return min over moves within the limits of the minorant of the cost plus multipliers times cuts.

        cost >= const + sum_k <M_k, U_k>, where M_k collects the slopes and the cuts' multipliers. With anchors v_i and
        M_k E_k' = N_k (E_k [V; 1])', where u_k(v_i) = U_k [v_i; 1] and U_k = [Y_k d_k] E_k,
        <M_k, U_k> = sum_i N_k,i'u_k(v_i) >= -sum_i max over the limits of -N_k,i'u.
        """
        spec, L, N = self.spec, moment_root(self.spec.initial), len(self.moves)
        assert spec.inputs is not None
        frames = [Frame(rows, self.anchors) for rows in measured_rows(self.plant, N)]
        reach = np.stack([np.outer(self.reach, frame.sizes @ np.abs(frame.E)) for frame in frames])
        u = self.moves @ L
        x = rollout(self.plant.A, self.plant.B, L[:-1], u)
        below = minorant(self.plant, spec, spec.Q, x, u, reach @ np.abs(L))
        H, h = spec.inputs.H, spec.inputs.h
        value = float(np.sum(below.state * L[:-1]) - below.offset.sum() - self.multipliers @ h[self.cuts.facet])
        sizes = float(np.sum(np.abs(below.state * L[:-1]))) + float(self.multipliers @ np.abs(h[self.cuts.facet]))
        lost = float(below.slack.sum())
        for k, frame in enumerate(frames):
            mine = self.cuts.move == k
            forces = (self.multipliers[mine] * H[self.cuts.facet[mine]].T, extended(self.cuts.point[:, mine]).T)
            M = below.inputs[k] @ L.T + forces[0] @ forces[1]
            value -= float(np.sum(spec.inputs.support(-frame.on_anchors(M))))
            absolute = np.abs(below.inputs[k]) @ np.abs(L.T) + np.abs(forces[0]) @ np.abs(forces[1])
            sizes += float(np.sum(absolute * reach[k])) + frame.rounding(M, self.reach)
            lost += frame.missed(M, self.reach)
        return value, lost + 4 * UNIT * (self.plant.n + self.multipliers.size + 16) * (sizes + abs(value))


@dataclass(frozen=True, eq=False)
class Frame:
    """The functions E [x; 1] = [R x; 1] that one move is a combination of, and anchors (n, a) by which to bound it."""

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
    def inverse(self) -> Array:
        """The pseudoinverse (a, r + 1): [Y d] = u(anchors) @ inverse."""
        # Rows are scaled first, so that units do not decide the rank.
        scale = np.max(np.abs(self.seen), axis=1, initial=0.0, keepdims=True)
        scale = np.where(scale > 0, scale, 1.0)
        return np.linalg.pinv(self.seen / scale, rcond=1e-12) / scale.T

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
