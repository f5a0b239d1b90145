"""What each ONNX operator does to a signal: affine ones are composed, activations become hidden units."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from ..activations import Logistic, Tanh
from ..arrays import Array
from ..errors import TranslationError
from .onnx_conditions import CONDITIONS, chosen
from .onnx_evaluated import EVALUATED
from .onnx_ml import LEARNED
from .onnx_moves import MOVES
from .onnx_node import Condition, Node, Value
from .signals import Signal, Stack
from .units import clipped, greater, smaller, two_slopes

FLOATS, BOOL = (1, 10, 11, 16), 9
"""ONNX's numbers of float, float16, double and bfloat16, and of truth values."""

READS_CONDITIONS = ("Cast", "Mul", "Not", "Where")
BOTH = "both factors depend on the network's input, so the product is not affine in it"


def translated(node: Node) -> tuple[Value, ...]:
    """Return what a node gives.

    Raises TranslationError for an operator without counterpart, or one that is used in a way that has none.

    >>> y = Signal.measurement((1, 2))
    >>> translated(Node("Neg", "n", {}, [y], Stack(2)))[0].coefficients.tolist()
    [[[0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]]
    """
    if node.operator not in OPERATORS:
        raise node.refused(f"the operator has no counterpart in an INC; those that have one are {', '.join(OPERATORS)}")
    if node.operator not in READS_CONDITIONS and any(isinstance(value, Condition) for value in node.inputs):
        raise node.refused("it reads a comparison that depends on the network's input, and those may only go to "
                           f"{', '.join(READS_CONDITIONS)}")
    try:
        found = OPERATORS[node.operator](node)
    except (IndexError, ValueError) as error:
        if isinstance(error, TranslationError):
            raise
        raise node.refused(str(error)) from error
    return found if isinstance(found, tuple) else (found,)


def _sum(node: Node) -> Signal:
    total = Signal.constant(np.zeros(()))
    for value in node.inputs:
        assert value is not None and not isinstance(value, Condition)
        total = total.plus(value)
    return total


def _difference(node: Node) -> Signal:
    first, second = node.inputs
    assert isinstance(first, Signal | np.ndarray) and isinstance(second, Signal | np.ndarray)
    return (first if isinstance(first, Signal) else Signal.constant(first)).minus(second)


def _product(node: Node) -> Signal:
    first, second = node.inputs
    if isinstance(second, Condition):
        first, second = second, first
    if isinstance(first, Condition):  # a number 0 or 1, as z (z > 0) has it
        if not isinstance(second, Signal):
            raise node.refused("a comparison times a constant jumps, but an INC is continuous")
        return chosen(node, first, second, second.times(np.array(0.0)))
    if isinstance(first, Signal) and isinstance(second, Signal):
        raise node.refused(f"{BOTH} (gates, SiLU and GELU are such products)")
    return first.times(second) if isinstance(first, Signal) else second.times(first)  # type: ignore[union-attr, arg-type]


def _quotient(node: Node) -> Signal:
    divisor = node.constant(1)
    if np.any(np.asarray(divisor) == 0):
        raise node.refused("it divides by zero")
    return node.signal.times(1 / np.asarray(divisor, dtype=float))


def _matmul(node: Node) -> Signal:
    first, second = node.inputs
    if isinstance(first, Signal) and isinstance(second, Signal):
        raise node.refused(BOTH)
    return first.matmul(second) if isinstance(first, Signal) else second.rmatmul(first)  # type: ignore


def _gemm(node: Node) -> Signal:
    first, second = (_turned(node, value, name) for value, name in zip(node.inputs[:2], ("transA", "transB"), strict=True))
    bare = Node("Gemm", node.name, {}, [first, second], node.stack)
    result = _matmul(bare).times(np.array(node.real("alpha", 1.0)))
    if len(node.inputs) < 3 or node.inputs[2] is None:
        return result
    beta, addend = np.array(node.real("beta", 1.0)), node.inputs[2]
    return result.plus(addend.times(beta) if isinstance(addend, Signal) else beta * addend)


def _turned(node: Node, value: Value, name: str) -> Value:
    if not node.attributes.get(name, 0):
        return value
    return value.moved(lambda a: np.swapaxes(a, 0, 1)) if isinstance(value, Signal) else np.asarray(value).T


def _normalized(node: Node) -> Signal:
    if node.attributes.get("training_mode", 0):
        raise node.refused("it normalizes by the batch (training mode): export the network for inference")
    scale, shift, mean, variance = (np.asarray(node.constant(i), dtype=float) for i in range(1, 5))
    factor = scale / np.sqrt(variance + node.real("epsilon", 1e-5))
    channels = (-1, *([1] * (len(node.signal.shape) - 2)))
    return node.signal.minus(mean.reshape(channels)).times(factor.reshape(channels)).plus(shift.reshape(channels))


