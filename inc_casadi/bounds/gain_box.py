"""A first box that holds all gains worth looking at: bounded by the input limits, or by a convex lower bound."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..errors import InfeasibleError, InvalidInputError
from ..exact import is_positive_definite, solve
from ..linear_program import maximum
from .gain_limits import GainLimits


@dataclass(frozen=True, eq=False)
class FirstBox:
    """The box lower <= vec F <= upper: every admissible gain outside costs at least `level`.

    With multipliers y >= 0 of the half-spaces rows F <= bounds of the first move, an end e = +-(unit vector) has
    e'F = y'rows F + (e - rows'y)'F <= y'bounds + |e - rows'y|_1 |F|. An end that the limits leave farther out is bounded
    by the convex quadratic J(F) >= f'H f + 2 g'f + c of `Floor`, which is at least
    c - g'H^-1 g + (end - middle)^2 / (H^-1)_jj beyond it, middle = -H^-1 g.

    Parameters
    ----------
    lower, upper : (d,)
    multipliers : (2, d, k) of the upper ends, then the lower ones
    by_cost : (2, d) which ends are bounded by cost
    level : infinite if none is
    """

    lower: Array
    upper: Array
    multipliers: Array
    by_cost: np.ndarray
    level: float

    def reason(self, limits: GainLimits) -> str:
        """Return in words why the box is not proved to hold all gains that it should, or nothing; in Fractions."""
        if self.multipliers.shape != (2, limits.gains.d, len(limits.first[1])):
            return "the first box has not as many multipliers as there are half-spaces"
        if np.any(self.multipliers < 0) or not np.all(np.isfinite(self.multipliers)):
            return "a multiplier of the first box is negative"
        ends, off = _by_limits(limits, self.multipliers, self.by_cost)
        stated = np.array([exact(self.upper), -exact(self.lower)])
        size = max((abs(end) for end in np.where(self.by_cost, stated, ends).ravel()), default=Fraction(0))
        error = max(off[~self.by_cost], default=Fraction(0))
        if error >= Fraction(1, 2):
            return "the multipliers of the first box do not add up"
        if np.any((ends + off * (size / (1 - error)) > stated) & ~self.by_cost):
            return "the input limits do not imply the first box"
        if np.any(self.by_cost):
            return _by_level(limits, stated, self.by_cost, self.level)
        return ""


def _by_limits(limits: GainLimits, multipliers: Array, by_cost: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    # y'bounds and |e - rows'y|_1 for each end, (2, d) Fractions.
    rows, bounds = limits.exactly
    d = limits.gains.d
    ends, off = exact(np.zeros((2, d))), exact(np.zeros((2, d)))
    for side, j in zip(*np.nonzero(~by_cost), strict=True):
        y = exact(multipliers[side, j])
        left = (-1) ** side * exact(np.eye(d)[j]) - y @ rows
        ends[side, j], off[side, j] = y @ bounds, sum(abs(left))
    return ends, off


def _by_level(limits: GainLimits, stated: np.ndarray, by_cost: np.ndarray, level: float) -> str:
    H, g, c = limits.floor.exactly
    if not is_positive_definite(H):
        return "the convex lower bound does not bound the gains"
    middle = -_solved(H, g)
    for side, j in zip(*np.nonzero(by_cost), strict=True):
        beyond = stated[side, j] - (-1) ** side * middle[j]
        width = _solved(H, exact(np.eye(len(g))[j]))[j]
        if beyond < 0 or c + g @ middle + beyond**2 / width < Fraction(level):
            return f"gains beyond entry {j} of the first box are not proved to cost {level:g}"
    return ""


def _solved(H: np.ndarray, g: np.ndarray) -> np.ndarray:
    found = solve(H, g)
    assert found is not None
    return found


def first_box(limits: GainLimits, level: float) -> FirstBox:
    """Return a first box; gains outside it are inadmissible, or cost at least `level` (finite).

    Raises
    ------
    InfeasibleError : no gain keeps the limits
    InvalidInputError : neither the limits nor the convex lower bound confines the gains
    """
    multipliers, bounded = _multipliers(limits)
    kept, off = _by_limits(limits, multipliers, ~bounded)
    near = np.where(bounded, kept.astype(float), np.inf)
    far = _ends_by_cost(limits, level)
    by_cost = far < near
    ends = np.where(by_cost, far, near)
    if not np.all(np.isfinite(ends)):
        raise InvalidInputError("neither the input limits nor the cost confines the gains: R + beta B'PB or the second "
                                "moment of the measurement is singular; price all inputs (R > 0), limit them, or leave out "
                                "what is measured twice")
    multipliers[by_cost] = 0.0
    ends = ends + (1e-9 + 4 * off.astype(float)) * np.max(np.abs(ends))
    return FirstBox(-ends[1], np.maximum(ends[0], -ends[1]), multipliers, by_cost, level if np.any(by_cost) else np.inf)


def _multipliers(limits: GainLimits) -> tuple[Array, np.ndarray]:
    # Of linear programs for both ends of every entry, (2, d, k), and which of them are bounded.
    d = limits.gains.d
    rows, bounds = limits.first
    across = np.max(np.abs(rows), axis=0, initial=0.0)
    scaled = rows / np.where(across > 0, across, 1.0)
    sizes = np.linalg.norm(scaled, axis=1)
    kept = sizes > 0
    multipliers, bounded = np.zeros((2, d, len(bounds))), np.zeros((2, d), dtype=bool)
    for side, j in np.ndindex(2, d) if np.any(kept) else ():
        row = (-1.0) ** side * np.eye(d)[j]
        found = maximum(row, scaled[kept] / sizes[kept, None], bounds[kept] / sizes[kept])
        if found is None:
            raise InfeasibleError("no static gain u = F y keeps the input limits at all initial states")
        if np.isfinite(found.value):
            multipliers[side, j, kept] = found.multipliers / sizes[kept] / across[j]
            bounded[side, j] = True
    return multipliers, bounded


def _ends_by_cost(limits: GainLimits, level: float) -> Array:
    # How far +-entries (2, d) reach where the convex lower bound is below the level.
    H, g, c = limits.floor.exactly
    if not is_positive_definite(H):
        return np.full((2, len(g)), np.inf)
    middle = -_solved(H, g)
    room = max(level - float(c + g @ middle), 0.0)
    widths = [np.sqrt(room * float(_solved(H, unit)[j])) for j, unit in enumerate(exact(np.eye(len(g))))]
    return np.array([middle.astype(float) + widths, widths - middle.astype(float)])
