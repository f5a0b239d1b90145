"""From a claim and a multiplier to a semidefinite program: the `Affine` reading of their matrix inequalities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .affine import Affine, index_of
from .arrays import Array
from .claims.base import DECREASE, POSITIVE, Claim
from .inequalities import Inequalities
from .lmi_frame import Frame, frame_of_loop
from .lmi_problem import Block, Problem, Term
from .loop import ClosedLoop
from .multipliers import Multiplier, Unknown

LARGEST = 1e3  # of a multiplier's unknown, in units of what it does to the conditions: keeps what nothing bounds at hand
LARGEST_OF_CLAIM = 1e6  # the same for the claim's own unknowns
LARGEST_SCALE = 1e4  # of P against the stand-in's cost-to-go while only the margin counts
TIE_BREAK = 1e-9


@dataclass(frozen=True, eq=False)
class Assembly:
    """The semidefinite programs of a claim: to minimize its objective, and to make the smallest eigenvalue large.

    inequalities: over floats; frame: the coordinates that a solver works in.
    """

    inequalities: Inequalities
    frame: Frame

    @cached_property
    def _index(self) -> tuple[dict[str, NDArray[np.intp]], int]:
        return index_of(self.inequalities.unknowns)

    @cached_property
    def _axes(self) -> dict[str, Array]:
        """For each symmetric unknown over states the matrix S of its frame: y holds S'PS, which is of size one."""
        graph, n = self.inequalities.graphs.get(POSITIVE), self.inequalities.loop.n
        axes = {}
        for unknown in self.inequalities.claim.unknowns(self.inequalities.graphs):
            if unknown.is_symmetric:
                k = unknown.shape[0]
                plain = graph is None or k == n
                axes[unknown.name] = self.frame.back if plain else self.frame.congruence(graph)[:k, :k]  # type: ignore[arg-type]
        return axes

    @cached_property
    def _values(self) -> dict[str, Affine]:
        values = {name: Affine.unknown(index) for name, index in self._index[0].items()}
        for name, S in self._axes.items():
            back = np.linalg.inv(S)
            values[name] = back.T @ values[name] @ back
        return values

    @cached_property
    def _blocks(self) -> tuple[Block, ...]:
        graphs = self.inequalities.graphs
        found = []
        for name, condition in self.inequalities.conditions(self._values).items():
            graph = graphs.get(POSITIVE if name == "P" else name)
            S = self.frame.back if graph is None else self.frame.congruence(graph)
            found.append(condition.block(S))
        return tuple(block for block in found if block.constant.size)

    @cached_property
    def _rows(self) -> tuple[Array, Array]:
        size = self._index[1]
        parts = [sign.rows(size) for sign in self.inequalities.signs(self._values).values()]
        A, b = [A for A, _ in parts], [b for _, b in parts]
        return np.vstack([np.zeros((0, size)), *A]), np.concatenate([np.zeros(0), *b])

    @cached_property
    def _bounds(self) -> tuple[Array, Array]:
        """Bounds on y: the signs, and LARGEST in units of what an unknown does to the conditions."""
        effect = np.zeros(self._index[1])
        for block in self._blocks:
            for term in block.terms:
                a, b = np.nonzero(term.index >= 0)
                sizes = np.linalg.norm(term.left, axis=0)[a] * np.linalg.norm(term.right, axis=0)[b]
                np.add.at(effect, term.index[a, b], sizes)
        largest = np.full(self._index[1], LARGEST)
        for unknown in self.inequalities.claim.unknowns(self.inequalities.graphs):
            index = self._index[0][unknown.name]
            largest[index[index >= 0]] = LARGEST_OF_CLAIM
        upper = largest / np.where(effect > 0, effect, 1.0)
        lower = -upper
        for unknown in self.inequalities.unknowns:
            lower[self._index[0][unknown.name][unknown.signed]] = 0.0
        return lower, upper

    @cached_property
    def _sizes(self) -> Array:
        """The row that gives the mean eigenvalue of the symmetric unknowns over states, in the frame."""
        row = np.zeros(self._index[1])
        for name in self._axes:
            row[np.diag(self._index[0][name])] = 1.0 / sum(map(len, self._axes.values()))
        return row

    @cached_property
    def _objective(self) -> Array | None:
        """The claim's objective as a row over y, divided by what it is at P = T'T, so that tolerances are relative."""
        goal = self.inequalities.claim.objective(self.inequalities.graphs, self._values)
        if goal is None:
            return None
        row = goal.rows(self._index[1])[0][0]
        stand_in = self.inequalities.zeros()
        for unknown in self.inequalities.claim.unknowns(self.inequalities.graphs):
            stand_in[unknown.name] = _like_frame(unknown, self.frame, self.inequalities.loop.n)
        size = abs(float(np.sum(self.inequalities.claim.objective(self.inequalities.graphs, stand_in))))
        return row / (size if size > 0 else 1.0)

    @property
    def minimizes(self) -> bool:
        """Whether the claim has something to minimize."""
        return self._objective is not None

    def cheapest(self, slack: float = 0.0) -> Problem:
        """Return the problem of minimizing the objective, every condition at least `slack` I in the frame, and signs."""
        assert self._objective is not None
        rows, offset = self._rows
        blocks = tuple(Block(block.constant - slack * np.eye(len(block.constant)), block.terms) for block in self._blocks)
        return Problem(self._objective + TIE_BREAK * self._sizes, blocks, rows, offset - slack, *self._bounds)

    def widest(self) -> Problem:
        """Return the problem of maximizing the smallest eigenvalue, at most 1, with P of bounded size.

        A claim without constant terms is homogeneous, so P of mean size 1 is as good as any.
        """
        size, (lower, upper), (rows, offset) = self._index[1], self._bounds, self._rows
        blocks = []
        for block in self._blocks:
            eye = np.eye(len(block.constant))
            index = np.full(eye.shape, -1)
            np.fill_diagonal(index, size)
            blocks.append(Block(block.constant, (*block.terms, Term(index, -eye, eye))))
        homogeneous = not any(np.any(block.constant) for block in self._blocks)
        rows = np.hstack([np.vstack([rows, -self._sizes]), np.zeros((len(rows) + 1, 1))])
        offset = np.append(offset, 1.0 if homogeneous else LARGEST_SCALE)
        cost = np.append(np.zeros(size), -1.0)
        return Problem(cost, tuple(blocks), rows, offset, np.append(lower, -LARGEST_OF_CLAIM), np.append(upper, 1.0))

    def values_at(self, y: Array) -> dict[str, Array]:
        """Return the unknowns at a solver's point: exactly symmetric, without the negative entries that rounding leaves."""
        found = {}
        for unknown in self.inequalities.unknowns:
            index = self._index[0][unknown.name]
            entries = np.where(index >= 0, y[index], 0.0) if index.size else np.zeros(unknown.shape)
            if unknown.name in self._axes:
                back = np.linalg.inv(self._axes[unknown.name])
                entries = back.T @ entries @ back
                entries = (entries + entries.T) / 2
            found[unknown.name] = np.where(unknown.signed, np.maximum(entries, 0.0), entries)
        return found

    def point(self, values: Mapping[str, Array]) -> Array:
        """Return the solver's point for given values: the inverse of `values_at`."""
        y = np.zeros(self._index[1])
        for name, index in self._index[0].items():
            S = self._axes.get(name)
            value = np.asarray(values[name]) if S is None else S.T @ values[name] @ S
            y[index[index >= 0]] = value[index >= 0]
        return y


def assembled(loop: ClosedLoop, claim: Claim, multiplier: Multiplier, frame: Frame | None = None) -> Assembly:
    """Return the programs of a claim in the frame given, or in that of the loop's linear stand-in."""
    inequalities = Inequalities(loop, claim, multiplier)
    return Assembly(inequalities, frame or frame_of_loop(loop, _stage(inequalities)))


def _stage(inequalities: Inequalities) -> Array:
    """Return what a step costs over (x, eta): minus the decrease conditions with every unknown zero."""
    size = inequalities.loop.n + inequalities.loop.q
    at_zero = inequalities.conditions(inequalities.zeros())
    return -sum((condition[:size, :size] for name, condition in at_zero.items() if name.startswith(DECREASE)),
                start=np.zeros((size, size)))


def _like_frame(unknown: Unknown, frame: Frame, n: int) -> Array:
    """Return T'T for a matrix over states, with ones for what is no state; ones for a vector."""
    if not unknown.is_symmetric:
        return np.ones(unknown.shape)
    value = np.eye(unknown.shape[0])
    value[:n, :n] = frame.T.T @ frame.T
    return value
