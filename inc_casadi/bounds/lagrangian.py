"""Weak duality for moves that are affine in the initial state: a value that no admissible moves can undercut."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array
from ..plant import Plant
from ..sets import Box
from ..spec import Spec
from .affine_problem import Cuts, extended, moment_root
from .exact_anchors import nearly_flat
from .frame import Frame
from .measured import measured_rows
from .moves import UNIT, minorant, rollout
from .occurring import may_occur
from .tied import hidden_states, spans_everything, tying_forces
from .value_iteration import moment_rounding

NEARLY_FLAT = ("the initial states lie within rounding of a hyperplane, but not on it, so that moves of gains beyond 1e12 "
               "tell them apart: describe them in fewer coordinates, or round them onto it")
_VERTEX_TOL = 1e-12  # relative error of the vertices of a polytope of inputs, which Qhull computes


@dataclass(frozen=True, eq=False)
class Lagrangian:
    """The Lagrangian of the program over affine moves at trial moves and multipliers; fields as `AffineMovesBound`."""

    plant: Plant
    spec: Spec
    moves: Array
    cuts: Cuts
    multipliers: Array
    anchors: Array
    ties: Array | None = None

    @cached_property
    def reach(self) -> Array:
        """The largest size (m,) of each input."""
        assert self.spec.inputs is not None
        return np.max(np.abs(self.spec.inputs.vertices), axis=1)

    @cached_property
    def hidden(self) -> np.ndarray:
        """The states that one measurement does not show, (n, q) Fractions."""
        return hidden_states(self.plant)

    @property
    def trouble(self) -> str:
        """What is wrong with the stored numbers, in words, or nothing: shapes, signs, points that may not occur.

        Any numbers that pass prove something, however low.
        """
        spec, cuts = self.spec, self.cuts
        assert spec.inputs is not None
        count, n, m = self.multipliers.size, spec.n, spec.m
        shapes = (cuts.move.shape, cuts.facet.shape, cuts.point.shape, self.moves.shape[1:], self.anchors.shape[:1])
        if shapes != ((count,), (count,), (n, count), (m, n + 1), (n,)):
            return f"cuts, moves or anchors do not fit {count} multipliers, {n} states and {m} inputs"
        if not (np.all(np.isfinite(self.moves)) and np.all(np.isfinite(self.multipliers))):
            return "a move or a multiplier is not finite"
        if np.any(self.multipliers < 0):
            return "a multiplier is negative"
        for name, index, size in (("move", cuts.move, len(self.moves)), ("half-space", cuts.facet, len(spec.inputs.h))):
            if np.any((index < 0) | (index >= size)):
                return f"a cut names a {name} that does not exist"
        if not may_occur(spec.initial, np.hstack([cuts.point, self.anchors])):
            return "a point of a cut or an anchor is not an initial state that may occur"
        return self._tied_wrongly or (NEARLY_FLAT if nearly_flat(self.plant, self.anchors, len(self.moves)) else "")

    @property
    def _tied_wrongly(self) -> str:
        if self.ties is None:
            return ""
        if self.ties.shape != (*self.moves.shape[:2], self.hidden.shape[1]) or not np.all(np.isfinite(self.ties)):
            return f"the ties are not finite numbers for {len(self.moves)} moves and {self.hidden.shape[1]} hidden states"
        return "" if spans_everything(self.anchors) else "moves are tied, but the anchors lie in a hyperplane"

    def lower(self) -> tuple[float, float]:
        """Return min over moves within the limits of the minorant of the cost plus multipliers times cuts.

        cost >= const + sum_k <M_k, U_k>, where M_k collects the slopes and the multipliers of cuts and ties. With anchors
        v_i and M_k E_k' = N_k (E_k [V; 1])', where u_k(v_i) = U_k [v_i; 1] and U_k = [Y_k d_k] E_k,
        <M_k, U_k> = sum_i N_k,i'u_k(v_i) >= -sum_i max over the limits of -N_k,i'u.
        """
        spec, L, N = self.spec, moment_root(self.spec.initial), len(self.moves)
        assert spec.inputs is not None
        frames = [Frame(rows, self.anchors) for rows in measured_rows(self.plant, N)]
        reach = np.stack([np.outer(self.reach, frame.sizes @ np.abs(frame.E)) for frame in frames])
        u = self.moves @ L
        n = self.plant.n
        x = rollout(self.plant.A, self.plant.B, np.eye(n, n + 1), self.moves) @ L  # as in exact arithmetic: `exact_lower`
        below = minorant(self.plant, spec, spec.Q, x, u, reach @ np.abs(L))
        h = spec.inputs.h[self.cuts.facet]
        value = float(np.sum(below.state * L[:-1]) - below.offset.sum() - self.multipliers @ h)
        forces, absolute = self.forces(below.inputs, L)
        sizes = float(np.sum(np.abs(below.state * L[:-1])) + self.multipliers @ np.abs(h) + np.sum(absolute * reach))
        lost = float(below.slack.sum())
        for M, frame in zip(forces, frames, strict=True):
            N_k = frame.on_anchors(M)
            value -= float(np.sum(spec.inputs.support(-N_k)))
            if not isinstance(spec.inputs, Box):
                lost += _VERTEX_TOL * float(np.sum(np.abs(N_k) * self.reach[:, None]))
            sizes += frame.rounding(M, self.reach)
            lost += frame.missed(M, self.reach)
        terms = n + self.multipliers.size + 16 + moment_rounding(spec.initial)
        terms += 0 if self.ties is None else n + self.hidden.shape[1]
        return value, lost + 4 * UNIT * terms * (sizes + abs(value))

    def forces(self, slopes: Array, L: Array) -> tuple[Array, Array]:
        """Return M (N, m, n + 1) from the slopes (N, m, s), and the sums of absolute values of what is added up in it.

        Hidden states rounded to floats are off by one unit of theirs, as a sum of one more term would be.
        """
        assert self.spec.inputs is not None
        M, sizes = slopes @ L.T, np.abs(slopes) @ np.abs(L.T)
        for k in range(len(M)):
            mine = self.cuts.move == k
            pushes = self.multipliers[mine] * self.spec.inputs.H[self.cuts.facet[mine]].T
            points = extended(self.cuts.point[:, mine]).T
            M[k] += pushes @ points
            sizes[k] += np.abs(pushes) @ np.abs(points)
        if self.ties is not None:
            A, Z = self.plant.A, self.hidden.astype(float)
            M[:, :, :-1] += tying_forces(self.ties, Z, A)
            sizes[:, :, :-1] += tying_forces(np.abs(self.ties), np.abs(Z), -np.abs(A))
        return M, sizes


