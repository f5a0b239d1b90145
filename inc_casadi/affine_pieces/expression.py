"""Expressions of max and min of laws: their Boolean reading, and what each costs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .order import Order


class Gate(NamedTuple):
    """The largest ("max") or smallest ("min") of its parts; "clip" with parts (a, b, rest) is max(a, min(b, rest)).

    Each part is the number of a law or another gate.
    """

    name: str
    parts: tuple[Expression, ...]


Expression = int | Gate


def fulfils(expression: Expression, order: Order) -> bool:
    """Return whether the expression is true with `above` and false without `below`, on every cell (`Order`).

    >>> order = Order(np.array([[1.0], [-1.0]]), np.zeros(2), np.eye(2, dtype=bool), np.ones((2, 2), bool), 0.0)
    >>> fulfils(Gate("max", (0, 1)), order), fulfils(Gate("min", (0, 1)), order), fulfils(0, order)
    (True, False, False)
    """
    above, below = np.unique(order.above, axis=0), np.unique(order.below, axis=0)
    return bool(truth(expression, above).all() and not truth(expression, ~below).any())


def truth(expression: Expression, true: np.ndarray) -> np.ndarray:
    """Return the Boolean value (N,) of an expression where laws are true (N, L): max is "or", min is "and".

    >>> truth(Gate("clip", (0, 1, 2)), np.array([[True, False, False], [False, False, True]])).tolist()
    [True, False]
    """
    if not isinstance(expression, Gate):
        return np.asarray(true[:, expression])
    parts = [truth(part, true) for part in expression.parts]
    if expression.name == "clip":
        return np.asarray(parts[0] | parts[1] & parts[2])
    return np.any(parts, axis=0) if expression.name == "max" else np.all(parts, axis=0)


def leaves(expression: Expression) -> int:
    """Return how many laws stand in an expression, repetitions counted.

    >>> leaves(Gate("max", (0, Gate("min", (1, 0)))))
    3
    """
    return sum(leaves(part) for part in expression.parts) if isinstance(expression, Gate) else 1


def units(expression: Expression) -> int:
    """Return how many units an expression takes: one for each part beyond a gate's first, one for a clip, none twice.

    >>> units(Gate("max", (0, Gate("clip", (1, 2, 3)))))
    2
    """
    return sum(1 if gate.name == "clip" else len(gate.parts) - 1 for gate in _gates(expression))


def flat(expression: Expression) -> Expression:
    """Return the expression with gates of the same name drawn together, and no part of a gate twice.

    >>> flat(Gate("max", (0, Gate("max", (1, 0)))))
    Gate(name='max', parts=(0, 1))
    """
    if not isinstance(expression, Gate):
        return expression
    parts: list[Expression] = []
    for part in map(flat, expression.parts):
        same = isinstance(part, Gate) and part.name == expression.name != "clip"
        parts += part.parts if same and isinstance(part, Gate) else (part,)
    return Gate(expression.name, tuple(parts if expression.name == "clip" else dict.fromkeys(parts)))


def _gates(expression: Expression) -> set[Gate]:
    if not isinstance(expression, Gate):
        return set()
    return {expression}.union(*map(_gates, expression.parts))
