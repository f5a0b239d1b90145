"""Whether a linear loop exceeds an input limit within some steps: its inputs are linear in z_0, so supports decide."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..errors import InvalidInputError
from ..sets import Box, Distribution, Polytope

STEPS = 200
TOLERANCE = 1e-9


def first_violation(inputs: Box | Polytope | None, initial: Distribution, F: Array, G: Array, steps: int = STEPS) -> str:
    """Return in words when u_k = G F^k z_0 first exceeds a limit from some initial state, or "" when it does not.

    The largest value of H_u G F^k z_0 over the initial states is a support function. In floats: that nothing is exceeded
    in so many steps is evidence, not proof; a violation beyond rounding is one.

    Parameters
    ----------
    inputs : the limits, or None
    initial : distribution of z_0
    F, G : the loop z+ = F z, u = G z in discrete time, (n, n) and (m, n)
    steps : how many moves are looked at

    Examples
    --------
    >>> from inc_casadi import Box, Uniform
    >>> start, limits = Uniform(Box(-1, 1)), Box(-1, 1)
    >>> first_violation(limits, start, np.array([[0.5]]), np.array([[-1.0]]))
    ''
    >>> first_violation(limits, start, np.array([[0.25]]), np.array([[-1.25]]))
    'an input limit is exceeded by 0.25 at k = 0'
    """
    if inputs is None:
        return ""
    rows, room = inputs.H @ G, TOLERANCE * np.maximum(1.0, np.abs(inputs.h))
    for k in range(steps):
        over = _reach(initial, rows) - inputs.h
        if np.any(np.isinf(over)):
            return "the initial states are unbounded, so every linear law that is not constant exceeds every limit"
        if np.any(over > room):
            return f"an input limit is exceeded by {float(np.max(over)):.3g} at k = {k}"
        rows = rows @ F
    return ""


def _reach(initial: Distribution, rows: Array) -> Array:
    """The largest value of each row times z_0 over the initial states, infinite where these are unbounded."""
    if initial.support is not None:
        return np.asarray(initial.support.support(rows.T))
    try:
        return np.asarray((rows @ initial.vertices).max(axis=1))
    except InvalidInputError:  # a Gaussian: every direction is reached
        return np.where(np.any(rows != 0, axis=1), np.inf, 0.0)
