"""Weak duality for moves that are affine in the initial state: a value that no admissible moves can undercut."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array
from ..plant import Plant
from ..sets import Box, Distribution, Ellipsoid, Uniform
from ..spec import Spec
from .affine_problem import Cuts, extended, moment_root
from .exact_anchors import nearly_flat
from .frame import Frame
from .measured import measured_rows
from .moves import UNIT, minorant, rollout
from .occurring import may_occur

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

    @cached_property
    def reach(self) -> Array:
        """The largest size (m,) of each input."""
        assert self.spec.inputs is not None
        return np.max(np.abs(self.spec.inputs.vertices), axis=1)

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
        return NEARLY_FLAT if nearly_flat(self.plant, self.anchors, len(self.moves)) else ""

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
        n = self.plant.n
        x = rollout(self.plant.A, self.plant.B, np.eye(n, n + 1), self.moves) @ L  # as in exact arithmetic: `exact_lower`
        below = minorant(self.plant, spec, spec.Q, x, u, reach @ np.abs(L))
        H, h = spec.inputs.H, spec.inputs.h
        value = float(np.sum(below.state * L[:-1]) - below.offset.sum() - self.multipliers @ h[self.cuts.facet])
        sizes = float(np.sum(np.abs(below.state * L[:-1]))) + float(self.multipliers @ np.abs(h[self.cuts.facet]))
        lost = float(below.slack.sum())
        for k, frame in enumerate(frames):
            mine = self.cuts.move == k
            forces = (self.multipliers[mine] * H[self.cuts.facet[mine]].T, extended(self.cuts.point[:, mine]).T)
            M = below.inputs[k] @ L.T + forces[0] @ forces[1]
            N_k = frame.on_anchors(M)
            value -= float(np.sum(spec.inputs.support(-N_k)))
            if not isinstance(spec.inputs, Box):
                lost += _VERTEX_TOL * float(np.sum(np.abs(N_k) * self.reach[:, None]))
            absolute = np.abs(below.inputs[k]) @ np.abs(L.T) + np.abs(forces[0]) @ np.abs(forces[1])
            sizes += float(np.sum(absolute * reach[k])) + frame.rounding(M, self.reach)
            lost += frame.missed(M, self.reach)
        terms = n + self.multipliers.size + 16 + _moment_rounding(spec.initial)
        return value, lost + 4 * UNIT * terms * (sizes + abs(value))


def _moment_rounding(initial: Distribution) -> float:
    # By how many units the covariance may be off, relative to itself: an ellipsoid's is an inverse.
    support = initial.support
    if isinstance(initial, Uniform) and isinstance(support, Ellipsoid):
        return support.dimension * float(np.linalg.cond(support.P))
    return 0.0
