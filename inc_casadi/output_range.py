"""The values that a controller can give at all, from the range of its activations: input limits that are built in."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from .activations.stack import groups
from .inc import INC
from .sets import Box, Polytope

Range = list[tuple[Fraction | float, Fraction | float]]


def output_range(inc: INC) -> Range:
    """Return (low, high) with low <= u_i <= high for every y, exactly; infinite where no bound is known.

    u = K y + V eta + d, and each eta_j lies in the range that its activation states. Sufficient: the true range may be
    smaller.

    >>> [(float(low), float(high)) for low, high in output_range(INC.saturated([[2.0]], 3.0))]
    [(-3.0, 3.0)]
    """
    ends = np.zeros((inc.q, 2))
    for unit, rows in groups(inc.activations):
        ends[rows] = unit.bounds
    return [_one_output(inc, ends, i) for i in range(inc.m)]


def _one_output(inc: INC, ends: np.ndarray, i: int) -> tuple[Fraction | float, Fraction | float]:
    used = np.flatnonzero(inc.V[i])
    if inc.K[i].any():
        return -np.inf, np.inf
    products = [[_times(inc.V[i, j], end) for end in ends[j]] for j in used]
    offset = Fraction(inc.d[i])
    return sum((min(pair) for pair in products), offset), sum((max(pair) for pair in products), offset)


def _times(factor: float, end: float) -> Fraction | float:
    return Fraction(factor) * Fraction(end) if np.isfinite(end) else float(factor * end)


def within_limits(inc: INC, inputs: Box | Polytope) -> bool:
    """Whether the controller's range lies in the input set for every y: decided in Fractions, sufficient.

    Each half-space H u <= h is checked at the worst corner of the range.

    >>> within_limits(INC.saturated([[2.0]], 3.0), Box([-3.0], [3.0])), within_limits(INC.linear([[2.0]]), Box([-3], [3]))
    (True, False)
    """
    bounds = output_range(inc)
    for row, limit in zip(inputs.H, inputs.h, strict=True):
        pairs = [(Fraction(entry), bounds[i]) for i, entry in enumerate(row) if entry != 0]
        if any(not np.isfinite(float(end)) for _, pair in pairs for end in pair):
            return False
        worst = sum((max(entry * Fraction(low), entry * Fraction(high)) for entry, (low, high) in pairs), Fraction(0))
        if worst > Fraction(limit):
            return False
    return True
