"""Which gains keep the input limits: half-spaces at the first move, and on small boxes of gains at later ones too."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..linear.gain_search import ADMISSIBLE_TOL
from ..sets import Box, Distribution, Ellipsoid
from ..sets.farthest import farthest
from .gain_algebra import Gains
from .gain_coordinates import balanced
from .gain_floor import Floor
from .gain_halfspaces import HalfSpaces
from .gain_later_moves import later_moves
from .moves import UNIT
from .occurring import drawn_in

_KEPT = 12  # half-spaces that are looked at in each box
_LISTED, _LATER, _DIRECTIONS = 512, 64, 128  # points that count at the first move, at later ones; directions for others


@dataclass(frozen=True, eq=False)
class GainLimits:
    """The gains F with H_u F C A_F^k v <= h_u for the initial states v in `points` and all k <= moves.

    points : (n, a) initial states that may occur; moves : 0 for the first move alone
    T : (n, n), x = T z: coordinates in which costs are bounded, or None; any invertible matrix will do

    The limits are widened by 1e-9 of their size, by which `best_static_gain` may exceed them too, and which covers the
    rounding of the rows.
    """

    gains: Gains
    points: Array
    moves: int
    T: Array | None = None

    @cached_property
    def inner(self) -> Gains:
        """The gains in the coordinates T."""
        return Gains(self.gains.plant, self.gains.spec, self.T)

    @cached_property
    def floor(self) -> Floor:
        """The convex lower bound on what all gains cost."""
        return Floor(self.gains)

    @cached_property
    def pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Facet (k,) and point (k,) of each half-space of the first move; of equal ones one stays."""
        inputs, d = self.gains.spec.inputs, self.gains.d
        if inputs is None:
            return np.zeros(0, dtype=int), np.zeros(0, dtype=int)
        rows = np.einsum("fm,pa->famp", inputs.H, self.gains.plant.C @ self.points).reshape(-1, d)
        bounds = np.repeat(self.widened, self.points.shape[1])
        _, kept = np.unique(np.column_stack([rows, bounds]), axis=0, return_index=True)
        return kept // self.points.shape[1], kept % self.points.shape[1]

    @cached_property
    def first(self) -> tuple[Array, Array]:
        """The half-spaces rows (k, d) vec F <= bounds (k,) of the first move."""
        facets, points = self.pairs
        if self.gains.spec.inputs is None:
            return np.zeros((0, self.gains.d)), np.zeros(0)
        seen = (self.gains.plant.C @ self.points).T[points]
        rows = self.gains.spec.inputs.H[facets][:, :, None] * seen[:, None, :]
        return rows.reshape(-1, self.gains.d), self.widened[facets]

    @cached_property
    def exactly(self) -> tuple[np.ndarray, np.ndarray]:
        """The same half-spaces in Fractions, with the widened bounds as the floats they are."""
        facets, points = self.pairs
        if self.gains.spec.inputs is None:
            return exact(np.zeros((0, self.gains.d))), exact(np.zeros(0))
        seen = (exact(self.gains.plant.C) @ exact(self.points)).T[points]
        rows = exact(self.gains.spec.inputs.H)[facets][:, :, None] * seen[:, None, :]
        return rows.reshape(-1, self.gains.d), exact(self.widened[facets])

    @cached_property
    def widened(self) -> Array:
        """The right-hand sides (f,) of the input limits plus 1e-9 of their size."""
        inputs = self.gains.spec.inputs
        assert inputs is not None
        return inputs.h + ADMISSIBLE_TOL * self.sizes

    @cached_property
    def sizes(self) -> Array:
        """The widths (f,) of the input limits across each facet."""
        inputs = self.gains.spec.inputs
        assert inputs is not None
        return np.asarray(inputs.support(inputs.H.T)) + np.asarray(inputs.support(-inputs.H.T))

    def rounded(self, reach: Array) -> bool:
        """Return whether the widening covers the rounding of rows times gains for |vec F| <= reach (d,)."""
        inputs, plant = self.gains.spec.inputs, self.gains.plant
        if inputs is None:
            return True
        terms = np.abs(inputs.H) @ reach.reshape(plant.m, plant.p) @ np.abs(plant.C) @ np.abs(self.points)
        return bool(np.all(64 * UNIT * (plant.n + self.gains.d) * np.max(terms, axis=1) <= ADMISSIBLE_TOL * self.sizes))

    def on(self, centers: Array, widths: Array) -> HalfSpaces:
        """Return the half-spaces that every admissible gain of a box obeys, the most binding ones only."""
        rows, bounds = self.first
        room = bounds - centers @ rows.T
        each = np.broadcast_to(rows, (len(centers), *rows.shape))
        if self.moves and len(bounds):
            later = later_moves(self.gains, self.some, self.widened, self.moves, centers, widths)
            each, room = np.concatenate([each, later.rows], axis=1), np.concatenate([room, later.room], axis=1)
        if room.shape[1] > _KEPT:
            reach = np.einsum("Nkd,Nd->Nk", np.abs(each), widths)
            kept = np.argpartition(room / np.maximum(reach, np.finfo(float).tiny), _KEPT, axis=1)[:, :_KEPT]
            each, room = np.take_along_axis(each, kept[..., None], axis=1), np.take_along_axis(room, kept, axis=1)
        return HalfSpaces(centers, widths, each, room)


    def around(self, F: Array) -> GainLimits:
        """Return the same with the initial states at which a gain F (m, p) meets the limits, and the coordinates of F."""
        plant, inputs, initial = self.gains.plant, self.gains.spec.inputs, self.gains.spec.initial
        T = balanced(plant, self.gains.spec, F)
        if inputs is None:
            return replace(self, T=T)
        met = drawn_in(initial, farthest(initial, (inputs.H @ F @ plant.C).T))
        return replace(self, points=np.unique(np.hstack([self.points, met]), axis=1), T=T)

    @cached_property
    def some(self) -> Array:
        """Some of the points, evenly from the list, of which later moves are counted."""
        return self.points[:, ::-(-self.points.shape[1] // _LATER)]


def anchors(initial: Distribution, seed: int) -> Array:
    """Return initial states (n, a) that may occur, far out: vertices when they are few, else the farthest in directions.

    Raises
    ------
    InvalidInputError : a distribution that no bounded set carries

    >>> from inc_casadi import Uniform
    >>> anchors(Uniform(Box(-1, 2)), 0).tolist()
    [[-1.0, 2.0]]
    """
    support, n = initial.support, initial.dimension
    if not (isinstance(support, Ellipsoid) or isinstance(support, Box) and 2**n > _LISTED):
        vertices = initial.vertices
        if vertices.shape[1] <= _LISTED:
            return drawn_in(initial, vertices)
    towards = np.hstack([np.eye(n), np.random.default_rng(seed).standard_normal((n, _DIRECTIONS))])
    return drawn_in(initial, np.unique(farthest(initial, np.hstack([towards, -towards])), axis=1))
