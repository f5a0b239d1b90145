"""Where the loop rests, as exact numbers or as numbers known to lie between two exact ones."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..exact_rest import rest_point
from ..loop import ClosedLoop

Numbers = np.ndarray


@dataclass(frozen=True, eq=False)
class Rest:
    """An equilibrium that is proved to exist, with bounds on its coordinates; all arrays hold Fractions.

    x_low <= x* <= x_high (n,), z_low <= z* <= z_high (q,), u_low <= u* <= u_high (m,): the state, the pre-activations and
    the input at rest. Equal bounds mean that the number itself is known.

    >>> zero = np.array([Fraction(0)])
    >>> Rest.at(zero, zero, zero).center.tolist()
    [0.0]
    """

    x_low: Numbers
    x_high: Numbers
    z_low: Numbers
    z_high: Numbers
    u_low: Numbers
    u_high: Numbers

    @classmethod
    def at(cls, x: Numbers, z: Numbers, u: Numbers) -> Rest:
        """Return the rest at known Fractions x (n,), z (q,), u (m,)."""
        return cls(x, x, z, z, u, u)

    @property
    def center(self) -> Array:
        """The floats nearest to the middle of the bounds on x*, (n,)."""
        return np.array([float((low + high) / 2) for low, high in zip(self.x_low, self.x_high, strict=True)])

    def input_room(self, H: Array, h: Array) -> Numbers:
        """Return h - H u* in Fractions, or a lower bound of it; H (k, m), h (k,)."""
        return _room(H, h, self.u_low, self.u_high)

    def state_room(self, H: Array, h: Array) -> Numbers:
        """Return h - H x* in Fractions, or a lower bound of it; H (k, n), h (k,)."""
        return _room(H, h, self.x_low, self.x_high)

    def unit_room(self, low: float, high: float) -> Numbers:
        """Return min(high - z*, z* - low) in Fractions, or a lower bound of it, one for each hidden unit."""
        return np.array([min(Fraction(high) - above, below - Fraction(low))
                         for below, above in zip(self.z_low, self.z_high, strict=True)], dtype=object)


def _room(H: Array, h: Array, low: Numbers, high: Numbers) -> Numbers:
    rows = exact(H)
    worst = [sum((max(a * l, a * u) for a, l, u in zip(row, low, high, strict=True)), Fraction(0)) for row in rows]
    return np.array([limit - value for limit, value in zip(exact(h), worst, strict=True)], dtype=object)


def rest_of(loop: ClosedLoop) -> Rest | None:
    """Return where the loop rests, exactly or between proved bounds, or None when neither was settled.

    The origin when the controller preserves it, else the equilibrium that `exact_rest.rest_point` solves for in Fractions,
    else the one that `enclosed_rest` proves to exist in a small box.

    >>> from inc_casadi import INC, Plant, close_loop
    >>> [float(u) for u in rest_of(close_loop(Plant([[0.5]], [[1.0]]), INC.linear([[0.0]]))).u_low]
    [0.0]
    """
    if loop.inc.preserves_origin:
        zeros = [np.full(size, Fraction(0), dtype=object) for size in (loop.n, loop.q, loop.inc.m)]
        return Rest.at(*zeros)
    from .enclosed_rest import enclosed_rest  # which returns a Rest
    point = rest_point(loop.plant, loop.inc)
    return enclosed_rest(loop) if point is None else Rest.at(point.x, point.z, point.u)
