"""Copies of one stage function over scenarios and stages: an NLP whose derivatives are assembled from those of one stage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from inc_casadi.arrays import Array

from .ipopt import ca


@dataclass(frozen=True, eq=False)
class Stage:
    """One stage as CasADi expressions: residuals g(theta, s), linear in theta, and a cost c(s).

    theta (P,): what all stages share; s (ns,): what belongs to the stage; data (nd,): what differs between stages but is
    no variable; cost: scalar; residuals (ng,).
    """

    theta: ca.SX
    s: ca.SX
    data: ca.SX
    cost: ca.SX
    residuals: ca.SX


@dataclass(frozen=True, eq=False)
class Copies:
    """A stage, S times: where its parts sit in the vector of all variables.

    columns (ns, S): the variable that each entry of s is, -1 where it is the number in `values` (ns, S); data (nd, S);
    first: the row of the first residual among all constraints. Copies may share an entry of s where it enters their
    residuals linearly with coefficients in theta alone, and no cost.
    """

    stage: Stage
    columns: np.ndarray
    values: Array
    data: Array
    first: int

    @property
    def many(self) -> int:
        """Number of copies S."""
        return self.columns.shape[1]

    @property
    def rows(self) -> np.ndarray:
        """The constraint that each residual is (ng, S)."""
        ng = self.stage.residuals.numel()
        return self.first + np.arange(ng * self.many).reshape(self.many, ng).T

    def local(self, x: ca.MX) -> ca.MX:
        """Return s of all copies (ns, S) as an expression of all variables."""
        extended = ca.vertcat(x, ca.DM(self.values.T.ravel()))
        flat = self.columns.T.ravel()
        index = np.where(flat >= 0, flat, x.numel() + np.arange(flat.size))
        return ca.reshape(extended[index.tolist()], *self.columns.shape)

    def mapped(self, inputs: Sequence[ca.SX], held: Sequence[int], output: ca.SX) -> ca.Function:
        """Return a function of the stage for all copies at once; `held` inputs are the same for all."""
        single = ca.Function("stage", list(inputs), [output])
        return single.map("stages", "serial", self.many, list(held), []) if self.many > 1 else single


class Places(NamedTuple):
    """Entries of a sparse matrix: row, column, which computed number each takes, and the factor on it."""

    row: np.ndarray
    column: np.ndarray
    source: np.ndarray
    factor: Array


@dataclass(frozen=True, eq=False)
class Spread:
    """theta = fixed + sum over (row, column, factor) of factor * x[column]: how the head of x makes up the law."""

    fixed: Array
    row: np.ndarray
    column: np.ndarray
    factor: Array

    def theta(self, x: ca.MX) -> ca.MX:
        """Return theta as an expression of all variables."""
        shape = (self.fixed.size, x.numel())
        return ca.DM(self.fixed) + ca.DM.triplet(self.row.tolist(), self.column.tolist(), ca.DM(self.factor), *shape) @ x

    def through(self, entries: np.ndarray) -> tuple[np.ndarray, np.ndarray, Array]:
        """Return for derivatives by theta[entries] those by x: which entry each comes from, its column and factor.

        >>> doubled = Spread(np.zeros(2), np.array([1, 1]), np.array([5, 6]), np.array([1.0, -1.0]))
        >>> [part.tolist() for part in doubled.through(np.array([0, 1, 1]))]
        [[1, 1, 2, 2], [5, 6, 5, 6], [1.0, -1.0, 1.0, -1.0]]
        """
        order = np.argsort(self.row, kind="stable")
        first = np.searchsorted(self.row[order], np.arange(self.fixed.size + 1))
        many = first[entries + 1] - first[entries]
        source = np.repeat(np.arange(entries.size), many)
        within = np.arange(source.size) - np.repeat(np.cumsum(many) - many, many)
        where = order[first[entries][source] + within]
        return source, self.column[where], self.factor[where]

    def columns(self, part: Copies, entries: np.ndarray) -> tuple[np.ndarray, np.ndarray, Array]:
        """Return the same for entries of (theta, s) in all copies: source (k,), columns (k, S), factors (k,)."""
        P = self.fixed.size
        shared, own = np.flatnonzero(entries < P), np.flatnonzero(entries >= P)
        source, head, factor = self.through(entries[shared])
        places = np.broadcast_to(head[:, None], (head.size, part.many))
        return (np.concatenate([shared[source], own]), np.concatenate([places, part.columns[entries[own] - P]]),
                np.concatenate([factor, np.ones(own.size)]))


@dataclass(frozen=True, eq=False)
class Stagewise:
    """All copies over one vector of `size` variables, as f, g and their derivatives for `nlpsol`.

    f sums the costs of all copies; g stacks their residuals and, last, `linear` (l, size) times the variables. CasADi
    differentiates one stage; sparsity and sums of the whole come from indices, which builds in a fraction of a second.
    """

    size: int
    spread: Spread
    copies: tuple[Copies, ...]
    linear: ca.DM

    def expressions(self) -> tuple[ca.MX, ca.MX, ca.MX]:
        """Return x, f(x) and g(x)."""
        x = ca.MX.sym("x", self.size)
        theta, f, g = self.spread.theta(x), ca.MX(0), []
        for part in self.copies:
            stage, s = part.stage, part.local(x)
            f += ca.sum2(part.mapped([stage.s, stage.data], [], stage.cost)(s, ca.DM(part.data)))
            g.append(ca.vec(part.mapped([stage.theta, stage.s], [0], stage.residuals)(theta, s)))
        return x, f, ca.vertcat(*g, self.linear @ x)

    def gradient(self) -> ca.Function:
        """Return (x, p) -> (f, grad f)."""
        x, f, _ = self.expressions()
        numbers, places = [], []
        for part in self.copies:
            stage = part.stage
            slope = ca.jacobian(stage.cost, stage.s).T
            numbers.append(part.mapped([stage.s, stage.data], [], _nonzeros(slope))(part.local(x), ca.DM(part.data)))
            rows = part.columns[np.array(slope.sparsity().row(), dtype=int)]
            places.append(_kept(rows, np.zeros_like(rows), _sources(np.arange(slope.nnz()), part.many, slope.nnz()),
                                np.ones(slope.nnz())))
        return ca.Function("grad_f", [x, ca.MX.sym("p", 0, 0)], [f, ca.densify(_matrix(numbers, places, (self.size, 1)))])

    def jacobian(self) -> ca.Function:
        """Return (x, p) -> (g, jac g)."""
        x, _, g = self.expressions()
        theta, numbers, places = self.spread.theta(x), [], []
        for part in self.copies:
            stage = part.stage
            J = ca.jacobian(stage.residuals, ca.vertcat(stage.theta, stage.s))
            numbers.append(part.mapped([stage.theta, stage.s], [0], _nonzeros(J))(theta, part.local(x)))
            row, column = _triplet(J)
            source, columns, factor = self.spread.columns(part, column)
            places.append(_kept(part.rows[row[source]], columns, _sources(source, part.many, J.nnz()), factor))
        row, column = _triplet(self.linear)
        numbers.append(ca.MX(ca.DM(self.linear.nonzeros())))
        places.append(Places(g.numel() - self.linear.shape[0] + row, column, np.arange(row.size), np.ones(row.size)))
        return ca.Function("jac_g", [x, ca.MX.sym("p", 0, 0)], [g, _matrix(numbers, places, (g.numel(), self.size))])

    def hessian(self) -> ca.Function:
        """Return (x, p, lam_f, lam_g) -> the upper triangle of the Hessian of lam_f f + lam_g'g."""
        x, _, g = self.expressions()
        theta, numbers, places = self.spread.theta(x), [], []
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
        for part in self.copies:
            stage = part.stage
            factor, weights = ca.SX.sym("factor"), ca.SX.sym("weights", stage.residuals.numel())
            lagrangian = factor * stage.cost + ca.dot(weights, stage.residuals)
            H = ca.triu(ca.hessian(lagrangian, ca.vertcat(stage.theta, stage.s))[0])
            curvature = part.mapped([stage.theta, stage.s, stage.data, factor, weights], [0, 3], _nonzeros(H))
            own = ca.reshape(lam_g[part.first:part.first + part.rows.size], *part.rows.shape)
            numbers.append(curvature(theta, part.local(x), ca.DM(part.data), lam_f, own))
            row, column = _triplet(H)
            assert np.all(column >= stage.theta.numel()), "residuals must be linear in theta"
            source, rows, scale = self.spread.columns(part, row)
            columns = part.columns[column[source] - stage.theta.numel()]
            places.append(_kept(rows, columns, _sources(source, part.many, H.nnz()), scale))
        upper = _matrix(numbers, places, (self.size, self.size))
        return ca.Function("hess_lag", [x, ca.MX.sym("p", 0, 0), lam_f, lam_g], [upper])


