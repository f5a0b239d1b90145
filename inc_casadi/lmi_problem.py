"""A semidefinite program in inequality form, as numbers: what the solvers of matrix inequalities take."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arrays import Array


@dataclass(frozen=True, eq=False)
class Term:
    """The part (left Y right' + right Y' left') / 2 of a symmetric matrix, linear in the unknown matrix Y.

    index: (a, b) integers, Y_ij = y[index_ij], or 0 where index_ij = -1; a symmetric Y repeats its indices, a diagonal
    one has -1 off its diagonal. left: (N, a); right: (N, b).

    >>> Term(np.array([[0]]), np.array([[1.0], [0.0]]), np.array([[0.0], [2.0]])).value(np.array([3.0])).tolist()
    [[0.0, 3.0], [3.0, 0.0]]
    """

    index: NDArray[np.intp]
    left: Array
    right: Array

    def value(self, y: Array) -> Array:
        """Return the term's matrix (N, N) at y."""
        Y = np.where(self.index >= 0, y[self.index], 0.0)
        half = self.left @ Y @ self.right.T
        return (half + half.T) / 2


@dataclass(frozen=True, eq=False)
class Block:
    """A matrix that must be positive semidefinite: constant + sum of the terms, (N, N) symmetric."""

    constant: Array
    terms: tuple[Term, ...]

    def value(self, y: Array) -> Array:
        """Return the matrix (N, N) at y."""
        return self.constant + sum(term.value(y) for term in self.terms)


@dataclass(frozen=True, eq=False)
class Problem:
    """Minimize cost'y over y in R^v subject to: every block >= 0, rows @ y + offset >= 0, lower <= y <= upper.

    cost: (v,); rows: (r, v); offset: (r,); lower, upper: (v,), infinite where there is no bound.

    >>> cone = Block(np.array([[0.0, 1.0], [1.0, 0.0]]), (Term(np.array([[0, -1], [-1, 0]]), np.eye(2), np.eye(2)),))
    >>> problem = Problem(np.ones(1), (cone,), np.zeros((0, 1)), np.zeros(0), np.zeros(1), np.full(1, np.inf))
    >>> problem.violation(np.array([2.0])) < 0 < problem.violation(np.array([0.5]))
    True
    """

    cost: Array
    blocks: tuple[Block, ...]
    rows: Array
    offset: Array
    lower: Array
    upper: Array

    @property
    def size(self) -> int:
        """Number of unknowns v."""
        return self.cost.size

    def violation(self, y: Array) -> float:
        """Return how far y is from satisfying the constraints, minus the smallest slack: negative is strictly inside."""
        slacks = [float(np.linalg.eigvalsh(block.value(y))[0]) for block in self.blocks if block.constant.size]
        linear = np.concatenate([self.rows @ y + self.offset, y - self.lower, self.upper - y])
        return -min([*slacks, *linear.tolist()], default=np.inf)


@dataclass(frozen=True, eq=False)
class Solution:
    """What a solver returns; its words are history, and whoever uses y measures it.

    y: (v,) the best point; interior: (v,) a deeper point on the way there, or None; status: "optimal", "infeasible"
    (no y satisfies the constraints, as far as the solver can tell), "stopped" (as asked), "stalled" or "limit"; gap:
    relative duality gap; X: the multipliers, one symmetric X_k >= 0 (N_k, N_k) per block, of the Lagrangian
    cost'y - sum_k <X_k, S_k(y)> - (linear constraints), empty where the solver tells none; residual: the largest error of
    its stationarity in y, in numbers near 1.
    """

    y: Array
    interior: Array | None
    status: str
    gap: float
    iterations: int
    X: tuple[Array, ...] = ()
    residual: float = np.inf
