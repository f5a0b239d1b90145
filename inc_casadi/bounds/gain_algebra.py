"""The matrix algebra of u = F y for many gains at once: how a gain moves the loop, and symmetric matrices as vectors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np

from ..arrays import Array
from ..plant import Plant
from ..spec import Spec
from .gain_coordinates import Matrices, written
from .moves import UNIT


@dataclass(frozen=True, eq=False)
class Gains:
    """The gains F (m, p) as d = m p variables, rows first: F = F0 + sum_i delta_i E_i.

    The input moves by delta_i G_i, G_i = E_i C, and A + B F C by delta_i B_i, B_i = B E_i C.

    T : (n, n), x = T z: the coordinates z in which all matrices are written (`written`), or None for x itself

    >>> from inc_casadi import Box
    >>> Gains(Plant(1.5, 2.0), Spec(1.0, 0.0, 1.0, Box(-1, 1))).states.tolist()
    [[[2.0]]]
    """

    plant: Plant
    spec: Spec
    T: Array | None = None

    @cached_property
    def data(self) -> Matrices:
        """A, B, C, Q and S0 in the coordinates."""
        return written(self.plant, self.spec, self.T)

    @property
    def d(self) -> int:
        """The number m p of entries."""
        return self.plant.m * self.plant.p

    @cached_property
    def inputs(self) -> Array:
        """The matrices G_i, (d, m, n)."""
        m, p = self.plant.m, self.plant.p
        return np.einsum("ia,jn->ijan", np.eye(m), self.data.C).reshape(m * p, m, self.plant.n)

    @cached_property
    def states(self) -> Array:
        """The matrices B_i, (d, n, n)."""
        return self.data.B @ self.inputs

    @cached_property
    def sizes(self) -> Array:
        """The norms (d,) of the B_i."""
        return norm(self.states)

    @cached_property
    def prices(self) -> Array:
        """Bounds (d, d) on the norms of the G_i'R G_j."""
        rows = np.linalg.norm(self.data.C, axis=1)
        return np.kron(np.abs(self.spec.R), np.outer(rows, rows))

    @cached_property
    def pairs(self) -> np.ndarray:
        """The monomials delta_i delta_j as sorted indices (q, 2)."""
        return np.array(list(combinations_with_replacement(range(self.d), 2)))

    @cached_property
    def triples(self) -> np.ndarray:
        """The monomials delta_i delta_j delta_k as sorted indices (t, 3)."""
        return np.array(list(combinations_with_replacement(range(self.d), 3)))

    @cached_property
    def sum_pairs(self) -> Array:
        """Ones (q, d d) where an ordered pair makes the monomial."""
        return _same(self.pairs, np.indices((self.d,) * 2).reshape(2, -1).T)

    @cached_property
    def sum_triples(self) -> Array:
        """Ones (t, d d d) where an ordered triple makes the monomial."""
        return _same(self.triples, np.indices((self.d,) * 3).reshape(3, -1).T)

    @cached_property
    def sum_mixed(self) -> Array:
        """Ones (t, d q) where a variable and a monomial of second order make the monomial."""
        return _same(self.triples, np.array([(i, *pair) for i in range(self.d) for pair in self.pairs]))

    @cached_property
    def counts(self) -> Array:
        """How often (t, d) each variable occurs in each monomial of third order."""
        return np.sum(self.triples[:, :, None] == np.arange(self.d), axis=1).astype(float)

    def closed(self, centers: Array) -> tuple[Array, Array]:
        """Return F0 C (N, m, n) and A + B F0 C (N, n, n) for centres (N, d)."""
        G = centers.reshape(-1, self.plant.m, self.plant.p) @ self.data.C
        return G, self.data.A + self.data.B @ G

    def pushed(self, X: Array) -> Array:
        """Return B_i'X_q (N, d, q, n, n) for X (N, q, n, n); each B_i is a column of B times a row of C."""
        N, q, n, _ = X.shape
        return np.einsum("Nqil,jk->Nijqkl", self.data.B.T @ X, self.data.C).reshape(N, self.d, q, n, n)

    def steered(self, X: Array) -> Array:
        """Return X_q B_i (N, q, d, n, n) for X (N, q, n, n)."""
        N, q, n, _ = X.shape
        return np.einsum("Nqki,jl->Nqijkl", X @ self.data.B, self.data.C).reshape(N, q, self.d, n, n)


def _same(monomials: np.ndarray, index: np.ndarray) -> Array:
    return np.all(monomials[:, None] == np.sort(index, axis=1), axis=2).astype(float)


