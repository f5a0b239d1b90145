"""ONNX comparisons, and choices by them: where the two values agree at the threshold the choice is one ReLU."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import Array
from .onnx_node import Condition, Node, Value
from .signals import Signal
from .units import two_slopes

ROUNDINGS = 8.0
"""So many rounding units of what was added up may two rows differ by and still count as multiples of one another."""


def _greater(node: Node) -> Condition:
    return Condition(_signal(node, 0).minus(_signal(node, 1)))


def _less(node: Node) -> Condition:
    return Condition(_signal(node, 1).minus(_signal(node, 0)))


def _not(node: Node) -> Condition:
    condition = node.inputs[0]
    assert isinstance(condition, Condition)
    return Condition(condition.difference.times(np.array(-1.0)))


def _where(node: Node) -> Signal:
    condition = node.inputs[0]
    if isinstance(condition, Condition):
        return chosen(node, condition, _signal(node, 1), _signal(node, 2))
    mask = np.asarray(condition, dtype=float)
    return _signal(node, 1).times(mask).plus(_signal(node, 2).times(1 - mask))


def chosen(node: Node, condition: Condition, first: Signal, second: Signal) -> Signal:
    """Return first where a condition d > 0 holds, second elsewhere, entry by entry.

    With first - second = k d the choice is second + k relu(d), and is continuous; with first = r d and second = l d it is
    one unit with these slopes, and a ReLU where one of them is zero. Multiples are recognized up to rounding.

    Raises TranslationError for an entry where the two differ at d = 0: an INC is continuous.

    >>> from .signals import Stack
    >>> stack, z = Stack(1), Signal.measurement((1,))
    >>> u = chosen(Node("Where", "n", {}, [], stack), Condition(z), z, z.times(np.array(0.25)))
    >>> stack.units, stack.controller(u)([[2.0, -2.0]]).tolist()
    ([LeakyReLU(slope=0.25)], [[2.0, -0.5]])
    """
    zero = np.zeros(np.broadcast_shapes(condition.shape, first.shape, second.shape))
    drive, right, left = (signal.plus(zero) for signal in (condition.difference, first, second))
    below, above = _ratios(left, drive), _ratios(right, drive)
    if not np.any(below):
        return node.stack.activated(drive, two_slopes(0.0)).times(above) if not np.isnan(above).any() else _jump(node)
    if not np.any(above) and not np.isnan(below).any():
        return node.stack.activated(drive.times(np.array(-1.0)), two_slopes(0.0)).times(-below)
    if not np.isnan(below + above).any():
        units = [two_slopes(float(l), float(r)) for l, r in zip(below.ravel(), above.ravel(), strict=True)]
        return node.stack.activated(drive, units)
    steps = _ratios(right.minus(left), drive)
    return node.stack.activated(drive, two_slopes(0.0)).times(steps).plus(left) if not np.isnan(steps).any() else _jump(node)


def _jump(node: Node) -> Signal:
    raise node.refused("the two values differ where the condition changes, so it jumps there, but an INC is continuous")


def _ratios(multiple: Signal, signal: Signal) -> Array:
    """The factor of each entry of the first that makes it from the second, or NaN."""
    width = max(multiple.width, signal.width)
    multiple, signal = multiple.widened(width), signal.widened(width)
    top, row = multiple.coefficients.reshape(-1, width), signal.coefficients.reshape(-1, width)
    at = np.arange(len(row)), np.argmax(np.abs(row), axis=1)
    pivot = row[at]
    factor = np.divide(top[at], pivot, out=np.zeros(len(row)), where=pivot != 0)
    sizes = multiple.sizes.reshape(-1, width) + np.abs(factor)[:, None] * signal.sizes.reshape(-1, width)
    apart = np.abs(top - factor[:, None] * row) > ROUNDINGS * np.finfo(float).eps * sizes
    return np.where(apart.any(axis=1), np.nan, factor + 0.0).reshape(signal.shape)


def _signal(node: Node, place: int) -> Signal:
    value = node.inputs[place]
    if isinstance(value, Condition):
        raise node.refused(f"its input {place} is a comparison that depends on the network's input, not a number")
    return value if isinstance(value, Signal) else Signal.constant(np.asarray(value, dtype=float))


CONDITIONS: dict[str, Callable[[Node], Value]] = {
    "Greater": _greater, "GreaterOrEqual": _greater, "Less": _less, "LessOrEqual": _less, "Not": _not, "Where": _where,
}
"""What each of them gives."""
