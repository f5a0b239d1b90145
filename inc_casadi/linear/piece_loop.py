"""The loop of a plant and a law on its affine piece, with the outputs that must stay within limits for it to be one."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from math import inf, nextafter
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..blocks import exact, hstack, vstack
from ..exact import solve
from ..inc import INC
from ..output_range import within_limits
from ..plant import Plant
from ..readings import EPS, Rounded
from ..spec import Spec
from .linear_piece import Ends, LinearPiece, linear_piece


class Half(NamedTuple):
    """Half-spaces H r <= h of the outputs r: H (f, r), h (f,), all positive."""

    H: Array
    h: Array

    @property
    def dimension(self) -> int:
        """The number of outputs."""
        return self.H.shape[1]


class Matrices(NamedTuple):
    """e+ = F e, the limited outputs G e, and for the cost s+ = step s with stage cost s'Q s + (inputs s)'R (inputs s)."""

    F: Any
    G: Any
    step: Any
    inputs: Any


@dataclass(frozen=True, eq=False)
class PieceLoop:
    """x+ = A x + B (u_0 + K C x) about its rest x*, with outputs that must stay within limits for it to be the loop.

    With e = x - x*, e+ = F e, F = A + B K C, and the outputs O e, O = rows C, are what must keep the facets. For the cost
    s = x, or s = (x, 1) where u_0 is not zero.

    plant, spec; K (m, p), u_0 (m,), rest (n,), rows (r, p): Fractions; facets: H rows +-1, h rounded down; names: of what
    happens where a facet is left; D (r, r): diag(1 / l_i^2) rounded up, l_i the nearer of the limits of an output. low, high
    (r,): how far each output may go down and up, rounded inward; units: the hidden units that the first outputs are
    pre-activations of; slopes: theirs on the piece.
    """

    plant: Plant
    spec: Spec
    K: np.ndarray = field(repr=False)
    u_0: np.ndarray = field(repr=False)
    rest: np.ndarray = field(repr=False)
    rows: np.ndarray = field(repr=False)
    facets: Half
    names: tuple[str, ...]
    D: Array = field(repr=False)
    low: Array = field(repr=False)
    high: Array = field(repr=False)
    units: tuple[int, ...]
    slopes: Array = field(repr=False)

    @property
    def biased(self) -> bool:
        """Whether u_0 is not zero, so that the loop rests beside the origin."""
        return any(self.u_0)

    def read(self, kind: Any) -> Matrices:
        """Return the matrices of the loop in another arithmetic, formed anew from the stored numbers."""
        return self._rounded if kind is Rounded else self._read(kind)

    @cached_property
    def _rounded(self) -> Matrices:
        return self._read(Rounded)

    def _read(self, kind: Any) -> Matrices:
        A, B, C = (kind.lift(part) for part in (self.plant.A, self.plant.B, self.plant.C))
        G = kind.lift(self.K) @ C
        F, outputs = A + B @ G, kind.lift(self.rows) @ C if len(self.rows) else kind.lift(np.zeros((0, self.plant.n)))
        if not self.biased:
            return Matrices(F, outputs, F, G)
        u_0, n = kind.lift(self.u_0[:, None]), self.plant.n
        step = vstack(hstack(F, B @ u_0), kind.lift(np.eye(1, n + 1, n)))
        return Matrices(F, outputs, step, hstack(G, u_0))

    @cached_property
    def Q(self) -> Array:
        """The weight of s: Q, or Q with a zero for the 1."""
        Q = np.zeros((self.plant.n + self.biased,) * 2)
        Q[: self.plant.n, : self.plant.n] = self.spec.Q
        return Q

    @cached_property
    def moment(self) -> Array:
        """E s s'."""
        initial = self.spec.initial
        if not self.biased:
            return initial.second_moment
        return np.block([[initial.second_moment, initial.mean[:, None]], [initial.mean[None, :], np.ones((1, 1))]])

    @cached_property
    def stage(self) -> Array:
        """The stage cost of s in floats."""
        G = self._rounded.inputs.value
        return self.Q + G.T @ self.spec.R @ G


def piece_loop(plant: Plant, spec: Spec, inc: INC) -> PieceLoop | str:
    """Return the loop on the affine piece around y = 0, or in words why there is none.

    >>> from inc_casadi import Box
    >>> loop = piece_loop(Plant(1.5, 1.0), Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-1, 1)), INC.linear([[-1.0]]))
    >>> loop.stage.tolist(), loop.facets.h.tolist(), loop.names[0]
    ([[1.0]], [1.0, 1.0], 'an input leaves facet 0 of its limits')
    """
    piece = linear_piece(inc)
    if isinstance(piece, str):
        return piece
    if any(piece.u_0) and spec.discount == 1:
        offset = float(piece.u_0[piece.u_0 != 0][0])
        return f"u = {offset:.6g} at y = 0, and without discount the least offset costs without end"
    rest = _rest(plant, piece)
    if rest is None:
        return "on its piece it rests nowhere, or at more than one point"
    rows, ends, names = piece.Z, piece.room, [f"unit {i} leaves its affine piece" for i in range(len(piece.room))]
    if spec.inputs is not None and not within_limits(inc, spec.inputs):
        H = exact(spec.inputs.H)
        rows = np.vstack([rows, H @ piece.K])
        ends = ends + [(None, limit) for limit in exact(spec.inputs.h) - H @ piece.u_0]
        names += [f"an input leaves facet {i} of its limits" for i in range(len(H))]
    at_rest = rows @ (exact(plant.C) @ rest)
    ends = [(None if low is None else low - value, None if high is None else high - value)
            for (low, high), value in zip(ends, at_rest, strict=True)]
    outside = [i for i, (low, high) in enumerate(ends) if low is not None and low >= 0 or high is not None and high <= 0]
    if outside:
        return f"where the loop would rest, {names[outside[0]]}, or is at its end"
    return _limited(plant, spec, piece, rest, rows, ends, names)


def _rest(plant: Plant, piece: LinearPiece) -> np.ndarray | None:
    """x* = (I - A - B K C)^-1 B u_0."""
    if not any(piece.u_0):
        return exact(np.zeros(plant.n))
    A, B, C = (exact(part) for part in (plant.A, plant.B, plant.C))
    return solve(exact(np.eye(plant.n)) - A - B @ piece.K @ C, B @ piece.u_0)


def _limited(plant: Plant, spec: Spec, piece: LinearPiece, rest: np.ndarray, rows: np.ndarray, ends: Ends,
             names: list[str]) -> PieceLoop:
    used = [i for i, pair in enumerate(ends) if pair != (None, None)]
    low = np.array([inf if ends[i][0] is None else _below(-ends[i][0]) for i in used])  # type: ignore[operator]
    high = np.array([inf if ends[i][1] is None else _below(ends[i][1]) for i in used])
    eye, top, bottom = np.eye(len(used)), np.isfinite(high), np.isfinite(low)
    facets = Half(np.vstack([eye[top], -eye[bottom]]), np.concatenate([high[top], low[bottom]]))
    words = np.array([names[i] for i in used], dtype=object)
    D = np.diag((1 + 4 * EPS) / np.minimum(low, high) ** 2)
    units = [i for i in used if i < len(piece.room)]
    return PieceLoop(plant, spec, piece.K, piece.u_0, rest, rows[used], facets, (*words[top], *words[bottom]), D, low, high,
                     tuple(units), piece.slopes[units])


def _below(limit: Fraction | None) -> float:
    """The last float at most a positive Fraction."""
    assert limit is not None
    nearest = float(limit)
    return nearest if Fraction(nearest) <= limit else nextafter(nearest, 0.0)