def _summed(node: Node) -> Signal:
    shape, axes = node.signal.shape, node.axes(1)
    if axes is None and node.attributes.get("noop_with_empty_axes", 0):
        return node.signal
    over = tuple(node.axis(axis) for axis in axes) if axes else tuple(range(len(shape)))
    kept = bool(node.attributes.get("keepdims", 1))
    total = node.signal.moved(lambda a: np.sum(a, axis=over, keepdims=kept))
    count = float(np.prod([shape[axis] for axis in over])) if node.operator == "ReduceMean" else 1.0
    return total.times(np.array(1 / count))


def _largest(node: Node) -> Signal:
    """The largest or smallest entry along axes: of two at a time, halves against halves."""
    shape, axes = node.signal.shape, node.axes(1)
    if axes is None and node.attributes.get("noop_with_empty_axes", 0):
        return node.signal
    over = sorted(node.axis(axis) for axis in axes) if axes else list(range(len(shape)))
    rest = [axis for axis in range(len(shape)) if axis not in over]
    kept = [shape[axis] for axis in rest]
    left = node.signal.moved(lambda a: np.transpose(a, (*over, *rest, len(shape))).reshape(-1, *kept, a.shape[-1]))
    pick = greater if node.operator == "ReduceMax" else smaller
    while left.shape[0] > 1:
        half = left.shape[0] // 2
        odd = left.moved(partial(_rows, start=2 * half))
        best = pick(node.stack, left.moved(partial(_rows, stop=half)), left.moved(partial(_rows, start=half, stop=2 * half)))
        left = best if not odd.shape[0] else _stacked(best, odd)
    found = [1 if axis in over else size for axis, size in enumerate(shape)] if node.attributes.get("keepdims", 1) else kept
    return left.moved(lambda a: a.reshape(*found, a.shape[-1]))


def _rows(array: Array, start: int = 0, stop: int | None = None) -> Array:
    return array[start:stop]


def _stacked(first: Signal, second: Signal) -> Signal:
    second = second.widened(first.width)
    return Signal(np.concatenate([first.coefficients, second.coefficients]), np.concatenate([first.sizes, second.sizes]))


def _cast(node: Node) -> Value:
    to, comparison = node.attributes.get("to"), isinstance(node.inputs[0], Condition)
    if to not in FLOATS and not (comparison and to == BOOL):
        raise node.refused("it turns a signal into something else than floating point numbers")
    return node.inputs[0]


def _dropout(node: Node) -> Signal:
    if np.any(node.constant(2, None, False)):
        raise node.refused("it drops values at random (training mode): export the network for inference")
    return node.signal


def _leaky(node: Node) -> Signal:
    return node.stack.activated(node.signal, two_slopes(node.real("alpha", 0.01)))


def _leaky_each(node: Node) -> Signal:
    slopes = np.broadcast_to(np.asarray(node.constant(1), dtype=float), node.signal.shape)
    return node.stack.activated(node.signal, [two_slopes(float(slope)) for slope in slopes.ravel()])


def _clip(node: Node) -> Signal:
    low, high = node.constant(1, "min", -np.inf), node.constant(2, "max", np.inf)
    return clipped(node.stack, node.signal, float(np.asarray(low).item()), float(np.asarray(high).item()))


def _hard_sigmoid(node: Node) -> Signal:
    alpha, beta = (np.array(node.real(name, default)) for name, default in (("alpha", 0.2), ("beta", 0.5)))
    return clipped(node.stack, node.signal.times(alpha).plus(beta), 0.0, 1.0)


def _extreme(pick: Callable[[Stack, Signal, Signal | Array], Signal]) -> Callable[[Node], Signal]:
    def chosen(node: Node) -> Signal:
        values = sorted(node.inputs, key=lambda value: not isinstance(value, Signal))  # signals first
        found = values[0]
        assert isinstance(found, Signal)
        for value in values[1:]:
            assert isinstance(value, Signal | np.ndarray)
            found = pick(node.stack, found.plus(np.zeros(value.shape)), value)
        return found
    return chosen


OPERATORS: dict[str, Callable[[Node], Value | tuple[Signal, ...]]] = dict(sorted({
    "Abs": lambda node: node.stack.activated(node.signal, two_slopes(-1.0)),
    "Add": _sum, "BatchNormalization": _normalized, "Cast": _cast, "Clip": _clip, "Div": _quotient, "Dropout": _dropout,
    "Gemm": _gemm, "HardSigmoid": _hard_sigmoid, "LeakyRelu": _leaky, "MatMul": _matmul, "Max": _extreme(greater),
    "Min": _extreme(smaller), "Mul": _product, "Neg": lambda node: node.signal.times(np.array(-1.0)), "PRelu": _leaky_each,
    "ReduceMax": _largest, "ReduceMean": _summed, "ReduceMin": _largest, "ReduceSum": _summed,
    "Relu": lambda node: node.stack.activated(node.signal, two_slopes(0.0)),
    "Sigmoid": lambda node: node.stack.activated(node.signal, Logistic()), "Sub": _difference, "Sum": _sum,
    "Tanh": lambda node: node.stack.activated(node.signal, Tanh()), **CONDITIONS, **EVALUATED, **LEARNED, **MOVES,
}.items()))
"""The operators that a signal may pass; constants may pass all. Add one to have it read."""
