"""The coefficient matrices of a semidefinite constraint, kept as the low-rank products they are made of.

Every unknown y_e enters a block through a symmetric matrix A_e that is a sum of a few products of columns,
A_e = sum_p E_ep (u_a(p) u_b(p)' + u_b(p) u_a(p)') / 2, with the columns u of all the terms' factors side by side in U.
What an interior-point method asks of the A_e then reads off small Gram matrices U'MU, and no A_e is ever formed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import Array
from .lmi_problem import Block, Term

SAME = 13  # decimals to which two columns agree, up to their sizes, when they are taken for one
PATCH = 2**14  # numbers in one patch of the pairs' matrix, small enough for the cache and for memory that is at hand
NARROWEST = 64  # columns of a patch, so that large problems do not fall into slivers
DENSE = 2**15  # numbers in a matrix of weights that is not worth storing as a sparse one


@dataclass(frozen=True, eq=False)
class Coefficients:
    """The matrices A_e (N, N) of v unknowns: A_e = sum_p E_ep (u_a(p) u_b(p)' + u_b(p) u_a(p)') / 2.

    columns: U (N, c); a, b: (p,) the pairs of columns, all different; weights: E (v, p), sparse when it is large.
    """

    columns: Array
    a: NDArray[np.intp]
    b: NDArray[np.intp]
    weights: Any

    def image(self, y: Array) -> Array:
        """Return sum_e y_e A_e, (N, N)."""
        pairs, U = self.weights.T @ y, self.columns
        if self._few:
            half = (U[:, self.a] * pairs) @ U[:, self.b].T
        else:
            Y = np.zeros((U.shape[1], U.shape[1]))
            Y[self.a, self.b] = pairs
            half = U @ Y @ U.T
        return (half + half.T) / 2

    def adjoint(self, M: Array) -> Array:
        """Return the inner products tr(A_e M), (v,), of a symmetric M (N, N)."""
        U = self.columns
        return self.weights @ (np.sum(U[:, self.a] * (M @ U[:, self.b]), axis=0) if self._few
                               else self.gram(M)[self.a, self.b])

    @property
    def _few(self) -> bool:
        """Whether the pairs' products are cheaper one by one than through a (c, c) matrix."""
        N, count = self.columns.shape
        return self.a.size * N <= count * (count + N)

    def gram(self, M: Array) -> Array:
        """Return U'MU, (c, c)."""
        return self.columns.T @ M @ self.columns

    def scaled(self, unknowns: Array, size: float) -> Coefficients:
        """Return the matrices size * unknowns_e * A_e; unknowns: (v,)."""
        from scipy.sparse import diags_array

        return Coefficients(self.columns, self.a, self.b, diags_array(size * unknowns) @ self.weights)


def coefficients(block: Block, size: int) -> Coefficients:
    """Return the coefficient matrices of a block in `size` unknowns.

    An entry Y_ij of a term contributes the pair of the columns l_i and r_j. Columns that agree up to a factor become one,
    and (a, b) is the pair (b, a): with left = right and a symmetric Y the entries ij and ji so become one pair, and in
    general what can be said by one product is computed once.

    >>> symmetric = Term(np.array([[0, 1], [1, 2]]), np.eye(2), -3.0 * np.eye(2))
    >>> A = coefficients(Block(np.zeros((2, 2)), (symmetric,)), 3)
    >>> A.a.size, A.image(np.array([1.0, 2.0, 0.0])).tolist(), A.adjoint(np.eye(2)).tolist()
    (3, [[-3.0, -6.0], [-6.0, 0.0]], [-3.0, 0.0, -3.0])
    """
    from scipy.sparse import coo_array

    columns, which, sizes = _distinct([factor for term in block.terms for factor in (term.left, term.right)],
                                      len(block.constant))
    unknown, a, b = _entries(block.terms)
    weight = sizes[a] * sizes[b]
    low, high = np.minimum(which[a], which[b]), np.maximum(which[a], which[b])
    pairs, number = np.unique(low * max(columns.shape[1], 1) + high, return_inverse=True)
    a, b = np.divmod(pairs, max(columns.shape[1], 1))
    weights = coo_array((weight, (unknown, number)), shape=(size, pairs.size))
    return Coefficients(columns, a, b, weights.toarray() if size * pairs.size <= DENSE else weights.tocsr())


