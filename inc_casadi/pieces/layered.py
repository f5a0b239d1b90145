"""Laws of a feedforward controller, summed level by level with whole numbers: no linear system and no fraction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..activations.stack import lipschitz
from ..arrays import Array
from ..fixed_point import feedforward_levels
from .fixed import PLACES
from .laws import PiecewiseLoop
from .places import Places, shifted

MOST_EXTRA = 512


@dataclass(frozen=True, eq=False)
class LayeredLaws:
    """z = Zx x + z0 and u = Gx x + g of P patterns as multiples of 2^-256; low, high (P, q): the ends of the pieces."""

    Zx: Places
    z0: Places
    Gx: Places
    g: Places
    low: Array
    high: Array


def layered_laws(loop: PiecewiseLoop, patterns: np.ndarray) -> LayeredLaws | None:
    """Return the laws of patterns (P, q), each entry off by less than 2 roundings 2^-256; None when W has a loop.

    With p = 256 + k places, a product is rounded down once, so the rows of units off by at most d come to z off by
    |W| d + 3 roundings 2^-p, and S times that is passed on: d = (I - S|W|)^{-1} S 3 bounds all levels, and |V| d + 3 the
    output. k is taken so large that all of this is below 2^(k - 1) (with k to spare for floats: 8 more), and the last
    shift to 256 places costs one more rounding.
    """
    inc, levels = loop.inc, feedforward_levels(loop.inc.W)
    if levels is None or inc.q == 0:
        return None
    extra = _extra_places(inc)
    if extra > MOST_EXTRA:
        return None
    p = PLACES + extra

    def at(array: Any) -> Places:
        return shifted(np.asarray(array, dtype=float), p)

    units = np.arange(inc.q)
    slope, offset, low, high = (table[units, patterns] for table in loop.pieces_in_floats)
    slope, offset = at(slope), at(offset)
    W, C = at(inc.W), at(loop.plant.C)
    direct = np.concatenate([(at(inc.U) @ C) >> p, at(inc.b)[:, None]], axis=1)
    z = np.broadcast_to(direct, (len(patterns), *direct.shape)).copy()
    eta = np.zeros_like(z)
    for level in levels:
        read = np.flatnonzero(np.any(inc.W[level] != 0, axis=0))
        if read.size:
            z[:, level] = z[:, level] + ((W[np.ix_(level, read)] @ eta[:, read]) >> p)
        eta[:, level] = (slope[:, level, None] * z[:, level]) >> p
        eta[:, level, -1] = eta[:, level, -1] + offset[:, level]
    u = ((at(inc.V) @ eta) >> p) + np.concatenate([(at(inc.K) @ C) >> p, at(inc.d)[:, None]], axis=1)
    z, u = z >> extra, u >> extra
    return LayeredLaws(z[:, :, :-1], z[:, :, -1], u[:, :, :-1], u[:, :, -1], low, high)


def _extra_places(inc: Any) -> int:
    S = lipschitz(inc.activations)
    d = np.linalg.solve(np.eye(inc.q) - S[:, None] * np.abs(inc.W), 3.0 * (S + 1.0))
    most = max(float(np.max(np.abs(inc.W) @ d + 3.0)), float(np.max(np.abs(inc.V) @ d + 3.0, initial=0.0)))
    return int(np.ceil(np.log2(max(most, 1.0)))) + 9

