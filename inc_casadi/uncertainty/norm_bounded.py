"""A plant whose A and B are off by a matrix of bounded norm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, matrix, number
from ..blocks import diag
from ..errors import DimensionError
from ..figures import at_least
from ..loop import ClosedLoop
from ..multipliers.base import Unknown, constant
from ..plant import Plant
from .base import Uncertainty


@dataclass(frozen=True, eq=False)
class NormBounded(Uncertainty):
    """x+ (or dx/dt) = (A + E D N_x) x + (B + E D N_u) u for every D with ||D||_2 <= size, time-varying ones included.

    w = D v with v = N_x x + N_u u has w'w <= size^2 v'v, so tau (size^2 v'v - w'w) >= 0 for tau >= 0: sound. It holds as
    well for a stable dynamic D of that gain, started at rest, in sums over time.

    E (n, r), in state units per w; N_x (l, n); N_u (l, m), zero when left out; size >= 0.
    Raises DimensionError, InvalidInputError.

    >>> NormBounded([[1.0]], [[0.1]], size=0.5).size
    0.5
    """

    E: Array
    N_x: Array
    N_u: Array | None = None
    size: float = 1.0

    if TYPE_CHECKING:  # what the constructor takes is wider than what the fields hold
        def __init__(self, E: ArrayLike, N_x: ArrayLike, N_u: ArrayLike | None = None, size: float = 1.0) -> None: ...

    def __post_init__(self) -> None:
        for name in ("E", "N_x", "N_u"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, matrix(name, getattr(self, name)))
        object.__setattr__(self, "size", number("size", self.size, 0.0))

    def check(self, plant: Plant) -> None:
        """Raise DimensionError when E, N_x or N_u do not fit the plant."""
        wanted = {"E": (plant.n, self.E.shape[1]), "N_x": (self.N_x.shape[0], plant.n),
                  "N_u": (self.N_x.shape[0], plant.m)}
        for name, shape in wanted.items():
            value = getattr(self, name)
            if value is not None and value.shape != shape:
                raise DimensionError(f"{name} has shape {value.shape}, but the plant has {plant.n} states and {plant.m} "
                                     f"inputs, so it must be {shape}")

    def entry(self, plant: Plant) -> Array:
        """Return E."""
        return self.E

    def unknowns(self, plant: Plant) -> tuple[Unknown, ...]:
        """Return tau (1,)."""
        return (Unknown("tau", (1,), "nonnegative"),)

    def matrix(self, loop: ClosedLoop, w: Array, values: dict[str, Any]) -> Any:
        """Return tau (size^2 v'v - w'w)."""
        v = constant(loop, self.N_x) @ loop.X[: loop.n, :]
        if self.N_u is not None:
            v = v + constant(loop, self.N_u) @ loop.G
        rows, size = v.shape[0], constant(loop, self.size)
        weight, unit = diag(values["tau"]), constant(loop, np.ones((1, 1)))
        total: Any = 0.0
        for i in range(rows):
            total = v[i: i + 1, :].T @ ((size * size) * (unit @ weight)) @ v[i: i + 1, :] + total
        for i in range(w.shape[0]):
            total = w[i: i + 1].T @ (-1.0 * (unit @ weight)) @ w[i: i + 1] + total
        return total

    def words(self, dynamic: bool) -> str:
        """Return the set in words."""
        kinds = "time-varying and stable dynamic ones included" if dynamic else "time-varying ones included"
        return f"perturbation A + E D N_x, B + E D N_u of the plant with ||D|| <= {at_least(self.size)}, {kinds}"
