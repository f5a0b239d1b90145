"""Numbers of 256 binary places: as quick as Python integers, and their rounding is one known step."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from math import isinf, ldexp
from typing import Any

import numpy as np

PLACES = 256
ONE = 1 << PLACES
RESOLUTION = 2.0**-PLACES
WHOLE = (int, np.integer)


class Fixed:
    """The number n 2^-256. Sums are exact; products and quotients are rounded down, so by less than 2^-256.

    Whole numbers are taken exactly; of floats only infinities are, and only to be compared with or subtracted from.

    >>> third = Fixed(ONE) / 3
    >>> float(third * 3) == 1.0, third * 3 < 1, third > float("-inf")
    (True, True, True)
    """

    __slots__ = ("n",)

    def __init__(self, n: int) -> None:
        self.n = n

    def __add__(self, other: Any) -> Any:
        if type(other) is Fixed:
            return Fixed(self.n + other.n)
        if isinstance(other, WHOLE):
            return Fixed(self.n + int(other) * ONE)
        return _infinite(other) if type(other) is float else NotImplemented

    __radd__ = __add__

    def __neg__(self) -> Fixed:
        return Fixed(-self.n)

    def __sub__(self, other: Any) -> Any:
        if type(other) is Fixed:
            return Fixed(self.n - other.n)
        return NotImplemented if isinstance(other, np.ndarray) else self + (-other)

    def __rsub__(self, other: Any) -> Any:
        return NotImplemented if isinstance(other, np.ndarray) else (-self) + other

    def __mul__(self, other: Any) -> Any:
        if type(other) is Fixed:
            return Fixed((self.n * other.n) >> PLACES)
        return Fixed(self.n * int(other)) if isinstance(other, WHOLE) else NotImplemented

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        if type(other) is Fixed:
            return Fixed((self.n << PLACES) // other.n)
        return Fixed(self.n // int(other)) if isinstance(other, WHOLE) else NotImplemented

    def __abs__(self) -> Fixed:
        return Fixed(abs(self.n))

    def __float__(self) -> float:
        return self.n / ONE

    def __lt__(self, other: Any) -> bool:
        return self.n < _places(other)

    def __le__(self, other: Any) -> bool:
        return self.n <= _places(other)

    def __gt__(self, other: Any) -> bool:
        return self.n > _places(other)

    def __ge__(self, other: Any) -> bool:
        return self.n >= _places(other)

    def fraction(self) -> Fraction:
        """Return the same number as a Fraction."""
        return Fraction(self.n, ONE)


def _places(other: Any) -> int | float:
    if type(other) is Fixed:
        return other.n
    return ldexp(other, PLACES) if type(other) is float else int(other) * ONE


def _infinite(value: float) -> float:
    if not isinf(value):
        raise TypeError(f"the float {value!r} must be rounded to a Fixed before it is added to one")
    return value


def _round(value: Any) -> Any:
    if isinstance(value, float | np.floating) and not np.isfinite(value):
        return float(value)
    fraction = Fraction(value)
    return Fixed((fraction.numerator << PLACES) // fraction.denominator)


_rounded: Callable[[Any], Any] = np.frompyfunc(_round, 1, 1)


def rounded(array: Any) -> Any:
    """Return floats or Fractions rounded down to 256 binary places; infinities stay floats.

    >>> [float(entry) for entry in rounded(np.array([0.5, -2.0, np.inf]))]
    [0.5, -2.0, inf]
    """
    return np.asarray(_rounded(array), dtype=object)
