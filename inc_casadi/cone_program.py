"""A semidefinite program in coordinates where its numbers are near 1, with the few operations its solver needs.

A point of the cone is a tuple: one symmetric matrix per block, and last a vector for the linear constraints. Unknowns and
constraints are multiplied by positive numbers, under which semidefiniteness and minimizers stay what they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arrays import Array
from .lmi_problem import Problem
from .schur import Coefficients, coefficients, schur

ROUNDS = 4  # of equilibration between unknowns and constraints
Point = tuple[Array, ...]


@dataclass(frozen=True, eq=False)
class ConeProgram:
    """Minimize cost'y subject to slack(y) = constants + image(y) in the cone; all in scaled numbers.

    parts: one `Coefficients` per block; rows: (r, v); bounded, sign: (b,) the bounds sign_i y[bounded_i] + const >= 0;
    constants: a point of the cone's space, (N_k, N_k) each and (r + b,); unknowns: (v,), the original y is unknowns * y;
    multipliers: (k,), the original X of block k is multipliers_k * X.
    """

    cost: Array
    parts: tuple[Coefficients, ...]
    rows: Array
    bounded: NDArray[np.intp]
    sign: Array
    constants: Point
    unknowns: Array
    multipliers: Array

    @property
    def degree(self) -> int:
        """Sum of the sizes of the blocks and of the linear constraints: <X, S> / degree is the mean complementarity."""
        return sum(len(constant) for constant in self.constants)

    def image(self, y: Array) -> Point:
        """Return the linear part A'(y) of the slack at y (v,)."""
        linear = np.concatenate([self.rows @ y, self.sign * y[self.bounded]])
        return (*(part.image(y) for part in self.parts), linear)

    def slack(self, y: Array) -> Point:
        """Return S = constants + A'(y)."""
        return tuple(c + s for c, s in zip(self.constants, self.image(y), strict=True))

    def adjoint(self, X: Point) -> Array:
        """Return A(X), (v,): its entry e is the inner product of X with the coefficient of y_e."""
        total = self.rows.T @ X[-1][: len(self.rows)] + self._from_bounds(self.sign * X[-1][len(self.rows):])
        for part, block in zip(self.parts, X, strict=False):
            total = total + part.adjoint(block)
        return total

    def schur(self, X: Point, Z: Point) -> tuple[Array, Array]:
        """Return H (v, v) with H_ef = <A_e, X A_f Z>, and A(Z) (v,), whose Gram matrices are the same."""
        weight = X[-1] * Z[-1]
        H = (self.rows.T * weight[: len(self.rows)]) @ self.rows
        H[np.diag_indices_from(H)] += self._from_bounds(weight[len(self.rows):])
        image = self.rows.T @ Z[-1][: len(self.rows)] + self._from_bounds(self.sign * Z[-1][len(self.rows):])
        for part, x, z in zip(self.parts, X, Z, strict=False):
            gram_z = part.gram(z)
            H += schur(part, part.gram(x), gram_z)
            image = image + part.weights @ gram_z[part.a, part.b]
        return H, image

    def _from_bounds(self, values: Array) -> Array:
        return np.bincount(self.bounded, values, minlength=self.cost.size)


def normalized(problem: Problem) -> ConeProgram:
    """Return the problem in numbers near 1.

    Unknowns and constraints are scaled in turn until each has a largest coefficient near 1 (coefficient matrices by their
    Frobenius norm); then y and all slacks are divided by the size of the constants, and the cost by its largest entry.
    Bounds follow the unknowns. What far bounds say (|y| <= 1e6) must not be taken for the problem's size, so they count
    only when nothing else has a constant.

    >>> zero = np.zeros((0, 1))
    >>> program = normalized(Problem(np.array([3.0]), (), zero, np.zeros(0), np.array([-2.0]), np.array([np.inf])))
    >>> program.cost.tolist(), program.unknowns.tolist(), program.slack(np.zeros(1))[-1].tolist()
    ([1.0], [2.0], [1.0])
    """
    parts = tuple(coefficients(block, problem.size) for block in problem.blocks)
    norms = [np.sqrt(np.maximum(np.diag(schur(A, G := A.gram(np.eye(len(A.columns))), G)), 0.0)) for A in parts]
    unknowns, sizes = _equilibrated(np.vstack([np.zeros((0, problem.size)), *norms, np.abs(problem.rows)]))
    blocks, rows = sizes[: len(parts)], sizes[len(parts):]
    constants = [size * block.constant for size, block in zip(blocks, problem.blocks, strict=True)]
    bounded, sign, bounds = _bounds(problem, unknowns)
    unit = max([_largest(rows * problem.offset), *(_largest(constant) for constant in constants)])
    unit = unit or float(np.min(np.abs(bounds[bounds != 0.0]), initial=np.inf))
    unit = unit if np.isfinite(unit) else 1.0
    cost = problem.cost * unknowns
    price = _largest(cost) or 1.0
    return ConeProgram(
        cost / price, tuple(A.scaled(unknowns, s) for A, s in zip(parts, blocks, strict=True)),
        rows[:, None] * problem.rows * unknowns, bounded, sign,
        (*(constant / unit for constant in constants), np.concatenate([rows * problem.offset, bounds]) / unit),
        unknowns * unit, price * blocks)


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values), initial=0.0))


def _equilibrated(norms: Array) -> tuple[Array, Array]:
    """Return factors of the unknowns (v,) and of the constraints (k,) that bring the largest norms (k, v) near 1."""
    unknowns, sizes = np.ones(norms.shape[1]), np.ones(norms.shape[0])
    for _ in range(ROUNDS):
        columns = np.max(sizes[:, None] * norms * unknowns, axis=0, initial=0.0)
        unknowns = unknowns / np.sqrt(np.where(columns > 0.0, columns, 1.0))
        lines = np.max(sizes[:, None] * norms * unknowns, axis=1, initial=0.0)
        sizes = sizes / np.sqrt(np.where(lines > 0.0, lines, 1.0))
    return unknowns, sizes


def _bounds(problem: Problem, unknowns: Array) -> tuple[NDArray[np.intp], Array, Array]:
    """Return the numbers of the bounded unknowns, the signs of the bounds, and their constants in scaled unknowns."""
    low, high = np.flatnonzero(np.isfinite(problem.lower)), np.flatnonzero(np.isfinite(problem.upper))
    sign = np.concatenate([np.ones(low.size), -np.ones(high.size)])
    constants = np.concatenate([-problem.lower[low] / unknowns[low], problem.upper[high] / unknowns[high]])
    return np.concatenate([low, high]), sign, constants
