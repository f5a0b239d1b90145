"""Linear functions of the moves written exactly as sums over their values at anchors, where the limits bound them."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..pieces.linear import identity
from ..plant import Plant
from .affine_problem import extended
from .frame import Frame
from .measured import exact_rows, measured_rows


def on_anchors(plant: Plant, anchors: Array, forces: list[np.ndarray]) -> list[np.ndarray | None]:
    """Return for every move N_k (m, a) with M_k E_k' = N_k (E_k [V; 1])' exactly, or None where the anchors do not do.

    E_k = [R_k 0; 0 1] with rows R_k that span those of C, ..., CA^k. The float solution is repaired at the few anchors of
    `Span`.

    anchors: V (n, a); forces: M_k (m, n + 1) of Fractions.

    >>> [N] = on_anchors(Plant([[1.0]], [[1.0]]), np.array([[-1.0, 2.0]]), [exact(np.array([[0.5, 1.0]]))])
    >>> N.tolist()
    [[Fraction(1, 2), Fraction(1, 2)]]
    """
    frames = [Frame(rows, anchors) for rows in measured_rows(plant, len(forces))]
    seen = measurements(plant, len(forces))
    spans = [Span(E @ exact(extended(anchors)), pivoted(frame.seen)) for E, frame in zip(seen, frames, strict=False)]
    found: list[np.ndarray | None] = []
    for k, (M, frame) in enumerate(zip(forces, frames, strict=True)):
        span, E = spans[min(k, len(spans) - 1)], seen[min(k, len(spans) - 1)]
        near = exact(frame.on_anchors(M.astype(float)))
        off = span.coefficients(E @ M.T - span.columns @ near.T)
        if off is not None:
            near[:, span.basis] += off.T
        found.append(near if off is not None else None)
    return found


def measurements(plant: Plant, moves: int) -> list[np.ndarray]:
    """Return E_k = [R_k 0; 0 1] of Fractions for k = 0, 1, ...; the last one holds for all further moves.

    >>> [E.shape for E in measurements(Plant([[1.0, 1.0], [0.0, 1.0]], [[0.0], [1.0]], C=[[1.0, 0.0]]), 9)]
    [(2, 3), (3, 3)]
    """
    found = []
    for rows in exact_rows(plant, moves):
        r, n = rows.shape
        E = np.full((r + 1, n + 1), Fraction(0), dtype=object)
        E[:r, :n], E[r, n] = rows, Fraction(1)
        found.append(E)
    return found


def nearly_flat(plant: Plant, anchors: Array, moves: int) -> bool:
    """Return whether anchors that are flat in floating point, as the moves see them, are not so exactly.

    Moves of huge gains could then tell apart what floats cannot, and a bound in floats would be wrong.

    >>> plane = np.array([[0.0, 1.0, 2.0], [0.0, 1.0, 2.0]])
    >>> [nearly_flat(Plant(np.eye(2), np.ones((2, 1))), plane + [[0, 0, off], [0, 0, 0]], 1) for off in (0.0, 1e-15, 1e-3)]
    [False, True, False]
    """
    lifted = exact(extended(anchors))
    for E, rows in zip(measurements(plant, moves), measured_rows(plant, moves), strict=False):
        frame = Frame(rows, anchors)
        if frame.rank < len(frame.E):
            true = E if len(E) == len(frame.E) else identity(plant.n + 1, lifted)
            if frame.rank < len(Span(true @ lifted, list(range(lifted.shape[1]))).basis):
                return True
    return False


class Span:
    """The columns (r, a) of a matrix of Fractions, and combinations of as few of them, `basis`, that give a target.

    Row operations T turn the columns of the basis into those of the identity, one at a time and in the given order.

    >>> span = Span(exact(np.array([[1.0, 2.0, 0.0], [2.0, 4.0, 1.0]])), [0, 1, 2])
    >>> span.basis, span.coefficients(exact(np.array([[1.0], [3.0]]))).ravel().tolist()
    ([0, 2], [Fraction(1, 1), Fraction(1, 1)])
    """

    def __init__(self, columns: np.ndarray, order: list[int]) -> None:
        self.columns, self.basis = columns, list[int]()
        self._T = identity(len(columns), columns)
        for j in order:
            if len(self.basis) == len(columns):
                break
            self._take(j)

    def _take(self, j: int) -> None:
        rank, T = len(self.basis), self._T
        column = T @ self.columns[:, j]
        row = next((i for i in range(rank, len(T)) if column[i] != 0), None)
        if row is None:
            return
        T[[rank, row]], column[[rank, row]] = T[[row, rank]], column[[row, rank]]
        pivot = T[rank] / column[rank]
        T = T - np.outer(column, pivot)
        T[rank] = pivot
        self._T = T
        self.basis.append(j)

    def coefficients(self, targets: np.ndarray) -> np.ndarray | None:
        """Return (len(basis), t) with columns[:, basis] @ it = targets (r, t), or None when a target is out of reach."""
        turned = self._T @ targets
        rank = len(self.basis)
        return None if np.any(turned[rank:] != 0) else turned[:rank]


def pivoted(seen: Array) -> list[int]:
    """Return the order of the columns of a matrix (r, a) in which `Span` divides by no small number.

    First come those that a pivoted Gram-Schmidt process takes, then the others.

    >>> pivoted(np.array([[1.0, 3.0, 2.0]]))
    [1, 0, 2]
    """
    scale = np.max(np.abs(seen), axis=1, keepdims=True)
    rest = seen / np.where(scale > 0, scale, 1.0)
    first: list[int] = []
    for _ in range(min(rest.shape)):
        sizes = np.linalg.norm(rest, axis=0)
        first.append(int(np.argmax(sizes)))
        direction = rest[:, first[-1]] / (sizes[first[-1]] or 1.0)
        rest = rest - np.outer(direction, direction @ rest)
    taken = list(dict.fromkeys(first))
    return taken + [j for j in range(seen.shape[1]) if j not in taken]
