"""A column of hidden units, each with its own activation: evaluate them and collect their facts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import DimensionError, InvalidInputError
from .base import Activation

Units = tuple[Activation, ...]


def as_units(activation: Activation | Sequence[Activation], q: int) -> Units:
    """Return one activation per hidden unit: a single one is repeated q times.

    Raises InvalidInputError for what is no activation, DimensionError when the number of entries is not q.

    >>> from inc_casadi.activations import ReLU, Tanh
    >>> as_units([ReLU(), Tanh()], 2)
    (ReLU(), Tanh())
    """
    units = (activation,) * q if isinstance(activation, Activation) else tuple(activation)
    for unit in units:
        if not isinstance(unit, Activation):
            raise InvalidInputError(f"activation must be an Activation such as ReLU(), not {unit!r}")
    if len(units) != q:
        raise DimensionError(f"activation has {len(units)} entries, but W has {q} hidden units: give one, or one per unit")
    return units


def groups(units: Units) -> list[tuple[Activation, np.ndarray]]:
    """Return each distinct activation with the indices of its units."""
    distinct = dict.fromkeys(units)
    return [(unit, np.array([i for i, other in enumerate(units) if other == unit])) for unit in distinct]


def evaluate(units: Units, z: Array) -> Array:
    """Return phi(z) for columns z (q, N).

    >>> from inc_casadi.activations import ReLU, Tanh
    >>> evaluate((ReLU(), Tanh()), np.array([[-1.0], [0.0]])).tolist()
    [[0.0], [0.0]]
    """
    out = np.empty_like(z)
    for unit, rows in groups(units):
        out[rows] = unit(z[rows])
    return out


def derivative(units: Units, z: Array) -> Array:
    """Return phi'(z) for columns z (q, N); at a kink, the slope on its right."""
    out = np.empty_like(z)
    for unit, rows in groups(units):
        out[rows] = unit.derivative(z[rows])
    return out


def formula(units: Units, z: Any, ops: Any) -> list[Any]:
    """Return [phi_0(z_0), phi_1(z_1), ...] for an indexable z of any kind that `ops` can handle."""
    return [unit.formula(z[i], ops) for i, unit in enumerate(units)]


def slopes(units: Units) -> tuple[Array, Array]:
    """Return the lower and upper slopes (q,), the diagonals of D0 and D1 of Assumption ass:incremental_sector."""
    ends = np.array([unit.slopes for unit in units], dtype=float).reshape(-1, 2)
    return ends[:, 0], ends[:, 1]


def sectors(units: Units) -> tuple[Array, Array] | None:
    """Return the sector ends (q,), the diagonals of D0 and D1 of Assumption ass:sector, or None when some phi(0) != 0."""
    if any(unit.sector is None for unit in units):
        return None
    ends = np.array([unit.sector for unit in units], dtype=float).reshape(-1, 2)
    return ends[:, 0], ends[:, 1]


def lipschitz(units: Units) -> Array:
    """Return the largest absolute slope of each unit (q,), the diagonal of S in |phi(r) - phi(s)| <= S |r - s|."""
    low, high = slopes(units)
    return np.maximum(np.abs(low), np.abs(high))


def slopes_on(units: Units, low: Array, high: Array) -> tuple[Array, Array]:
    """Return bounds (q,) on the slopes between any two points of [low_i, high_i], unit by unit (`Activation.slopes_on`).

    >>> from inc_casadi.activations import ReLU, Saturation
    >>> slopes_on((ReLU(), Saturation()), np.array([1.0, 0.5]), np.array([2.0, 2.0]))
    (array([1., 0.]), array([1., 1.]))
    """
    out = np.empty((2, len(units)))
    for unit, rows in groups(units):
        out[:, rows] = unit.slopes_on(low[rows], high[rows])
    return out[0], out[1]


def sector_on(units: Units, center: Array, low: Array, high: Array, spread: Array) -> tuple[Array, Array]:
    """Return bounds (q,) on the slopes from center_i to points of [low_i, high_i], unit by unit (`Activation.sector_on`).

    spread: (q,) how far the centers may be from those given.

    >>> from inc_casadi.activations import Saturation
    >>> low, high = sector_on((Saturation(),), np.zeros(1), np.array([-4.0]), np.array([4.0]), np.zeros(1))
    >>> 0.2499999 < low.item() <= 0.25, high.item()
    (True, 1.0)
    """
    out = np.empty((2, len(units)))
    for unit, rows in groups(units):
        out[:, rows] = unit.sector_on(center[rows], low[rows], high[rows], spread[rows])
    return out[0], out[1]
