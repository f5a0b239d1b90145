"""One node of an ONNX graph, as the translation of its operator reads it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import TranslationError
from .signals import Signal, Stack


@dataclass(frozen=True, eq=False)
class Condition:
    """What a comparison of signals gives: where `difference` is positive; what holds at zero is left open.

    Only functions that are continuous there are made from it (`onnx_conditions.chosen`), for which that does not matter.
    """

    difference: Signal

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the tensor."""
        return self.difference.shape


Value = Signal | Condition | np.ndarray | None
"""What an ONNX name stands for: affine in (y, eta), a comparison of such, a constant, or an input that is left out."""

Evaluation = Callable[[Sequence[np.ndarray | None]], tuple[np.ndarray, ...]]
"""What ONNX's own evaluator makes of a node, from arrays for its inputs."""


def _unknown(inputs: Sequence[np.ndarray | None]) -> tuple[np.ndarray, ...]:
    raise TranslationError("the node was given without ONNX's evaluator")


@dataclass(frozen=True, eq=False)
class Node:
    """One node of a graph: its operator, its attributes as Python values, what it reads, and the units met so far."""

    operator: str
    name: str
    attributes: Mapping[str, Any]
    inputs: Sequence[Value]
    stack: Stack
    outputs: int = 1
    evaluated: Evaluation = _unknown

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
            if isinstance(value, Signal | Condition):
                raise self.refused(f"its input {place} depends on the network's input, but only constants are admitted")
            return value
        return self.attributes.get(attribute, default) if attribute else default

    def real(self, attribute: str, default: float) -> float:
        """Return an attribute that is a number; ONNX has those, defaults included, in single precision."""
        return float(np.float32(self.attributes.get(attribute, default)))

    def axis(self, axis: Any, size: int | None = None) -> int:
        """Return the number of an axis of the signal, or of as many axes as `size`, counted from the front."""
        size = len(self.signal.shape) if size is None else size
        if not -size <= int(axis) < size:
            raise self.refused(f"axis {axis} is not one of {size}")
        return int(axis) % size

    def axes(self, place: int) -> list[int] | None:
        """Return the axes that an input, or the attribute of older operator sets, names; None where neither does."""
        axes = self.constant(place, "axes")
        return None if axes is None else [int(axis) for axis in np.ravel(axes)]

    def refused(self, why: str) -> TranslationError:
        """Return the error that names the node.

        >>> print(Node("Neg", "n", {}, [], Stack(1)).refused("it reads nothing"))
        node 'n' (Neg): it reads nothing
        """
        return TranslationError(f"node {self.name!r} ({self.operator}): {why}")
