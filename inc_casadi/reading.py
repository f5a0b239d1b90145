"""What a matrix must answer to so that a matrix inequality can be read with it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Self

import numpy as np


class Reading(ABC):
    """A matrix that knows more about its entries than a float does.

    It answers to `@ + - * .T`, to row selection, and to `np.hstack`, `np.vstack`, `np.diag`, so to `blocks`; plain arrays
    and numbers on the other side are lifted. A kind of its own defines how entries are lifted, arranged, joined, added and
    multiplied.

    >>> from inc_casadi.readings import Rational
    >>> (np.eye(1) @ Rational.lift(np.array([[0.5]])) - 1.0).fractions().tolist()
    [[Fraction(-1, 2)]]
    """

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
