"""Two more kinds of matrices that a matrix inequality can be read with: rounding bounded, and no rounding at all.

Both answer to `@ + - * .T`, to row selection, and to `np.hstack`, `np.vstack`, `np.diag` (so to `blocks`), and lift
plain float arrays by themselves, so the inequality that CVXPY searches with is the one that is checked here.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import lcm
from typing import Any, Self

import numpy as np

from .arrays import Array
from .blocks import exact


class Reading(ABC):
    """A matrix that knows more about its entries than a float does."""

    __array_ufunc__ = None  # lets `ndarray @ reading` come to __rmatmul__

    @classmethod
    @abstractmethod
    def lift(cls, value: Any) -> Self:
        """Return a plain array, or a number, as this kind; the stored doubles are taken as they are."""

    @abstractmethod
    def arranged(self, rule: Callable[[Any], Any]) -> Self:
        """Return the same entries in another arrangement."""

    @abstractmethod
    def joined(self, rule: Callable[[Any], Any], others: Sequence[Self]) -> Self:
        """Return this and other matrices as one."""

    @abstractmethod
    def plus(self, other: Self) -> Self:
        """Return the sum."""

    @abstractmethod
    def times(self, other: Self, product: Callable[[Any, Any], Any], terms: int) -> Self:
        """Return a product whose entries are sums of `terms` products."""

    @property
    @abstractmethod
    def shape(self) -> tuple[int, ...]:
        """Shape, as of an array."""

    @property
    def T(self) -> Self:
        """The transpose."""
        return self.arranged(np.transpose)

    def __getitem__(self, index: Any) -> Self:
        return self.arranged(lambda array: array[index])

    def __neg__(self) -> Self:
        return self * -1.0

    def __add__(self, other: Any) -> Self:
        return self.plus(self._lifted(other))

    __radd__ = __add__

    def __sub__(self, other: Any) -> Self:
        return self + (-self._lifted(other))

    def __rsub__(self, other: Any) -> Self:
        return self._lifted(other) + (-self)

    def __mul__(self, other: Any) -> Self:
        return self.times(self._lifted(other), np.multiply, 1)

    __rmul__ = __mul__

    def __matmul__(self, other: Any) -> Self:
        return self.times(self._lifted(other), np.matmul, self.shape[-1])

    def __rmatmul__(self, other: Any) -> Self:
        return self._lifted(other) @ self

    def _lifted(self, other: Any) -> Self:
        return other if isinstance(other, type(self)) else self.lift(other)

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        if function in (np.hstack, np.vstack) and not kwargs:
            first, *rest = (self._lifted(value) for value in args[0])
            return first.joined(function, rest)
        if function is np.diag and not kwargs:
            return args[0].arranged(np.diag)
        return NotImplemented


@dataclass(frozen=True, eq=False)
class Rounded(Reading):
    """Floats with a bound on their rounding error.

    value: what floating point computed; size: the same expression with every term taken absolutely; steps: the
    number of roundings that a term has gone through at most. The exact result differs from `value` by at most
    gamma_steps size, gamma_k = k u / (1 - k u), u = 2^-53 (Higham, Accuracy and Stability of Numerical Algorithms, sec.
    3.1), as long as nothing underflows.

    >>> third = Rounded.lift(np.array([[0.1]])) * 3.0
    >>> abs(third.value.item() - 0.3) <= third.error.item() < 1e-15
    True
    """

    value: Array
    size: Array
    steps: int

    @classmethod
    def lift(cls, value: Any) -> Rounded:
        """Return floats, taken to be exact as they stand."""
        array = np.asarray(value, dtype=float)
        return cls(array, np.abs(array), 0)

    @property
    def error(self) -> Array:
        """Entrywise bound on |value - exact|; twice gamma, which covers the rounding of `size` itself."""
        return (self.steps + 4) * np.finfo(float).eps * self.size

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape, as of an array."""
        return self.value.shape

    def arranged(self, rule: Callable[[Any], Any]) -> Rounded:
        """Return the same entries in another arrangement."""
        return Rounded(rule(self.value), rule(self.size), self.steps)

    def joined(self, rule: Callable[[Any], Any], others: Sequence[Rounded]) -> Rounded:
        """Return this and other matrices as one."""
        parts = (self, *others)
        return Rounded(rule([part.value for part in parts]), rule([part.size for part in parts]),
                       max(part.steps for part in parts))

    def plus(self, other: Rounded) -> Rounded:
        """Return the sum: one rounding more."""
        return Rounded(self.value + other.value, self.size + other.size, max(self.steps, other.steps) + 1)

    def times(self, other: Rounded, product: Callable[[Any, Any], Any], terms: int) -> Rounded:
        """Return the product: one rounding for the product and one for each further term."""
        return Rounded(product(self.value, other.value), product(self.size, other.size),
                       self.steps + other.steps + terms)


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
        fractions = exact(value)
        denominator = lcm(*(entry.denominator for entry in fractions.flat))
        numbers = np.empty(fractions.shape, dtype=object)
        for index, entry in np.ndenumerate(fractions):
            numbers[index] = entry.numerator * (denominator // entry.denominator)
        return cls(numbers, denominator)

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
        return Rational(np.asarray(product(self.numbers, other.numbers), dtype=object),
                        self.denominator * other.denominator)
