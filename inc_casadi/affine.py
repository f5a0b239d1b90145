"""A matrix that is linear in unknowns: the reading of a matrix inequality that a solver's data are made from.

The inequality that CVXPY searches with, NumPy measures and exact arithmetic proves is read once more here, and what comes
out is its constant part and the factors of its linear part. Nothing is compiled and no coefficient matrix is formed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import Array
from .errors import InvalidInputError
from .lmi_problem import Block, Term


@dataclass(frozen=True, eq=False)
class Affine:
    """constant + sum of left_k Y_k right_k', where each unknown matrix Y_k takes its entries from one vector y.

    constant: (r, c); terms: (index, left, right) as in `lmi_problem.Term`, but not symmetrized.
    vector: whether this stands for a vector of unknowns, kept as the diagonal matrix that `blocks.diag` makes of it.

    >>> Y = Affine.unknown(np.array([[0, 1], [1, 2]]))
    >>> (np.array([[1.0, 2.0]]) @ Y @ np.array([[1.0], [2.0]])).at(np.array([1.0, 10.0, 100.0])).item()
    441.0
    """

    __array_ufunc__ = None  # lets `ndarray @ affine` come to __rmatmul__

    constant: Array
    terms: tuple[Term, ...]
    vector: bool = False

    @classmethod
    def unknown(cls, index: NDArray[np.intp]) -> Affine:
        """Return the matrix, or vector, of unknowns with these places in y; -1 is a zero."""
        places = np.asarray(index)
        if places.ndim == 1:
            diagonal = np.full((places.size,) * 2, -1)
            np.fill_diagonal(diagonal, places)
            return replace(cls.unknown(diagonal), vector=True)
        rows, cols = places.shape
        return cls(np.zeros((rows, cols)), (Term(places, np.eye(rows), np.eye(cols)),))

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape, as of an array."""
        return self.constant.shape[:1] if self.vector else self.constant.shape

    @property
    def T(self) -> Affine:
        """The transpose."""
        return Affine(self.constant.T, tuple(Term(t.index.T, t.right, t.left) for t in self.terms))

    def at(self, y: Array) -> Array:
        """Return the matrix of numbers at y."""
        total = self.constant.copy()
        for term in self.terms:
            total += term.left @ np.where(term.index >= 0, y[term.index], 0.0) @ term.right.T
        return total

    def block(self, congruence: Array) -> Block:
        """Return S'(this matrix)S as a block for a solver; terms that mirror each other become one.

        The block is symmetrized, which leaves a symmetric matrix as it is.
        """
        constant = congruence.T @ self.constant @ congruence
        terms: list[Term] = []
        for term in self.terms:
            term = Term(term.index, congruence.T @ term.left, congruence.T @ term.right)
            twin = next((k for k, other in enumerate(terms) if _mirrors(term, other)), None)
            if twin is None:
                terms.append(term)
            else:  # (L Y R' + R Y'L')/2 counts both
                terms[twin] = Term(terms[twin].index, 2.0 * terms[twin].left, terms[twin].right)
        return Block((constant + constant.T) / 2, tuple(terms))

    def rows(self, size: int) -> tuple[Array, Array]:
        """Return (A, b) with A y + b the entries of this matrix in the order of its rows, for y in R^size."""
        A = np.zeros((self.constant.size, size))
        for term in self.terms:
            a, b = np.nonzero(term.index >= 0)
            coefficients = term.left[:, None, a] * term.right[None, :, b]
            np.add.at(A.T, term.index[a, b], coefficients.reshape(-1, a.size).T)
        return A, self.constant.reshape(-1)

    def __neg__(self) -> Affine:
        return self * -1.0

    def __add__(self, other: Any) -> Affine:
        if isinstance(other, Affine):
            return Affine(self.constant + other.constant, self.terms + other.terms)
        return Affine(self.constant + np.asarray(other, dtype=float), self.terms)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Affine:
        return self + (-other)

    def __rsub__(self, other: Any) -> Affine:
        return (-self) + other

    def __mul__(self, other: Any) -> Affine:
        factor = float(_plain(other))
        return Affine(factor * self.constant, tuple(Term(t.index, factor * t.left, t.right) for t in self.terms))

    __rmul__ = __mul__

    def __matmul__(self, other: Any) -> Affine:
        right = _plain(other)
        return Affine(self.constant @ right, tuple(Term(t.index, t.left, right.T @ t.right) for t in self.terms))

    def __rmatmul__(self, other: Any) -> Affine:
        left = _plain(other)
        return Affine(left @ self.constant, tuple(Term(t.index, left @ t.left, t.right) for t in self.terms))

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        if function is np.diag and not kwargs and args[0].vector:
            return replace(args[0], vector=False)
        return NotImplemented


def _plain(value: Any) -> Array:
    if isinstance(value, Affine):
        raise InvalidInputError("a product of two unknowns is not linear: no matrix inequality can hold it")
    return np.asarray(value, dtype=float)


def _mirrors(one: Term, other: Term) -> bool:
    """Whether two different terms are transposes of each other, so that their symmetric parts are equal.

    The transpose of a negated term has its sign on the other factor.
    """
    if one.index.shape != other.index.shape[::-1] or not np.array_equal(one.index, other.index.T):
        return False
    return any(np.array_equal(one.left, sign * other.right) and np.array_equal(one.right, sign * other.left)
               for sign in (1.0, -1.0))


def index_of(unknowns: Sequence[Any]) -> tuple[dict[str, NDArray[np.intp]], int]:
    """Return the places in y of each unknown's entries, and the size of y.

    unknowns: `multipliers.Unknown`; entries that are fixed at zero get -1, a symmetric matrix repeats its places.
    """
    places: dict[str, NDArray[np.intp]] = {}
    size = 0
    for unknown in unknowns:
        index = np.full(unknown.shape, -1)
        free = unknown.free & np.tri(*unknown.shape, dtype=np.bool_) if unknown.is_symmetric else unknown.free
        index[free] = size + np.arange(np.count_nonzero(free))
        size += int(np.count_nonzero(free))
        places[unknown.name] = np.maximum(index, index.T) if unknown.is_symmetric else index
    return places, size
