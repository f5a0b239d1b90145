"""Two more kinds of matrices that a matrix inequality can be read with: rounding bounded, and no rounding at all.

Both lift plain float arrays by themselves (see `Reading`), so the inequality that CVXPY searches with is the one that is
checked here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import lcm
from typing import Any

import numpy as np

from .arrays import Array
from .integers import over_common_denominator
from .integers import product as integer_product
from .reading import Reading

EPS = float(np.finfo(float).eps)
FLUSHED = 2.0**-1020  # more than is lost when both operands below 2^-1022 are read as zero and the result is stored as zero
SAFE_EXPONENT = -900  # terms from 2^-900 are multiples of 2^-1004, and so is every sum of them: nothing underflows
MOST_STEPS = 2**40  # keeps gamma below 2^-12


@dataclass(frozen=True, eq=False)
class Rounded(Reading):
    """Floats with a bound on their rounding error, underflow included.

    value: what floating point computed; size: the same expression with every term taken absolutely; steps: the
    number of roundings that a term has gone through at most; lost: what underflow has taken from any entry at most. With
    S the size without rounding, both |value - exact| and |size - S| are at most gamma_steps S + lost, entry by entry,
    gamma_k = k u / (1 - k u), u = 2^-53 (Higham, Accuracy and Stability of Numerical Algorithms, sec. 3.1), for every
    order of summation and with or without fused multiply-add. `lost` stays 0 as long as the exponents of the operands
    show that nothing can underflow, so an exact zero keeps the bound 0. Otherwise reading an operand and storing a result
    may each replace a number below 2^-1022 by zero (gradual underflow loses less), and a product of n terms loses at most

        2 n ((max S_1 + lost_1) lost_2 + lost_1 (max S_2 + lost_2) + 2^-1020),

    in which the 2 covers the factors 1 + gamma and the rounding of `lost` itself.

    >>> third = Rounded.lift(np.array([[0.1]])) * 3.0
    >>> abs(third.value.item() - 0.3) <= third.error.item() < 1e-15
    True
    """

    value: Array
    size: Array
    steps: int
    lost: float = 0.0

    @classmethod
    def lift(cls, value: Any) -> Rounded:
        """Return floats, taken to be exact as they stand; or the floats nearest to Fractions, one rounding away."""
        array = np.asarray(value)
        if array.dtype != object:
            array = array.astype(float)
            return cls(array, np.abs(array), 0)
        nearest = np.array([_nearest(entry) for entry in array.flat], dtype=float).reshape(array.shape)
        small = any(0 < abs(entry) < Fraction(2) ** SAFE_EXPONENT for entry in array.flat)
        return cls(nearest, np.abs(nearest), 1, FLUSHED if small else 0.0)

    @property
    def error(self) -> Array:
        """Entrywise bound on |value - exact|; twice gamma and twice `lost`, which covers the rounding of both.

        Infinite after 2^40 steps: gamma is then no longer small against 1.
        """
        if self.steps > MOST_STEPS:
            return np.full(self.shape, np.inf)
        factor = (self.steps + 4) * EPS if self.steps else 0.0
        return factor * self.size + 2 * self.lost

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape, as of an array."""
        return self.value.shape

    def arranged(self, rule: Callable[[Any], Any]) -> Rounded:
        """Return the same entries in another arrangement."""
        return Rounded(rule(self.value), rule(self.size), self.steps, self.lost)

    def joined(self, rule: Callable[[Any], Any], others: Sequence[Rounded]) -> Rounded:
        """Return this and other matrices as one."""
        parts = (self, *others)
        return Rounded(rule([part.value for part in parts]), rule([part.size for part in parts]),
                       max(part.steps for part in parts), max(part.lost for part in parts))

    def plus(self, other: Rounded) -> Rounded:
        """Return the sum: one rounding more."""
        is_safe = min(self._exponent, other._exponent) >= SAFE_EXPONENT
        return Rounded(self.value + other.value, self.size + other.size, max(self.steps, other.steps) + 1,
                       self.lost + other.lost + (0.0 if is_safe else FLUSHED))

    def times(self, other: Rounded, product: Callable[[Any, Any], Any], terms: int) -> Rounded:
        """Return the product: one rounding for the product and one for each further term."""
        flushed = 0.0 if self._exponent + other._exponent >= SAFE_EXPONENT else FLUSHED
        lost, other_lost = self.lost + flushed, other.lost + flushed  # as read
        largest, other_largest = (float(np.max(part.size, initial=0.0)) + part.lost for part in (self, other))
        return Rounded(product(self.value, other.value), product(self.size, other.size), self.steps + other.steps + terms,
                       2 * terms * ((largest + lost) * other_lost + lost * (other_largest + other_lost) + flushed))

    @cached_property
    def _exponent(self) -> int:
        """Exponent of the smallest nonzero magnitude, 0 at most; from its bits, which no processor mode reads as zero."""
        bits = np.abs(np.concatenate((self.value.ravel(), self.size.ravel()))).view(np.int64)
        return min(0, (int(np.min(bits[bits > 0], initial=2**62)) >> 52) - 1023)


@dataclass(frozen=True, eq=False)
class Rational(Reading):
    """Exact rational matrices: an array of Python integers over one positive denominator.

    The same numbers as an array of Fractions, some twenty times faster to multiply.

    >>> half = Rational.lift(np.array([[0.5]]))
    >>> (half @ half + half).fractions().tolist()
    [[Fraction(3, 4)]]
    """

    numbers: np.ndarray
    denominator: int

    @classmethod
    def lift(cls, value: Any) -> Rational:
        """Return floats or Fractions exactly."""
        return cls(*over_common_denominator(value))

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape, as of an array."""
        return self.numbers.shape

    def fractions(self) -> np.ndarray:
        """Return the entries as Fractions."""
        out = np.empty(self.shape, dtype=object)
        for index, entry in np.ndenumerate(self.numbers):
            out[index] = Fraction(entry, self.denominator)
        return out

    def arranged(self, rule: Callable[[Any], Any]) -> Rational:
        """Return the same entries in another arrangement."""
        return Rational(np.asarray(rule(self.numbers), dtype=object), self.denominator)

    def joined(self, rule: Callable[[Any], Any], others: Sequence[Rational]) -> Rational:
        """Return this and other matrices as one."""
        parts = (self, *others)
        common = lcm(*(part.denominator for part in parts))
        return Rational(rule([part.over(common) for part in parts]), common)

    def over(self, common: int) -> np.ndarray:
        """Return the integers over a multiple of the denominator."""
        return self.numbers * (common // self.denominator)

    def plus(self, other: Rational) -> Rational:
        """Return the sum."""
        common = lcm(self.denominator, other.denominator)
        return Rational(np.asarray(self.over(common) + other.over(common), dtype=object), common)

    def times(self, other: Rational, product: Callable[[Any, Any], Any], terms: int) -> Rational:
        """Return the product."""
        rule = integer_product if product is np.matmul else product
        return Rational(np.asarray(rule(self.numbers, other.numbers), dtype=object), self.denominator * other.denominator)


def _nearest(entry: Any) -> float:
    """Return the float nearest to a Fraction or an integer; an infinity when it is too large for one."""
    try:
        return float(entry)
    except OverflowError:
        return float("inf") if entry > 0 else float("-inf")
