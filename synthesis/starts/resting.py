"""Round a law so that it rests at the origin in exact arithmetic, not only up to rounding: then its cost can be proved."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from inc_casadi.activations import ReLU, Saturation
from inc_casadi.arrays import Array
from inc_casadi.errors import InvalidInputError
from inc_casadi.inc import INC

BITS = 22  # that entries of W, V and of eta(0) keep after the binary point, beside the largest
GRID = 2.0**-BITS
KINK = 2.0**-16  # a unit this near to a kink at y = 0 is put on it


def resting(inc: INC) -> INC:
    """Return nearly the same law with u = 0 at y = 0 in exact arithmetic, where u = 0 up to rounding already.

    With discount 1 the least offset costs without end, so no exact proof can bound a law that rests beside the origin. Let
    z, eta be the hidden values at y = 0. W, V and z are rounded to multiples of a power of two, V toward zero, and then

        b = z - W eta,   d = -V eta,   eta = phi(z),

    hold without rounding, since few-digit products add up in a float. A unit with phi(z) = z needs that; one in a flat
    piece of phi has eta = 0 or +-1 and keeps its b. U and K are not touched, and no entry of W or V grows, so ||W||_inf and
    input limits about 0 that the units keep stay as they are.

    Raises InvalidInputError for units other than ReLU and Saturation, or sizes of entries that do not fit a float.

    >>> law = INC([[0.0]], [[1.0]], [[0.3]], [[-1.0]], b=[0.1], d=[-0.03])
    >>> exact = resting(law)
    >>> Fraction(exact.V[0, 0]) * Fraction(exact.b[0]) + Fraction(exact.d[0]), abs(float(exact.V[0, 0]) - 0.3) < 1e-6
    (Fraction(0, 1), True)
    """
    if not all(isinstance(unit, ReLU | Saturation) for unit in inc.activations):
        raise InvalidInputError("only ReLU and Saturation units pass a few-digit number on unchanged; this law has others")
    before = inc.hidden(np.zeros(inc.p))
    z = inc.W @ before + inc.b
    low, high, straight = _pieces(inc, z)
    eta = np.where(straight, np.clip(np.round(z / GRID) * GRID, low, high), np.round(before))
    W, V = _rounded(inc.W), _rounded(inc.V)
    law = replace(inc, W=W, V=V, b=np.where(straight, eta - W @ eta, inc.b), d=-(V @ eta))
    _require_exact(law, eta, low, high)
    return law


def _pieces(inc: INC, z: Array) -> tuple[Array, Array, np.ndarray]:
    """The least and the largest value of each unit, and which of them answer z, nearly, with phi(z) = z."""
    relu = np.array([isinstance(unit, ReLU) for unit in inc.activations], dtype=bool)
    low, high = np.where(relu, 0.0, -1.0), np.where(relu, np.inf, 1.0)
    return low, high, (z > low - KINK) & (z < high + KINK)


def _rounded(entries: Array) -> Array:
    """Entries toward zero on a grid of BITS below the largest."""
    largest = float(np.max(np.abs(entries), initial=0.0))
    if largest == 0.0:
        return entries
    step = 2.0 ** (np.ceil(np.log2(largest)) - BITS)
    return np.asarray(np.trunc(entries / step) * step)


def _require_exact(law: INC, eta: Array, low: Array, high: Array) -> None:
    exact = [Fraction(value) for value in eta]
    for i in range(law.q):
        z = _dot(law.W[i], exact) + Fraction(law.b[i])
        if exact[i] != (low[i] if z < low[i] else high[i] if z > high[i] else z):
            raise InvalidInputError(f"b of unit {i} is no float that gives eta(0): entries of W differ too much in size")
    for j in range(law.m):
        if _dot(law.V[j], exact) + Fraction(law.d[j]) != 0:
            raise InvalidInputError(f"d of output {j} is no float that makes u(0) = 0: entries of V differ too much in size")


def _dot(row: Array, exact: list[Fraction]) -> Fraction:
    return sum((Fraction(a) * b for a, b in zip(row, exact, strict=True)), Fraction(0))
