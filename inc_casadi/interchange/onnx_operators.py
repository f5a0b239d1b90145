"""What each ONNX operator does to a signal: affine ones are composed, activations become hidden units."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..activations import Logistic, Tanh
from ..arrays import Array
from ..errors import TranslationError
from .signals import Signal, Stack
from .units import clipped, greater, smaller, two_slopes

Value = Signal | np.ndarray | None


@dataclass(frozen=True, eq=False)
class Node:
    """One node of a graph: its operator, its attributes as Python values, what it reads, and the units met so far."""

    operator: str
    name: str
    attributes: Mapping[str, Any]
    inputs: Sequence[Value]
    stack: Stack
    outputs: int = 1

    @property
    def signal(self) -> Signal:
        """What it reads first."""
        first = self.inputs[0]
        if not isinstance(first, Signal):
            raise self.refused("its first input does not depend on the network's input")
        return first

    def constant(self, place: int, attribute: str | None = None, default: Any = None) -> Any:
        """Return a constant input, or else an attribute as older operator sets have it, or else the default."""
        if place < len(self.inputs) and self.inputs[place] is not None:
            value = self.inputs[place]
            if isinstance(value, Signal):
                raise self.refused(f"its input {place} depends on the network's input, but only constants are admitted")
            return value
        return self.attributes.get(attribute, default) if attribute else default

    def real(self, attribute: str, default: float) -> float:
        """Return an attribute that is a number; ONNX has those, defaults included, in single precision."""
        return float(np.float32(self.attributes.get(attribute, default)))

    def refused(self, why: str) -> TranslationError:
        """Return the error that names the node."""
        return TranslationError(f"node {self.name!r} ({self.operator}): {why}")


def translated(node: Node) -> tuple[Value, ...]:
    """Return what a node gives.

    Raises TranslationError for an operator without counterpart, or one that is used in a way that has none.

    >>> y = Signal.measurement((1, 2))
    >>> translated(Node("Neg", "n", {}, [y], Stack(2)))[0].coefficients.tolist()
    [[[0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]]
    """
    if node.operator not in OPERATORS:
        raise node.refused(f"the operator has no counterpart in an INC; those that have one are {', '.join(OPERATORS)}")
    try:
        found = OPERATORS[node.operator](node)
    except (IndexError, ValueError) as error:
        if isinstance(error, TranslationError):
            raise
        raise node.refused(str(error)) from error
    return found if isinstance(found, tuple) else (found,)


def _axis(node: Node, axis: Any, size: int | None = None) -> int:
    size = len(node.signal.shape) if size is None else size
    if not -size <= int(axis) < size:
        raise node.refused(f"axis {axis} is not one of {size}")
    return int(axis) % size


def _axes(node: Node, place: int) -> list[int] | None:
    axes = node.constant(place, "axes")
    return None if axes is None else [int(axis) for axis in np.ravel(axes)]


def _sum(node: Node) -> Signal:
    total = Signal.constant(np.zeros(()))
    for value in node.inputs:
        assert value is not None
        total = total.plus(value)
    return total


def _difference(node: Node) -> Signal:
    first, second = node.inputs
    assert first is not None and second is not None
    return (first if isinstance(first, Signal) else Signal.constant(first)).minus(second)


def _product(node: Node) -> Signal:
    first, second = node.inputs
    if isinstance(first, Signal) and isinstance(second, Signal):
        raise node.refused("both factors depend on the network's input, so the product is not affine in it")
    return first.times(second) if isinstance(first, Signal) else second.times(first)  # type: ignore[union-attr, arg-type]


def _quotient(node: Node) -> Signal:
    divisor = node.constant(1)
    if np.any(np.asarray(divisor) == 0):
        raise node.refused("it divides by zero")
    return node.signal.times(1 / np.asarray(divisor, dtype=float))


def _matmul(node: Node) -> Signal:
    first, second = node.inputs
    if isinstance(first, Signal) and isinstance(second, Signal):
        raise node.refused("both factors depend on the network's input, so the product is not affine in it")
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


def _reshaped(node: Node) -> Signal:
    wanted = [int(size) for size in np.ravel(node.constant(1, "shape"))]
    if not node.attributes.get("allowzero", 0):
        wanted = [node.signal.shape[i] if size == 0 else size for i, size in enumerate(wanted)]
    if -1 in wanted:
        known = int(np.prod([size for size in wanted if size != -1], dtype=int))
        wanted[wanted.index(-1)] = int(np.prod(node.signal.shape, dtype=int)) // max(known, 1)
    return node.signal.moved(lambda a: a.reshape(*wanted, a.shape[-1]))


def _flattened(node: Node) -> Signal:
    shape, axis = node.signal.shape, int(node.attributes.get("axis", 1))
    axis = axis + len(shape) if axis < 0 else axis
    rows = int(np.prod(shape[:axis], dtype=int))
    return node.signal.moved(lambda a: a.reshape(rows, -1, a.shape[-1]))


def _squeezed(node: Node) -> Signal:
    shape, axes = node.signal.shape, _axes(node, 1)
    gone = {_axis(node, axis) for axis in axes} if axes is not None else {i for i, size in enumerate(shape) if size == 1}
    kept = [size for i, size in enumerate(shape) if i not in gone]
    return node.signal.moved(lambda a: a.reshape(*kept, a.shape[-1]))


def _unsqueezed(node: Node) -> Signal:
    axes = _axes(node, 1) or []
    new = [_axis(node, axis, len(node.signal.shape) + len(axes)) for axis in axes]
    return node.signal.moved(lambda a: np.expand_dims(a, tuple(new)))


def _transposed(node: Node) -> Signal:
    order = [int(i) for i in node.attributes.get("perm", range(len(node.signal.shape))[::-1])]
    return node.signal.moved(lambda a: np.transpose(a, (*order, len(order))))


def _joined(node: Node) -> Signal:
    parts = [value if isinstance(value, Signal) else Signal.constant(np.asarray(value)) for value in node.inputs]
    width = max(part.width for part in parts)
    parts = [part.widened(width) for part in parts]
    axis = _axis(node, node.attributes["axis"], len(parts[0].shape))
    return Signal(np.concatenate([part.coefficients for part in parts], axis),
                  np.concatenate([part.sizes for part in parts], axis))


def _sliced(node: Node) -> Signal:
    starts, ends = (np.ravel(node.constant(i, name)) for i, name in ((1, "starts"), (2, "ends")))
    axes = node.constant(3, "axes", range(len(starts)))
    steps = node.constant(4, None, np.ones(len(starts), dtype=int))
    cut = [slice(None)] * len(node.signal.shape)
    for start, end, axis, step in zip(starts, ends, np.ravel(axes), np.ravel(steps), strict=True):
        end = None if step < 0 and end < -node.signal.shape[_axis(node, axis)] else int(end)
        cut[_axis(node, axis)] = slice(int(start), end, int(step))
    return node.signal.moved(lambda a: a[tuple(cut)])


def _gathered(node: Node) -> Signal:
    indices, axis = np.asarray(node.constant(1), dtype=int), _axis(node, node.attributes.get("axis", 0))
    return node.signal.moved(lambda a: np.take(a, indices, axis))


def _split(node: Node) -> tuple[Signal, ...]:
    axis = _axis(node, node.attributes.get("axis", 0))
    sizes, count = node.constant(1, "split"), node.outputs
    if sizes is None:
        each = -(-node.signal.shape[axis] // count)
        cuts = np.arange(each, node.signal.shape[axis], each)
    else:
        cuts = np.cumsum(np.ravel(sizes))[:-1]
    pieces = zip(*(np.split(part, cuts, axis) for part in (node.signal.coefficients, node.signal.sizes)), strict=True)
    return tuple(Signal(*piece) for piece in pieces)


def _summed(node: Node) -> Signal:
    shape, axes = node.signal.shape, _axes(node, 1)
    if axes is None and node.attributes.get("noop_with_empty_axes", 0):
        return node.signal
    over = tuple(_axis(node, axis) for axis in axes) if axes else tuple(range(len(shape)))
    kept = bool(node.attributes.get("keepdims", 1))
    total = node.signal.moved(lambda a: np.sum(a, axis=over, keepdims=kept))
    count = float(np.prod([shape[axis] for axis in over])) if node.operator == "ReduceMean" else 1.0
    return total.times(np.array(1 / count))


def _cast(node: Node) -> Signal:
    if node.attributes.get("to") not in (1, 10, 11, 16):  # float, float16, double, bfloat16
        raise node.refused("it turns a signal into something else than floating point numbers")
    return node.signal


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
            assert value is not None
            found = pick(node.stack, found.plus(np.zeros(value.shape)), value)
        return found
    return chosen


OPERATORS: dict[str, Callable[[Node], Signal | np.ndarray | tuple[Signal, ...]]] = {
    "Abs": lambda node: node.stack.activated(node.signal, two_slopes(-1.0)),
    "Add": _sum, "BatchNormalization": _normalized, "Cast": _cast, "Clip": _clip, "Concat": _joined, "Div": _quotient,
    "Dropout": _dropout, "Flatten": _flattened, "Gather": _gathered, "Gemm": _gemm, "HardSigmoid": _hard_sigmoid,
    "Identity": lambda node: node.signal, "LeakyRelu": _leaky, "MatMul": _matmul, "Max": _extreme(greater),
    "Min": _extreme(smaller), "Mul": _product, "Neg": lambda node: node.signal.times(np.array(-1.0)), "PRelu": _leaky_each,
    "ReduceMean": _summed, "ReduceSum": _summed,
    "Relu": lambda node: node.stack.activated(node.signal, two_slopes(0.0)), "Reshape": _reshaped,
    "Shape": lambda node: np.array(node.signal.shape, dtype=np.int64),
    "Sigmoid": lambda node: node.stack.activated(node.signal, Logistic()), "Slice": _sliced, "Split": _split,
    "Squeeze": _squeezed, "Sub": _difference, "Sum": _sum, "Tanh": lambda node: node.stack.activated(node.signal, Tanh()),
    "Transpose": _transposed, "Unsqueeze": _unsqueezed,
}
"""The operators that a signal may pass; constants may pass all. Add one to have it read."""