@dataclass(frozen=True, eq=False)
class Upper:
    """Symmetric (n, n) matrices as the s = n (n + 1) / 2 entries of their upper triangle."""

    n: int

    @cached_property
    def index(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of the entries."""
        i, j = np.triu_indices(self.n)
        return i, j

    def pack(self, X: Array) -> Array:
        """Return the entries (..., s) of the symmetric part of X (..., n, n).

        >>> Upper(2).pack(np.array([[1.0, 4.0], [0.0, 3.0]])).tolist()
        [1.0, 2.0, 3.0]
        """
        i, j = self.index
        return (X[..., i, j] + X[..., j, i]) / 2

    def unpack(self, x: Array) -> Array:
        """Return the matrices (..., n, n).

        >>> Upper(2).unpack(np.array([1.0, 2.0, 3.0])).tolist()
        [[1.0, 2.0], [2.0, 3.0]]
        """
        X = np.empty((*x.shape[:-1], self.n, self.n))
        i, j = self.index
        X[..., i, j] = x
        X[..., j, i] = x
        return X

    def congruence(self, A: Array) -> Array:
        """Return the matrices (..., s, s) of the maps X -> A'X A for A (..., n, n).

        >>> A, upper = np.array([[1.0, 2.0], [3.0, 4.0]]), Upper(2)
        >>> (upper.congruence(A) @ upper.pack(np.eye(2))).tolist(), (A.T @ A).tolist()
        ([10.0, 14.0, 20.0], [[10.0, 14.0], [14.0, 20.0]])
        """
        i, j = self.index
        first = A[..., i[None, :], i[:, None]] * A[..., j[None, :], j[:, None]]
        second = A[..., j[None, :], i[:, None]] * A[..., i[None, :], j[:, None]]
        return first + np.where(i == j, 0.0, 1.0) * second


def both(X: Array) -> Array:
    """Return X + X' over the last two axes.

    >>> both(np.array([[1.0, 2.0], [0.0, 3.0]])).tolist()
    [[2.0, 2.0], [2.0, 6.0]]
    """
    return X + np.swapaxes(X, -1, -2)


def norm(X: Array) -> Array:
    """Return Frobenius norms over the last two axes.

    >>> float(norm(np.array([[3.0, 4.0]])))
    5.0
    """
    return np.sqrt(np.sum(X * X, axis=(-1, -2)))


def powers(widths: Array, monomials: np.ndarray) -> Array:
    """Return the largest size (N, q) of monomials (q, order) for variables within widths (N, d).

    >>> powers(np.array([[2.0, 3.0]]), np.array([[0, 0], [0, 1]])).tolist()
    [[4.0, 6.0]]
    """
    return np.prod(widths[:, monomials], axis=2)


def absolute(M: Array, weights: Array) -> tuple[Array, Array]:
    """Return X (N, n, n) >= +-sum_t +-weights_t M_t, and by how much it may fail to be (N,).

    The square root is operator concave, so with c_t = weights_t |M_t| and any sizes c = sum_t c_t

        sum_t weights_t |M_t| <= (c sum_t (weights_t M_t)^2 / c_t)^(1/2),

    which is equality where the M_t are multiples of one another, and takes one decomposition instead of t. By
    |G^(1/2) - X|^2 <= |G - X^2| the root X of G is trusted up to the residual of its square.

    M : (N, t, n, n) symmetric; weights : (N, t) >= 0

    >>> absolute(np.array([[[[0.0, 1.0], [1.0, 0.0]]]]), np.array([[2.0]]))[0].round(12).tolist()
    [[[2.0, 0.0], [0.0, 2.0]]]
    """
    N, t, n, _ = M.shape
    sizes = weights * norm(M)
    total = np.sum(sizes, axis=1)
    factors = total[:, None] * np.divide(weights**2, sizes, out=np.zeros_like(sizes), where=sizes > 0)
    across = np.swapaxes(M, 1, 2).reshape(N, n, t * n)
    G = np.swapaxes(M * factors[..., None, None], 1, 2).reshape(N, n, t * n) @ np.swapaxes(across, 1, 2)
    values, V = np.linalg.eigh(both(G) / 2)
    X = (V * np.sqrt(np.maximum(values, 0.0))[:, None]) @ np.swapaxes(V, 1, 2)
    X = both(X) / 2
    off = norm(both(G) / 2 - X @ X) + 32 * UNIT * n * (t + n) * total**2
    return X, np.sqrt(off)
