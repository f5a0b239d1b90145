"""Tensors that are affine in measurements and hidden units: what a network's graph is walked with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..activations import Activation
from ..arrays import Array
from ..inc import INC


@dataclass(frozen=True, eq=False)
class Signal:
    """A tensor of any shape whose entries are affine in (y, eta): coefficients of (1, y, eta) along one more axis.

    coefficients : (*shape, 1 + p + q)
    sizes : the same with all numbers that were ever added up taken absolutely, by which rounding is judged

    >>> y = Signal.measurement((1, 2))
    >>> y.matmul(np.array([[2.0], [3.0]])).plus(np.array([1.0])).coefficients.tolist()
    [[[1.0, 2.0, 3.0]]]
    """

    coefficients: Array
    sizes: Array

    @classmethod
    def measurement(cls, shape: tuple[int, ...]) -> Signal:
        """Return y itself in a shape, its entries in C order."""
        p = int(np.prod(shape, dtype=int))
        unit = np.eye(p, 1 + p, 1).reshape(*shape, 1 + p)
        return cls(unit, unit)

    @classmethod
    def constant(cls, value: Array) -> Signal:
        """Return a constant as a signal."""
        coefficients = np.asarray(value, dtype=float)[..., None]
        return cls(coefficients, np.abs(coefficients))

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the tensor."""
        return self.coefficients.shape[:-1]

    @property
    def width(self) -> int:
        """1 + p + q."""
        return self.coefficients.shape[-1]

    def widened(self, width: int) -> Signal:
        """Return the signal with zeros for further hidden units."""
        more = [(0, 0)] * len(self.shape) + [(0, width - self.width)]
        return Signal(np.pad(self.coefficients, more), np.pad(self.sizes, more))

    def moved(self, rearrange: Callable[[Array], Array]) -> Signal:
        """Return the signal with its entries moved, selected or summed by a function that leaves the last axis alone."""
        return Signal(rearrange(self.coefficients), rearrange(self.sizes))

    def plus(self, other: Signal | Array) -> Signal:
        """Return the sum with another signal or a constant, broadcast."""
        other = other if isinstance(other, Signal) else Signal.constant(other)
        width = max(self.width, other.width)
        first, second = self.widened(width), other.widened(width)
        return Signal(first.coefficients + second.coefficients, first.sizes + second.sizes)

    def times(self, factor: Array) -> Signal:
        """Return the elementwise product with a constant, broadcast."""
        factor = np.asarray(factor, dtype=float)[..., None]
        return Signal(self.coefficients * factor + 0.0, self.sizes * np.abs(factor))  # + 0.0: no negative zeros

    def minus(self, other: Signal | Array) -> Signal:
        """Return the difference to another signal or a constant, broadcast."""
        return self.plus(other.times(np.array(-1.0)) if isinstance(other, Signal) else -np.asarray(other, dtype=float))

    def matmul(self, right: Array) -> Signal:
        """Return the matrix product signal @ right, as NumPy's matmul has it."""
        right = np.asarray(right, dtype=float)
        return Signal(_product(self.coefficients, right), _product(self.sizes, np.abs(right)))

    def rmatmul(self, left: Array) -> Signal:
        """Return left @ signal likewise."""
        left = np.asarray(left, dtype=float)
        if len(self.shape) == 1:
            return self.matmul(left if left.ndim == 1 else np.swapaxes(left, -1, -2))
        turned = self.moved(lambda a: np.swapaxes(a, -2, -3))
        if left.ndim == 1:
            return turned.matmul(left)
        return turned.matmul(np.swapaxes(left, -1, -2)).moved(lambda a: np.swapaxes(a, -2, -3))


def _product(signal: Array, right: Array) -> Array:
    # The coefficients come first, as matrices that are multiplied side by side.
    single = signal.ndim == 2
    front = np.moveaxis(signal[None] if single else signal, -1, 0)
    more = [1] * max(right.ndim + 1 - front.ndim, 0)
    found = np.matmul(front.reshape(front.shape[0], *more, *front.shape[1:]), right)
    if single:
        found = found[..., 0] if right.ndim == 1 else found[..., 0, :]
    return np.moveaxis(found, 0, -1)


class Stack:
    """The hidden units met so far on the way through a network."""

    def __init__(self, p: int) -> None:
        self.p = p
        self.rows: list[Array] = []
        self.sizes: list[Array] = []
        self.units: list[Activation] = []

    def activated(self, signal: Signal, activations: Activation | Sequence[Activation]) -> Signal:
        """Return phi(signal) as a signal: each entry is a new hidden unit that reads the signal's entry.

        activations : one, or one per entry in C order
        """
        count, before = int(np.prod(signal.shape, dtype=int)), 1 + self.p + len(self.units)
        self.rows += list(signal.coefficients.reshape(count, -1))
        self.sizes += list(signal.sizes.reshape(count, -1))
        self.units += [activations] * count if isinstance(activations, Activation) else list(activations)
        unit = np.eye(count, before + count, before).reshape(*signal.shape, before + count)
        return Signal(unit, unit)

    def controller(self, output: Signal) -> INC:
        """Return the INC whose u are the entries of a signal in C order."""
        return self._assembled(self.rows, output.coefficients)

    def majorant(self, output: Signal) -> INC:
        """Return the INC of the sizes, the units' activations kept: |W|, |U| and so on before anything cancelled."""
        return self._assembled(self.sizes, output.sizes)

    def _assembled(self, rows: list[Array], output: Array) -> INC:
        q, width = len(self.units), 1 + self.p + len(self.units)
        hidden = np.array([np.pad(row, (0, width - len(row))) for row in rows]).reshape(q, width)
        output = output.reshape(-1, output.shape[-1])
        output = np.pad(output, [(0, 0), (0, width - output.shape[1])])
        last = 1 + self.p
        return INC(hidden[:, last:], hidden[:, 1:last], output[:, last:], output[:, 1:last], hidden[:, 0], output[:, 0],
                   tuple(self.units))
