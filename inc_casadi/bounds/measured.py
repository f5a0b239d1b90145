"""What moves can depend on: the rows C, CA, ..., CA^k through which measurements show the initial state."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..plant import Plant
from .moves import UNIT


@dataclass(frozen=True, eq=False)
class Rows:
    """An orthonormal basis (r, n) of a row space; a row of that space is off it by at most `sine` times its norm."""

    basis: Array
    sine: float


def measured_rows(plant: Plant, moves: int) -> list[Rows]:
    """Return for k = 0..moves-1 an orthonormal basis of the row space of [C; CA; ...; CA^k].

    The rank is decided in exact arithmetic on the stored floats, so that no direction, however faintly measured, is
    denied to a controller; where the basis would be ill conditioned the whole space is returned, which only lowers a
    bound.

    >>> plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.0], [1.0]], C=[[2.0, 0.0]])
    >>> [rows.basis.shape for rows in measured_rows(plant, 3)]
    [(1, 2), (2, 2), (2, 2)]
    """
    distinct = exact_rows(plant, moves)
    found = [orthonormal(list(rows), plant.n) for rows in distinct]
    return found + [found[-1]] * (moves - len(found))


def exact_rows(plant: Plant, moves: int) -> list[np.ndarray]:
    """Return for k = 0, 1, ... independent rows (r, n) of Fractions that span the row space of [C; CA; ...; CA^k].

    Once CA^k adds no row the space grows no more (Cayley and Hamilton): the list ends there, or after `moves` entries.

    >>> plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.0], [1.0]], C=[[2.0, 0.0]])
    >>> [len(rows) for rows in exact_rows(plant, 9)]
    [1, 2]
    """
    if plant.full_state:
        return [exact(np.eye(plant.n))]
    A, new = exact(plant.A), list(exact(plant.C))
    echelon: list[tuple[int, np.ndarray]] = []
    found: list[np.ndarray] = []
    while len(found) < moves:
        before = len(echelon)
        for row in new:
            _extend(echelon, row)
        found.append(np.array([row for _, row in echelon], dtype=object).reshape(-1, plant.n))
        if len(echelon) in (before, plant.n):
            break
        new = [row @ A for _, row in echelon[before:]]
    return found


def _everything(n: int) -> Rows:
    return Rows(np.eye(n), 0.0)


def _extend(echelon: list[tuple[int, np.ndarray]], row: np.ndarray) -> None:
    # Add what is left of the row after elimination, if anything, with its largest entry scaled to one.
    for pivot, other in echelon:
        if row[pivot]:
            row = row - row[pivot] * other
    pivot = max(range(len(row)), key=lambda i: abs(row[i]))
    if row[pivot]:
        echelon.append((pivot, row / row[pivot]))


def orthonormal(rows: list[np.ndarray], n: int) -> Rows:
    """Return an orthonormal basis of the span of linearly independent rows of Fractions, of n entries each.

    >>> abs(orthonormal([np.array([Fraction(0), Fraction(2)])], 2).basis).tolist()
    [[0.0, 1.0]]
    """
    if len(rows) == n:
        return _everything(n)
    if not rows:
        return Rows(np.zeros((0, n)), 0.0)
    floats = np.array([[float(Fraction(entry)) for entry in row] for row in rows])
    _, sizes, Vt = np.linalg.svd(floats / np.linalg.norm(floats, axis=1, keepdims=True), full_matrices=False)
    if sizes[-1] < 1e-8 * sizes[0]:
        return _everything(n)
    return Rows(Vt, 8 * n * UNIT * float(sizes[0] / sizes[-1]))