def _entries(terms: tuple[Term, ...]) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Return, for each entry Y_ij that is an unknown: its number, and its two columns among the factors side by side."""
    unknown, a, b, start = [np.zeros(0, np.intp)], [np.zeros(0, np.intp)], [np.zeros(0, np.intp)], 0
    for term in terms:
        i, j = np.nonzero(term.index >= 0)
        unknown.append(term.index[i, j])
        a.append(start + i)
        b.append(start + term.left.shape[1] + j)
        start += term.left.shape[1] + term.right.shape[1]
    return np.concatenate(unknown), np.concatenate(a), np.concatenate(b)


def _distinct(factors: list[Array], rows: int) -> tuple[Array, NDArray[np.intp], Array]:
    """Return the factors' columns without repetitions, which of them each column is, and its factor (0 for a column of 0).

    Columns are compared after division by their largest entry. They may differ by rounding errors when one factor is
    the multiple of another, which is why the comparison leaves out the last decimals.
    """
    U = np.hstack([np.zeros((rows, 0)), *factors])
    if not U.size:
        return np.zeros((rows, U.shape[1])), np.arange(U.shape[1]), np.zeros(U.shape[1])
    sizes = U[np.argmax(np.abs(U), axis=0), np.arange(U.shape[1])]
    U = U / np.where(sizes == 0.0, 1.0, sizes)
    _, first, which = np.unique(np.round(U.T, SAME) + 0.0, axis=0, return_index=True, return_inverse=True)
    return U[:, first], which.reshape(-1), sizes


def schur(A: Coefficients, gram_x: Array, gram_z: Array) -> Array:
    """Return H (v, v), H_ef = tr(A_e X A_f Z), from the Gram matrices U'XU and U'ZU of two symmetric matrices.

    For two pairs p = (a, b) and q = (c, d) of columns, with x_ac = u_a'X u_c and z_ac = u_a'Z u_c,
    tr(A_p X A_q Z) = (x_ac z_bd + x_ad z_bc + x_bc z_ad + x_bd z_ac) / 4,
    so that the pairs' matrix K is a sum of products of gathered entries, and H = E K E'. K is symmetric: only the patches on
    its diagonal and, counted twice, those below them are formed, and H is what symmetrizing leaves.

    >>> A = coefficients(Block(np.zeros((2, 2)), (Term(np.array([[0, 1], [1, 2]]), np.eye(2), np.eye(2)),)), 3)
    >>> schur(A, A.gram(np.eye(2)), A.gram(2 * np.eye(2))).tolist()
    [[2.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 2.0]]
    """
    size, pairs = A.weights.shape
    half = np.empty((size, pairs))
    width = max(NARROWEST, PATCH // max(pairs, 1))
    for start in range(0, pairs, width):
        part = slice(start, start + width)
        half[:, part] = A.weights[:, start:] @ _pairs(A, gram_x, gram_z, part)
    H = A.weights @ half.T
    return (H + H.T) / 2


def _pairs(A: Coefficients, gram_x: Array, gram_z: Array, part: slice) -> Array:
    """Return the sums of products for the pairs p from `part` on and the pairs q of `part`, those below `part` doubled."""
    c, d, a, b = A.a[part], A.b[part], A.a[part.start:], A.b[part.start:]
    xc, xd, zc, zd = gram_x[:, c], gram_x[:, d], gram_z[:, c], gram_z[:, d]
    K = xc[a] * zd[b]
    K += xd[a] * zc[b]
    K += xc[b] * zd[a]
    K += xd[b] * zc[a]
    K[: len(c)] /= 4
    K[len(c):] /= 2
    return K
