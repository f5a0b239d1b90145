"""Functions of networks elsewhere, written with the activations that there are."""

from __future__ import annotations

from math import isfinite

import numpy as np

from ..activations import LeakyReLU, ReLU, Saturation, TwoSlopes
from ..arrays import Array
from ..errors import InvalidInputError
from ..inc import inner_half
from ..sets import Box
from .signals import Signal, Stack


def clipped(stack: Stack, signal: Signal, low: float, high: float) -> Signal:
    """Return min(max(z, low), high) entry by entry.

    Between finite limits c -+ h it is c + h sat((z - c) / h), rounded inwards so that it stays within them; with one
    limit a shifted ReLU, low + relu(z - low) or high - relu(high - z); without any z itself.

    Raises InvalidInputError when low > high or an end is NaN.

    >>> stack = Stack(1)
    >>> u = clipped(stack, Signal.measurement((1,)), 0.0, 6.0)
    >>> stack.controller(u)([[-1.0, 2.0, 7.0]]).tolist()
    [[0.0, 2.0, 6.0]]
    """
    if not low <= high:
        raise InvalidInputError(f"the limits [{low:g}, {high:g}] are not an interval")
    if low == high:
        return signal.times(np.array(0.0)).plus(np.full(signal.shape, low))
    if isfinite(low) and isfinite(high):
        center, half = (float(end[0]) for end in inner_half(Box([low], [high])))
        scaled = signal.minus(np.array(center)).times(np.array(1 / half))
        return stack.activated(scaled, Saturation()).times(np.array(half)).plus(np.array(center))
    if isfinite(low):
        return stack.activated(signal.minus(np.array(low)), ReLU()).plus(np.array(low))
    if isfinite(high):
        return stack.activated(signal.minus(np.array(high)).times(np.array(-1.0)), ReLU()).times(np.array(-1.0)).plus(
            np.array(high))
    return signal


def greater(stack: Stack, first: Signal, second: Signal | Array) -> Signal:
    """Return max(first, second) entry by entry, as second + relu(first - second).

    >>> stack = Stack(2)
    >>> y = Signal.measurement((2,))
    >>> u = greater(stack, y.moved(lambda a: a[:1]), y.moved(lambda a: a[1:]))
    >>> stack.controller(u)([[1.0, 2.0], [3.0, -4.0]]).tolist()
    [[3.0, 2.0]]
    """
    return stack.activated(first.minus(second), ReLU()).plus(second)


def smaller(stack: Stack, first: Signal, second: Signal | Array) -> Signal:
    """Return min(first, second) entry by entry, as first - relu(first - second).

    >>> stack = Stack(1)
    >>> stack.controller(smaller(stack, Signal.measurement((1,)), np.array([2.0])))([[1.0, 5.0]]).tolist()
    [[1.0, 2.0]]
    """
    over = stack.activated(first.minus(second), ReLU())
    return first.minus(over)


def two_slopes(left: float, right: float = 1.0) -> ReLU | LeakyReLU | TwoSlopes:
    """Return the unit with slope `left` below zero and `right` above, the simplest that there is.

    >>> two_slopes(0.0), two_slopes(0.25), two_slopes(-1.0)
    (ReLU(), LeakyReLU(slope=0.25), TwoSlopes(left=-1.0, right=1.0))
    """
    if right == 1.0 and left == 0.0:
        return ReLU()
    return LeakyReLU(left) if right == 1.0 and 0.0 <= left <= 1.0 else TwoSlopes(left, right)
