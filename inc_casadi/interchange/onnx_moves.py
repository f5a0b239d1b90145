"""ONNX operators that rearrange a signal's entries: each entry of the result is one of the signal, or a constant."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .onnx_node import Node, Value
from .signals import Signal


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
    shape, axes = node.signal.shape, node.axes(1)
    gone = {node.axis(axis) for axis in axes} if axes is not None else {i for i, size in enumerate(shape) if size == 1}
    kept = [size for i, size in enumerate(shape) if i not in gone]
    return node.signal.moved(lambda a: a.reshape(*kept, a.shape[-1]))


def _unsqueezed(node: Node) -> Signal:
    axes = node.axes(1) or []
    new = [node.axis(axis, len(node.signal.shape) + len(axes)) for axis in axes]
    return node.signal.moved(lambda a: np.expand_dims(a, tuple(new)))


def _transposed(node: Node) -> Signal:
    order = [int(i) for i in node.attributes.get("perm", range(len(node.signal.shape))[::-1])]
    return node.signal.moved(lambda a: np.transpose(a, (*order, len(order))))


def _joined(node: Node) -> Signal:
    parts = [value if isinstance(value, Signal) else Signal.constant(np.asarray(value)) for value in node.inputs]
    width = max(part.width for part in parts)
    parts = [part.widened(width) for part in parts]
    axis = node.axis(node.attributes["axis"], len(parts[0].shape))
    return Signal(np.concatenate([part.coefficients for part in parts], axis),
                  np.concatenate([part.sizes for part in parts], axis))


def _sliced(node: Node) -> Signal:
    starts, ends = (np.ravel(node.constant(i, name)) for i, name in ((1, "starts"), (2, "ends")))
    axes = node.constant(3, "axes", range(len(starts)))
    steps = node.constant(4, None, np.ones(len(starts), dtype=int))
    cut = [slice(None)] * len(node.signal.shape)
    for start, end, axis, step in zip(starts, ends, np.ravel(axes), np.ravel(steps), strict=True):
        end = None if step < 0 and end < -node.signal.shape[node.axis(axis)] else int(end)
        cut[node.axis(axis)] = slice(int(start), end, int(step))
    return node.signal.moved(lambda a: a[tuple(cut)])


def _gathered(node: Node) -> Signal:
    indices, axis = np.asarray(node.constant(1), dtype=int), node.axis(node.attributes.get("axis", 0))
    return node.signal.moved(lambda a: np.take(a, indices, axis))


def _split(node: Node) -> tuple[Signal, ...]:
    axis = node.axis(node.attributes.get("axis", 0))
    sizes, count = node.constant(1, "split"), node.outputs
    if sizes is None:
        each = -(-node.signal.shape[axis] // count)
        cuts = np.arange(each, node.signal.shape[axis], each)
    else:
        cuts = np.cumsum(np.ravel(sizes))[:-1]
    pieces = zip(*(np.split(part, cuts, axis) for part in (node.signal.coefficients, node.signal.sizes)), strict=True)
    return tuple(Signal(*piece) for piece in pieces)


def _shape(node: Node) -> np.ndarray:
    cut = slice(node.attributes.get("start", 0), node.attributes.get("end"))
    return np.array(node.signal.shape[cut], dtype=np.int64)


MOVES: dict[str, Callable[[Node], Value | tuple[Signal, ...]]] = {
    "Concat": _joined, "Flatten": _flattened, "Gather": _gathered, "Identity": lambda node: node.signal,
    "Reshape": _reshaped, "Shape": _shape, "Slice": _sliced, "Split": _split, "Squeeze": _squeezed,
    "Transpose": _transposed, "Unsqueeze": _unsqueezed,
}
"""What each of them gives. Free sizes are 1 by now, so a shape is a constant."""
