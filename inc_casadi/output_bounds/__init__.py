"""Rigorous bounds on what a controller gives over sets of states, for every activation and for implicit layers."""

from __future__ import annotations

import numpy as np

from ..arrays import Array, matrix
from ..errors import DimensionError
from ..inc import INC
from .branch import Found, greatest
from .cells import Boxes, Cells, Simplices
from .interval import Enclosure, Law
from .relaxation import Forms, enclosure, output_forms, upper_bounds

__all__ = ["Boxes", "Cells", "Enclosure", "Forms", "Found", "Law", "Simplices", "bounds_on", "enclosure", "greatest",
           "hidden_bounds_on", "output_forms", "upper_bounds"]


def bounds_on(inc: INC, C: Array, boxes: Boxes) -> tuple[Array, Array]:
    """Return (low, high), each (N, m), with low <= u <= high for u = inc(C x) and every x of each of N boxes.

    Rigorous in floats: every rounding is allowed for, and curved activations are taken to be computed within 8 eps of
    1 + |phi|. The bounds improve with the square of the boxes' widths where the activations are smooth or affine.

    C (p, n). Raises DimensionError when the boxes do not lie in R^n, NotWellPosedError when the fixed point is not unique.

    >>> low, high = bounds_on(INC.saturated([[2.0]], 1.0), np.eye(1), Boxes(np.array([[0.25]]), np.array([[3.0]])))
    >>> bool(0.4 < low[0, 0] <= 0.5), bool(1.0 <= high[0, 0] < 1.1)
    (True, True)
    """
    law = Law(inc, matrix("C", C, (inc.p, None)))
    if boxes.lower.shape[1] != law.C.shape[1]:
        raise DimensionError(f"the boxes lie in R^{boxes.lower.shape[1]}, but C has {law.C.shape[1]} columns")
    m, n = inc.m, law.C.shape[1]
    E, G = np.zeros((2 * m, n)), np.vstack([np.eye(m), -np.eye(m)])
    found = upper_bounds(law, output_forms(law, E, G, np.zeros(2 * m), E, np.abs(G)), boxes).bound
    return -found[:, m:], found[:, :m]


def hidden_bounds_on(inc: INC, C: Array, boxes: Boxes) -> Enclosure:
    """Return intervals of the pre-activations z and the hidden vector eta over each box, as `bounds_on` does for u.

    >>> found = hidden_bounds_on(INC.saturated([[2.0]], 1.0), np.eye(1), Boxes(np.array([[0.25]]), np.array([[3.0]])))
    >>> found.z_low.round(9).tolist(), found.z_high.round(9).tolist()
    ([[0.5]], [[6.0]])
    """
    return enclosure(Law(inc, matrix("C", C, (inc.p, None))), boxes)
