"""ONNX operators that are affine in one input: ONNX's own evaluator is asked what they do to each coefficient."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..arrays import Array
from .onnx_node import Condition, Node
from .signals import Signal

ADDENDS: dict[str, int | None] = {
    "AveragePool": None, "Conv": 2, "CumSum": None, "Einsum": None, "Expand": None, "GatherElements": None, "GatherND": None,
    "GlobalAveragePool": None, "Pad": 2, "Tile": None, "Trilu": None,
}
"""The operators, each with the place of the constant that it adds, if there is one; without that it is linear."""


def _affine(node: Node) -> Signal:
    """Return f(c + sum_i g_i v_i) = f(c) + sum_i l(g_i) v_i, with l the linear part of f, for v = (y, eta).

    Nothing is subtracted, so the coefficients are those of the network. Sizes pass through the same operator with the
    absolute values of its constants.
    """
    place = _place(node)
    signal = node.inputs[place]
    assert isinstance(signal, Signal)
    constants = [_held(node, value) if i != place else None for i, value in enumerate(node.inputs)]
    linear = [np.zeros_like(value) if i == ADDENDS[node.operator] and value is not None else value
              for i, value in enumerate(constants)]

    def through(columns: Array, absolute: bool) -> Array:
        whole, part = ([_absolute(value) if absolute else value for value in given] for given in (constants, linear))
        slices = np.moveaxis(columns, -1, 0)
        found = [_answer(node, part if i else whole, place, one) for i, one in enumerate(slices)]
        return np.stack(found, axis=-1) + 0.0

    return Signal(through(signal.coefficients, False), through(signal.sizes, True))


def _place(node: Node) -> int:
    places = [i for i, value in enumerate(node.inputs) if isinstance(value, Signal)]
    if len(places) != 1 or (places[0] and node.operator != "Einsum"):
        raise node.refused(f"its inputs {places} depend on the network's input, but it is affine in one of them only")
    if node.operator == "Pad" and node.attributes.get("value", 0.0):
        raise node.refused("it fills with another value than zero, by an attribute of an old operator set")
    return places[0]


def _held(node: Node, value: object) -> np.ndarray | None:
    if isinstance(value, Condition):
        raise node.refused("it reads a comparison that depends on the network's input")
    if value is None:
        return None
    array = np.asarray(value)
    return array.astype(float) if array.dtype.kind == "f" else array


def _absolute(value: np.ndarray | None) -> np.ndarray | None:
    return np.abs(value) if value is not None and value.dtype.kind == "f" else value


def _answer(node: Node, constants: Sequence[np.ndarray | None], place: int, argument: Array) -> Array:
    inputs = [np.ascontiguousarray(argument) if i == place else value for i, value in enumerate(constants)]
    return np.asarray(node.evaluated(inputs)[0], dtype=float)


EVALUATED: dict[str, Callable[[Node], Signal]] = dict.fromkeys(ADDENDS, _affine)
"""What each of them gives."""