def _nonzeros(matrix: ca.SX) -> ca.SX:
    entries: Any = matrix.nonzeros()
    return ca.vertcat(*entries) if entries else ca.SX(0, 1)


def _triplet(matrix: ca.SX | ca.DM) -> tuple[np.ndarray, np.ndarray]:
    row, column = matrix.sparsity().get_triplet()
    return np.array(row, dtype=int), np.array(column, dtype=int)


def _sources(local: np.ndarray, many: int, width: int) -> np.ndarray:
    """Return where the numbers of nonzeros `local` of one stage sit among those of all copies (k, S)."""
    return local[:, None] + width * np.arange(many)


def _kept(rows: np.ndarray, columns: np.ndarray, source: np.ndarray, factor: Array) -> Places:
    """Return the entries (k, S) as one list, without those of fixed values, which sit at -1; factor (k,)."""
    kept = (rows >= 0) & (columns >= 0)
    return Places(rows[kept], columns[kept], source[kept], np.broadcast_to(factor[:, None], kept.shape)[kept])


def _matrix(numbers: Sequence[ca.MX], places: Sequence[Places], shape: tuple[int, int]) -> ca.MX:
    """Return the sparse matrix whose entries are these numbers times factors; no two at one place."""
    begins = np.cumsum([0] + [part.numel() for part in numbers])
    row, column, factor = (np.concatenate([place[i] for place in places]) for i in (0, 1, 3))
    source = np.concatenate([place.source + begin for place, begin in zip(places, begins, strict=False)])
    order = np.lexsort((row, column))
    starts = np.searchsorted(column[order], np.arange(shape[1] + 1))
    sparsity = ca.Sparsity(*shape, starts.tolist(), row[order].tolist())
    values = ca.vertcat(*[ca.vec(part) for part in numbers])[source[order].tolist()]
    return ca.MX(sparsity, values * ca.DM(factor[order]))
