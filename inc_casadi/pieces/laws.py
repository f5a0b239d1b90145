"""The affine laws of a piecewise-affine controller: one for each pattern of active pieces."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..errors import ConvergenceError, InvalidInputError
from ..inc import INC
from ..plant import Plant
from .linear import identity, solve

REPAIRS = 60


@dataclass(frozen=True, eq=False)
class Laws:
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
class PiecewiseLoop:
    """A plant and a piecewise-affine controller, ready for exact pieces in floats or in Fractions.

    Raises InvalidInputError when a unit is not piecewise affine or time is continuous.
    """

    plant: Plant
    inc: INC
    rational: bool = False

    def __post_init__(self) -> None:
        for i, unit in enumerate(self.inc.activations):
            if unit.pieces is None:
                raise InvalidInputError(f"hidden unit {i} has activation {unit}, which is not piecewise affine: exact "
                                        "pieces do not apply")
        if not self.plant.discrete:
            raise InvalidInputError("exact pieces walk in discrete time: sample the plant first, plant.sampled(dt)")

    def numbers(self, array: Array) -> Array:
        """Return the array in this loop's numbers: floats, or Fractions equal to them."""
        return exact(array) if self.rational else np.asarray(array, dtype=float)

    def laws(self, patterns: np.ndarray) -> Laws:
        """Return the laws of patterns (k, q), each from one linear system (I - D W) eta = D (U C x + b) + o."""
        parts = [self._law(pattern) for pattern in patterns]
        q, n, m = self.inc.q, self.plant.n, self.plant.m
        shapes = ((q, n), (q,), (m, n), (m,), (q,), (q,))
        stacked = [np.stack([part[i] for part in parts]) if parts else np.zeros((0, *shape))
                   for i, shape in enumerate(shapes)]
        return Laws(patterns, *stacked)

    def patterns_at(self, x: Array) -> np.ndarray:
        """Return the pattern (N, q) at each point x (N, n), the piece on the right at a kink."""
        if self.inc.q == 0:
            return np.zeros((x.shape[0], 0), dtype=int)
        y = self.plant.C @ x.astype(float).T
        z = self.inc.W @ self.inc.solve(y).eta + self.inc.U @ y + self.inc.b[:, None]
        guess = np.stack([_index(unit.pieces, z[i]) for i, unit in enumerate(self.inc.activations)], axis=1)
        return self._repaired(guess, x) if self.rational else guess

    def _repaired(self, guess: np.ndarray, x: Array) -> np.ndarray:
        """Correct patterns guessed in floats until they hold exactly at x, by exact Newton steps on the pattern."""
        for _ in range(REPAIRS):
            distinct, which = np.unique(guess, axis=0, return_inverse=True)
            laws = self.laws(distinct)
            z = (laws.Zx[which] @ x[:, :, None])[:, :, 0] + laws.z0[which]
            wrong = np.any((z < laws.low[which]) | (z > laws.high[which]), axis=1)
            if not wrong.any():
                return guess
            pieces = [unit.pieces for unit in self.inc.activations]
            new = np.stack([_index(piece, z[wrong, i].astype(float)) for i, piece in enumerate(pieces)], axis=1)
            if np.array_equal(new, guess[wrong]):
                break
            guess = guess.copy()
            guess[wrong] = new
        raise ConvergenceError("the activation pattern at a point could not be settled in exact arithmetic")

    def _ends(self, ends: list[float]) -> Array:
        """Ends of pieces as numbers of this loop; an infinite end stays a float, which Fractions compare with exactly."""
        if not self.rational:
            return np.array(ends, dtype=float)
        out = np.empty(len(ends), dtype=object)
        out[:] = [Fraction(float(end)) if np.isfinite(end) else float(end) for end in ends]
        return out

    def _law(self, pattern: np.ndarray) -> tuple[Array, ...]:
        inc, number = self.inc, self.numbers
        pieces = [unit.pieces for unit in inc.activations]
        slope = number(np.array([piece.slopes[j] for piece, j in zip(pieces, pattern, strict=True)]))
        offset = number(np.array([piece.intercepts[j] for piece, j in zip(pieces, pattern, strict=True)]))
        low = self._ends([piece.kinks[j - 1] if j > 0 else -np.inf for piece, j in zip(pieces, pattern, strict=True)])
        high = self._ends([piece.kinks[j] if j < piece.kinks.size else np.inf
                           for piece, j in zip(pieces, pattern, strict=True)])
        W, U, V, K = number(inc.W), number(inc.U), number(inc.V), number(inc.K)
        b, d, C = number(inc.b), number(inc.d), number(self.plant.C)
        drive = np.hstack([slope[:, None] * (U @ C), (slope * b + offset)[:, None]])
        eta = solve(identity(inc.q, W) - slope[:, None] * W, drive) if inc.q else drive
        Ex, e = eta[:, :-1], eta[:, -1]
        return W @ Ex + U @ C, W @ e + b, K @ C + V @ Ex, V @ e + d, low, high


def _index(pieces: object, z: Array) -> np.ndarray:
    return pieces.index(z)  # type: ignore[attr-defined]
