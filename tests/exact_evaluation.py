"""A piecewise-affine law evaluated in exact fractions, with numbers as they are: what no float can argue with."""

from __future__ import annotations

from fractions import Fraction

import numpy as np


def exactly(inc, y):
    """u as fractions at one y (p,): the pieces are guessed in floats, the fixed point solved for and confirmed exactly."""
    y = [Fraction(float(value)) for value in y]
    eta = inc.hidden(np.array([float(value) for value in y]))
    z = inc.W @ eta + inc.U @ np.array([float(value) for value in y]) + inc.b
    pieces = [int(np.searchsorted(unit.pieces.kinks, value, side="right"))
              for unit, value in zip(inc.activations, z, strict=True)]
    slope = [Fraction(float(unit.pieces.slopes[k])) for unit, k in zip(inc.activations, pieces, strict=True)]
    offset = [Fraction(float(unit.pieces.intercepts[k])) for unit, k in zip(inc.activations, pieces, strict=True)]
    W, U, V, K = (_fractions(part) for part in (inc.W, inc.U, inc.V, inc.K))
    b, d = [Fraction(float(value)) for value in inc.b], [Fraction(float(value)) for value in inc.d]
    c = [_dot(row, y) + value for row, value in zip(U, b, strict=True)]
    rows = [[(i == j) - slope[i] * W[i][j] for j in range(inc.q)] + [slope[i] * c[i] + offset[i]] for i in range(inc.q)]
    eta = _solved(rows)
    for i, unit in enumerate(inc.activations):
        value, kinks = _dot(W[i], eta) + c[i], [Fraction(float(kink)) for kink in unit.pieces.kinks]
        inside = (pieces[i] == 0 or kinks[pieces[i] - 1] <= value) and (pieces[i] == len(kinks) or value <= kinks[pieces[i]])
        assert inside, "the pieces guessed in floats are not those of the exact solution"
    return [_dot(K[i], y) + _dot(V[i], eta) + d[i] for i in range(inc.m)]


def _fractions(matrix):
    return [[Fraction(float(value)) for value in row] for row in matrix]


def _dot(a, b):
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


def _solved(rows):
    """The solution of a system by elimination; rows (q, q + 1) hold its right-hand side last."""
    size = len(rows)
    for k in range(size):
        at = next(i for i in range(k, size) if rows[i][k] != 0)
        rows[k], rows[at] = rows[at], rows[k]
        rows[k] = [value / rows[k][k] for value in rows[k]]
        for i in range(size):
            if i != k and rows[i][k] != 0:
                rows[i] = [x - rows[i][k] * y for x, y in zip(rows[i], rows[k], strict=True)]
    return [row[size] for row in rows]
