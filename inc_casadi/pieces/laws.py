"""The affine laws of a piecewise-affine controller: one for each pattern of active pieces."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..brief import Brief
from ..errors import ConvergenceError, InvalidInputError
from ..fixed_point import feedforward_levels
from ..inc import INC
from ..plant import Plant
from .fixed import ONE, PLACES, Fixed, rounded
from .linear import identity, solve
from .scatter import distinct_rows

CLEAR = 1e-9  # in floats, what lies within a bound by this share of its terms certainly does
REPAIRS, ROUNDS = 60, 8  # Newton steps on a pattern: in Fractions the last resort, in floats before solving anew


@dataclass(frozen=True, eq=False)
class Laws(Brief):
    """The affine laws of several patterns, side by side: on pattern k, z = Zx[k] x + z0[k] and u = Gx[k] x + g[k].

    patterns (k, q): piece index of each unit; Zx (k, q, n), z0 (k, q), Gx (k, m, n), g (k, m); low, high (k, q): the
    interval of z on which each unit's piece is valid, infinite at the ends.

    Pattern k is the controller at x exactly when low <= z <= high: then eta = D z + o solves the fixed point, and by
    well-posedness it is the only solution. So the guess of a pattern needs no trust, these inequalities decide.
    """

    patterns: np.ndarray
    Zx: Array
    z0: Array
    Gx: Array
    g: Array
    low: Array
    high: Array


@dataclass(frozen=True, eq=False)
class PiecewiseLoop(Brief):
    """A plant and a piecewise-affine controller, ready for exact pieces in one of three kinds of numbers.

    arithmetic: "float"; "exact", in Fractions; or "fixed", in numbers of 256 binary places (`Fixed`), where laws are
    solved in Fractions and then rounded.

    Raises InvalidInputError when a unit is not piecewise affine or time is continuous.
    """

    plant: Plant
    inc: INC
    arithmetic: str = "float"

    def __post_init__(self) -> None:
        if self.arithmetic not in ("float", "exact", "fixed"):
            raise InvalidInputError(f"arithmetic is {self.arithmetic!r}, but must be 'float', 'exact' or 'fixed'")
        for i, unit in enumerate(self.inc.activations):
            if unit.pieces is None:
                raise InvalidInputError(f"hidden unit {i} has activation {unit}, which is not piecewise affine: exact "
                                        "pieces do not apply")
        if not self.plant.discrete:
            raise InvalidInputError("exact pieces walk in discrete time: sample the plant first, plant.sampled(dt)")

    def numbers(self, array: Array) -> Array:
        """Return the array in this loop's numbers: floats, Fractions equal to them, or rounded to 256 places."""
        if self.arithmetic == "float":
            return np.asarray(array, dtype=float)
        return exact(array) if self.arithmetic == "exact" else rounded(array)

    @property
    def kink_tolerance(self) -> Any:
        """How far beyond a kink counts as on it: nothing in Fractions; in floats it is relative to the terms of z."""
        return {"float": 1e-12, "exact": 0, "fixed": Fixed(ONE >> (PLACES // 2))}[self.arithmetic]

    def laws(self, patterns: np.ndarray) -> Laws:
        """Return the laws of patterns (k, q), each from one linear system (I - D W) eta = D (U C x + b) + o."""
        if self.arithmetic == "float":
            return self._solved_laws(patterns)
        memory = self._memory
        for pattern in patterns:
            if pattern.tobytes() not in memory:
                memory[pattern.tobytes()] = self._one_law(pattern)
        if len(patterns) == 0:
            return self._solved_laws(patterns)
        rows = [memory[pattern.tobytes()] for pattern in patterns]
        return Laws(patterns, *(np.stack(column) for column in zip(*rows, strict=True)))

    @cached_property
    def _memory(self) -> dict[bytes, tuple[Array, ...]]:
        """Laws already solved, each a pure function of its pattern: in Fractions one takes milliseconds."""
        return {}

    def _one_law(self, pattern: np.ndarray) -> tuple[Array, ...]:
        source = self if self.arithmetic == "exact" else replace(self, arithmetic="exact")
        laws = source._solved_laws(pattern[None])
        parts = (laws.Zx[0], laws.z0[0], laws.Gx[0], laws.g[0], laws.low[0], laws.high[0])
        return parts if self.arithmetic == "exact" else tuple(rounded(part) for part in parts)

    def _solved_laws(self, patterns: np.ndarray) -> Laws:
        inc, number = self.inc, self.numbers
        units = np.arange(inc.q)
        slope, offset, low, high = (table[units, patterns] for table in self._pieces)
        W, U, V, K = number(inc.W), number(inc.U), number(inc.V), number(inc.K)
        b, d, C = number(inc.b), number(inc.d), number(self.plant.C)
        drive = np.concatenate([slope[:, :, None] * (U @ C), (slope * b + offset)[:, :, None]], axis=2)
        eta = self._hidden_laws(slope, W, drive) if inc.q and len(patterns) else drive
        Ex, e = eta[:, :, :-1], eta[:, :, -1]
        return Laws(patterns, W @ Ex + U @ C, e @ W.T + b, K @ C + V @ Ex, e @ V.T + d, low, high)

    def _hidden_laws(self, slope: Array, W: Array, drive: Array) -> Array:
        """eta = slope W eta + drive (k, q, n + 1): level by level where W is feedforward, else one linear system each."""
        if self._levels is not None:
            eta = drive.copy()
            for level in self._levels[1:]:
                read = np.flatnonzero(np.any(W[level] != 0, axis=0))
                eta[:, level] = eta[:, level] + slope[:, level, None] * (W[np.ix_(level, read)] @ eta[:, read])
            return eta
        system = identity(self.inc.q, W) - slope[:, :, None] * W
        if self.arithmetic == "float":
            return np.linalg.solve(system, drive)
        return np.stack([solve(left, right) for left, right in zip(system, drive, strict=True)])

    @cached_property
    def _levels(self) -> list[np.ndarray] | None:
        return feedforward_levels(self.inc.W)

    def patterns_at(self, x: Array, guess: np.ndarray | None = None) -> np.ndarray:
        """Return the pattern (N, q) at each point x (N, n); at a kink, up to rounding, the piece on either side.

        guess (N, q): patterns to start from. A pattern whose law puts every z into its own piece is the answer; else
        the pieces that z lies in are tried next (Newton's method on the pattern), and points that this does not settle
        in a few rounds are solved anew.

        Raises ConvergenceError when a pattern cannot be settled.
        """
        if self.inc.q == 0:
            return np.zeros((x.shape[0], 0), dtype=int)
        patterns = self._solved(x) if guess is None else guess.copy()
        if guess is None and self.arithmetic == "float":
            return patterns
        settled, patterns = self._settled(patterns, x)
        if not settled.all() and guess is not None:
            patterns[~settled] = self.patterns_at(x[~settled])
        elif not settled.all():
            raise ConvergenceError("the activation pattern at a point could not be settled in exact arithmetic")
        return patterns

    def _solved(self, x: Array) -> np.ndarray:
        y = self.plant.C @ x.astype(float).T
        z = self.inc.W @ self.inc.solve(y).eta + self.inc.U @ y + self.inc.b[:, None]
        return self._indices(z.T)

    def _settled(self, patterns: np.ndarray, x: Array) -> tuple[np.ndarray, np.ndarray]:
        """Take Newton steps on patterns (N, q) at x: which are settled, and the patterns reached."""
        settled = np.zeros(len(x), dtype=bool)
        room = 0 if self.arithmetic == "float" else self.kink_tolerance
        for _ in range(ROUNDS if self.arithmetic == "float" else REPAIRS):
            rows = np.flatnonzero(~settled)
            distinct, which = self.distinct(patterns[rows])
            laws = self.laws(distinct)
            outside = heights(laws, which, x[rows][:, None, :])[:, 0]
            holds = (outside <= room).all(axis=1)
            settled[rows[holds]] = True
            if holds.all():
                break
            wrong = ~holds
            z = (laws.Zx[which[wrong]] @ x[rows[wrong], :, None])[:, :, 0] + laws.z0[which[wrong]]
            patterns[rows[wrong]] = self._indices(z)
        return settled, patterns

    def distinct(self, patterns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the distinct rows of patterns (N, q), and for each pattern which of them it is."""
        first, which = distinct_rows(patterns)
        return patterns[first], which

    def _indices(self, z: Array) -> np.ndarray:
        """The pieces (N, q) that z (N, q) lies in; Fractions are compared with the kinks as they are."""
        kinks = self._pieces[2][:, 1:]
        return (z[:, :, None] >= kinks).sum(axis=2).astype(int)

    @cached_property
    def _pieces(self) -> tuple[Array, Array, Array, Array]:
        slope, offset, low, high = self.pieces_in_floats
        return self.numbers(slope), self.numbers(offset), self._ends(low), self._ends(high)

    @cached_property
    def pieces_in_floats(self) -> tuple[Array, Array, Array, Array]:
        """Slope, intercept, low and high end of every piece of every unit, each (q, most pieces); padding beyond."""
        pieces = [unit.pieces for unit in self.inc.activations if unit.pieces is not None]
        shape = len(pieces), max((piece.slopes.size for piece in pieces), default=1)
        slope, offset, low, high = np.zeros(shape), np.zeros(shape), np.full(shape, np.inf), np.full(shape, np.inf)
        for i, piece in enumerate(pieces):
            k = piece.kinks.size
            slope[i, :k + 1], offset[i, :k + 1] = piece.slopes, piece.intercepts
            low[i, 0], low[i, 1:k + 1], high[i, :k] = -np.inf, piece.kinks, piece.kinks
        return slope, offset, low, high

    def _ends(self, ends: Array) -> Array:
        """Ends of pieces as numbers of this loop; an infinite end stays a float, which Fractions compare with exactly."""
        if self.arithmetic == "float":
            return ends
        out = self.numbers(np.where(np.isfinite(ends), ends, 0.0))
        out[~np.isfinite(ends)] = ends[~np.isfinite(ends)]
        return out


def heights(laws: Laws, which: np.ndarray, points: Array) -> Array:
    """Return how far z is beyond each bound of its piece (N, k, 2q) at points (N, k, n): positive outside.

    which (N,): the law of each row. The first q bounds are the lower ends. Where the numbers are not floats, the bounds
    that no point of a row comes near are first told apart in floats, and stand as -1: a float z is off by less than
    1e-12 of the terms it is summed from, and only what is within by 1e-9 of them is left out.
    """
    if laws.z0.shape[1] == 0:
        return np.full((*points.shape[:2], 1), -1.0)
    if points.dtype != object:
        return _heights(points, laws.Zx[which], laws.z0[which], laws.low[which], laws.high[which])
    Zx, z0, low, high = (part.astype(float) for part in (laws.Zx, laws.z0, laws.low, laws.high))
    x = points.astype(float)
    rough = _heights(x, Zx[which], z0[which], low[which], high[which])
    terms = np.abs(x) @ np.swapaxes(np.abs(Zx[which]), 1, 2) + np.abs(z0[which])[:, None, :]
    ends = np.concatenate([low, high], axis=1)[which]
    size = np.tile(terms, 2) + np.where(np.isfinite(ends), np.abs(ends), 0.0)[:, None, :]
    rows, bound = np.nonzero((rough > -CLEAR * size).any(axis=1))
    unit, lower = bound % z0.shape[1], bound < z0.shape[1]
    law = which[rows]
    z = (points[rows] @ laws.Zx[law, unit][:, :, None])[:, :, 0] + laws.z0[law, unit][:, None]
    out = np.full(rough.shape, -1, dtype=object)
    out[rows[lower], :, bound[lower]] = laws.low[law[lower], unit[lower]][:, None] - z[lower]
    out[rows[~lower], :, bound[~lower]] = z[~lower] - laws.high[law[~lower], unit[~lower]][:, None]
    return out


def _heights(points: Array, Zx: Array, z0: Array, low: Array, high: Array) -> Array:
    z = points @ np.swapaxes(Zx, 1, 2) + z0[:, None, :]
    return np.concatenate([low[:, None, :] - z, z - high[:, None, :]], axis=2)
