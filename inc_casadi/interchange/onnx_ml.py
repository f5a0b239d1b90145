"""Operators of the domain ai.onnx.ml that are affine: what scikit-learn's scalers and linear models are exported as."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import Array
from .onnx_node import Node
from .signals import Signal

DOMAIN = "ai.onnx.ml"


def _numbers(node: Node, attribute: str, default: float) -> Array:
    return np.asarray(node.attributes.get(attribute, [default]), dtype=float)


def _scaled(node: Node) -> Signal:
    return node.signal.minus(_numbers(node, "offset", 0.0)).times(_numbers(node, "scale", 1.0))


def _regressed(node: Node) -> Signal:
    if node.attributes.get("post_transform", b"NONE") not in (b"NONE", "NONE"):
        raise node.refused(f"its post_transform {node.attributes['post_transform']!r} is not read")
    rows = _numbers(node, "coefficients", 0.0).reshape(int(node.attributes.get("targets", 1)), -1)
    return node.signal.matmul(rows.T).plus(_numbers(node, "intercepts", 0.0))


LEARNED: dict[str, Callable[[Node], Signal]] = {"LinearRegressor": _regressed, "Scaler": _scaled}
"""What each of them gives; their numbers are attributes, which ONNX keeps in single precision."""
