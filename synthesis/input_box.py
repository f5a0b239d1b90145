"""The box of inputs that a law is clipped to: around the set of inputs, or inside it."""

from __future__ import annotations

import numpy as np

from inc_casadi.arrays import Array
from inc_casadi.errors import SolverError
from inc_casadi.sets import Box, Polytope


def box_and_limits(inputs: Box | Polytope | None) -> tuple[Box | None, tuple[Array, Array] | None]:
    """Return the bounding box of the inputs, and the half-spaces (H, h) that cut into it; None where there are none.

    >>> box, (H, h) = box_and_limits(Polytope([[1, 1], [-1, 0], [0, -1], [1, 0]], [1, 0, 0, 1]))
    >>> box.upper.tolist(), H.tolist()
    ([1.0, 1.0], [[1.0, 1.0]])
    """
    if not isinstance(inputs, Polytope):
        return inputs, None
    axes = np.eye(inputs.dimension)
    box = Box(-np.asarray(inputs.support(-axes)), np.asarray(inputs.support(axes)))
    cutting = np.asarray(box.support(inputs.H.T)) > inputs.h + 1e-9 * (1.0 + np.abs(inputs.h))
    return box, (inputs.H[cutting], inputs.h[cutting]) if cutting.any() else None


def inscribed_box(polytope: Polytope) -> Box:
    """Return a large box inside a polytope: first as large as possible in the shape of its bounding box, then widened.

    >>> diamond = Polytope([[1, 1], [1, -1], [-1, 1], [-1, -1]], [1, 1, 1, 1])
    >>> inscribed_box(diamond).upper.round(6).tolist()
    [0.5, 0.5]
    """
    from scipy.optimize import linprog

    m = polytope.dimension
    axes = np.eye(m)
    shape = (np.asarray(polytope.support(axes)) + np.asarray(polytope.support(-axes))) / 2
    # Unknowns: center c (m,), half widths r (m,), common scale s; H c + |H| r <= h, r >= s shape.
    within = np.hstack([polytope.H, np.abs(polytope.H), np.zeros((polytope.h.size, 1))])
    wide = np.hstack([np.zeros((m, m)), -np.eye(m), shape[:, None]])
    reward = np.concatenate([np.zeros(m), 1e-3 / shape, [1.0]])
    found = linprog(-reward, np.vstack([within, wide]), np.concatenate([polytope.h, np.zeros(m)]),
                    bounds=[(None, None)] * m + [(0.0, None)] * (m + 1))
    if found.x is None:
        raise SolverError(f"no box was found inside the polytope of inputs: {found.message}")
    c, r = found.x[:m], found.x[m:2 * m] * (1.0 - 1e-9)
    return Box(c - r, c + r)
