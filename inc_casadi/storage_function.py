"""The values of the storage function that a certificate rests on, at states."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array, columns
from .inc import INC
from .loop import equilibrium
from .plant import Plant


def quadratic_about(x: ArrayLike, P: Array, center: Array) -> float | Array:
    """Return (x - center)'P (x - center) at a state (n,) or at columns (n, N): a number or (N,).

    Raises DimensionError or InvalidInputError for states that are not of n entries, or not finite.

    >>> quadratic_about([[1.0, 3.0]], np.array([[2.0]]), np.array([1.0])).tolist()
    [0.0, 8.0]
    """
    points, single = columns("x", x, len(center))
    return _answer(points - center[:, None], P, single)


def stored_value(x: ArrayLike, P: Array, plant: Plant, inc: INC) -> float | Array:
    """Return V(x) = (v - v*)'P (v - v*) with v = (x, eta_0, ..., eta_{k-1}), of a loop about its equilibrium.

    x_0 = x and x_{i+1} = A x_i + B inc(C x_i) give the hidden vectors eta_i at C x_i; k is told from the size of P, n + k q,
    and v = x for k = 0. v* is v at rest, zero for a controller that keeps the origin. x: (n,) or (n, N), the answer a number
    or (N,); in floats.

    Raises DimensionError or InvalidInputError for such x as above, NoEquilibriumError when a biased loop has none.

    >>> plant, law = Plant([[0.5]], [[1.0]]), INC([[0.0]], [[2.0]], [[1.0]], [[0.0]])
    >>> stored_value([3.0], np.diag([1.0, 10.0]), plant, law)   # eta = max(2 x, 0) = 6
    369.0
    """
    points, single = columns("x", x, plant.n)
    steps = 0 if inc.q == 0 else (len(P) - plant.n) // inc.q
    rest = np.zeros(plant.n) if inc.preserves_origin else equilibrium(plant, inc).x
    stacked = _stacked(points, plant, inc, steps) - _stacked(rest[:, None], plant, inc, steps)
    return _answer(stacked, P, single)


def _stacked(x: Array, plant: Plant, inc: INC, steps: int) -> Array:
    """Return v (n + steps q, N) at the states (n, N)."""
    parts = [x]
    for _ in range(steps):
        y = plant.C @ x
        parts.append(inc.hidden(y))
        x = plant.A @ x + plant.B @ inc(y)
    return np.concatenate(parts)


def _answer(v: Array, P: Array, single: bool) -> float | Array:
    values = np.asarray(((P @ v) * v).sum(axis=0))
    return float(values[0]) if single else values
