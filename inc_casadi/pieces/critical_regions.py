"""A model predictive law with any limits as a source of affine laws: its critical regions, found where they are needed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..arrays import Array
from ..brief import Brief
from ..errors import ConvergenceError, InfeasibleError
from ..mpc import MPC
from ..projection import projection
from ..sets import Polytope
from .laws import Laws, heights

DEPENDENT = 1e-10  # a constraint whose part outside the span of the active ones is this short lies in their span
ACTIVE_TOL = 1e-9  # in floats, a slack or multiplier beyond zero by this share of its terms is zero


@dataclass(frozen=True, eq=False)
class CriticalRegions(Brief):
    """The law of an `MPC`, piecewise affine, with active sets for patterns: a source of affine laws like `PiecewiseLoop`.

    With the program min 1/2 v'H v + v'F x over G v <= w + E x, v = -H^{-1}(F x + G'l) and slack s = w + E x - G v,

        s = d(x) + D l,   D = G H^{-1} G',   d(x) = w + (E + G H^{-1} F) x,   s >= 0, l >= 0, s'l = 0

    is its optimality, necessary and sufficient. For a set B of active constraints with independent rows, l_B =
    -D_BB^{-1} d_B(x), s = d + D_.B l_B are affine in x, and the law of B holds exactly where l_B >= 0 and s >= 0 outside B:
    those are the heights z >= 0 of `Laws`. Active rows may be dependent at x: B is an independent part of them, from a dual
    active-set method (D. Goldfarb, A. Idnani, 1983), and v is unique all the same.

    Rows are scaled to D_ii = 1. Limits that no input changes follow as further slacks, never active. Only in floats.

    >>> from inc_casadi import Box, Plant
    >>> law = CriticalRegions(MPC(Plant([[1.2]], [[1.0]]), [[1.0]], [[1.0]], 2, Box([-1.0], [1.0])))
    >>> law(np.array([[0.1, 5.0]])).round(4).tolist()
    [[-0.0794, -1.0]]
    """

    mpc: MPC
    arithmetic: str = "float"
    kink_tolerance: float = ACTIVE_TOL

    @staticmethod
    def numbers(array: Array) -> Array:
        """Return the array in floats."""
        return np.asarray(array, dtype=float)

    def __call__(self, x: Array) -> Array:
        """Return the first inputs (m, N) at states (n, N).

        Raises InfeasibleError where no sequence of inputs keeps the limits.
        """
        patterns, which = self.distinct(self.patterns_at(x.T))
        laws = self.laws(patterns)
        return (np.einsum("kmn,nk->km", laws.Gx[which], x) + laws.g[which]).T

    def patterns_at(self, x: Array, guess: np.ndarray | None = None) -> np.ndarray:
        """Return an active set (N, k), of zeros and ones, whose law holds at each point x (N, n).

        A guess is tried first, then the active sets met before, and what is left is solved, one point at a time.

        Raises InfeasibleError where no sequence of inputs keeps the limits.
        """
        patterns = np.zeros((len(x), self.size), dtype=int) if guess is None else guess.copy()
        left = np.arange(len(x)) if guess is None else self._unsettled(patterns, x)
        for pattern in list(self._memory):
            known = np.frombuffer(pattern, dtype=int)
            left = self._claimed(known, left, x, patterns)
        while left.size:
            found = self.active_set(x[left[0]])
            patterns[left[0]] = found
            left = self._claimed(found, left[1:], x, patterns)
        return patterns

    def laws(self, patterns: np.ndarray) -> Laws:
        """Return the laws of active sets (k, q): z are multipliers of the active constraints and slacks of the others."""
        n, m = self.mpc.plant.n, self.mpc.plant.m
        rows = [self._law(pattern) for pattern in patterns]
        shapes = ((self.size, n), (self.size,), (m, n), (m,))
        Zx, z0, Gx, g = (np.array([row[i] for row in rows]).reshape(-1, *shape) for i, shape in enumerate(shapes))
        zero = np.zeros(patterns.shape)
        return Laws(patterns, Zx, z0, Gx, g, zero, zero + np.inf)

    def distinct(self, patterns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the distinct rows of patterns (N, q), and for each pattern which of them it is."""
        packed = np.ascontiguousarray(np.packbits(patterns.astype(bool), axis=1))
        keys = packed.view(np.dtype((np.void, packed.shape[1]))).reshape(-1)  # one opaque key a row: quick to sort
        _, first, which = np.unique(keys, return_index=True, return_inverse=True)
        return patterns[first], which.reshape(-1)

    @property
    def size(self) -> int:
        """The number of constraints, those that no input changes among them."""
        return len(self._program[1]) + len(self._fixed)

    def active_set(self, x: Array) -> np.ndarray:
        """Return an active set (q,) with independent rows that is optimal at x (n,), by the dual active-set method.

        The most violated constraint is raised until it holds; multipliers that reach zero on the way leave.

        Raises InfeasibleError when there is no solution, ConvergenceError when rounding keeps it from ending.
        """
        D, d0, dx = self._program[:3]
        if np.any(self._fixed @ np.append(x, 1.0) < -ACTIVE_TOL * (np.abs(self._fixed) @ np.append(np.abs(x), 1.0))):
            raise InfeasibleError(f"x = {x.tolist()} violates a state limit that no input can change")
        d, size = d0 + dx @ x, np.abs(d0) + np.abs(dx) @ np.abs(x)
        active: list[int] = []
        level = np.zeros(0)
        for _ in range(50 * (len(d) + 1)):
            # The multipliers of an active set are solved for anew, so that rounding does not pile up.
            slack = d + D[:, active] @ level
            slack[active] = 0.0
            worst = int(np.argmin(slack / size))
            if slack[worst] >= -ACTIVE_TOL * size[worst]:
                return np.isin(np.arange(self.size), active).astype(int)
            active, level = self._raised(D, d, active, level, worst, x)
        raise ConvergenceError(f"the active constraints at x = {x.tolist()} were not found")

    def _raised(self, D: Array, d: Array, active: list[int], level: Array, p: int, x: Array) -> tuple[list[int], Array]:
        """Add constraint p to the active ones, dropping those whose multipliers reach zero first."""
        raised = 0.0
        while True:
            turn = -np.linalg.solve(D[np.ix_(active, active)], D[active, p]) if active else np.zeros(0)
            rate = D[p, p] + D[p, active] @ turn
            slack = d[p] + D[p, active] @ level + D[p, p] * raised
            full = -slack / rate if rate > DEPENDENT else np.inf
            falling = np.flatnonzero(turn < -DEPENDENT)
            ratios = level[falling] / -turn[falling]
            part = float(ratios.min(initial=np.inf))
            if not np.isfinite(min(full, part)):
                raise InfeasibleError(f"no sequence of {self.mpc.horizon} inputs from x = {x.tolist()} keeps the limits")
            if full <= part:
                active = [*active, p]
                return active, -np.linalg.solve(D[np.ix_(active, active)], d[active])
            gone = int(falling[np.argmin(ratios)])
            raised, level = raised + part, np.delete(level + part * turn, gone)
            active = active[:gone] + active[gone + 1:]

    def _law(self, pattern: np.ndarray) -> tuple[Array, ...]:
        key = pattern.tobytes()
        if key not in self._memory:
            D, d0, dx, free, pulled = self._program
            active = np.flatnonzero(pattern)
            level = -np.linalg.solve(D[np.ix_(active, active)], np.column_stack([dx[active], d0[active]]))
            z = np.column_stack([dx, d0]) + D[:, active] @ level
            z[active] = level
            z = np.vstack([z, self._fixed])
            u = np.column_stack([free, np.zeros(len(free))]) + pulled[:, active] @ level
            self._memory[key] = (z[:, :-1], z[:, -1], u[:, :-1], u[:, -1])
        return self._memory[key]

    def _claimed(self, pattern: np.ndarray, left: np.ndarray, x: Array, patterns: np.ndarray) -> np.ndarray:
        """Give the pattern to those points of `left` where its law holds; return the others."""
        if not left.size:
            return left
        holds = self._holds(self.laws(pattern[None]), np.zeros(len(left), dtype=int), x[left])
        patterns[left[holds]] = pattern
        return left[~holds]

    def _unsettled(self, patterns: np.ndarray, x: Array) -> np.ndarray:
        distinct, which = self.distinct(patterns)
        return np.flatnonzero(~self._holds(self.laws(distinct), which, x))

    @staticmethod
    def _holds(laws: Laws, which: np.ndarray, x: Array) -> np.ndarray:
        outside = heights(laws, which, x[:, None, :])[:, 0, : laws.z0.shape[1]]
        terms = np.einsum("kqn,kn->kq", np.abs(laws.Zx[which]), np.abs(x)) + np.abs(laws.z0[which])
        return (outside <= ACTIVE_TOL * terms).all(axis=1)

    @cached_property
    def _memory(self) -> dict[bytes, tuple[Array, ...]]:
        """Laws already solved, each a pure function of its active set."""
        return {}

    @cached_property
    def _fixed(self) -> Array:
        """The slacks (l, n+1), over (x, 1), of the limits that no input changes."""
        program = self.mpc.condensed
        size = np.linalg.norm(program.S, axis=1)[:, None]
        return np.column_stack([-program.S, program.s]) / np.where(size > 0, size, 1.0)

    @cached_property
    def _program(self) -> tuple[Any, ...]:
        """D, d0, dx with d(x) = d0 + dx x, and the first inputs: free x + pulled l."""
        program, m = self.mpc.condensed, self.mpc.plant.m
        H_F, H_G = np.linalg.solve(program.H, program.F), np.linalg.solve(program.H, program.G.T)
        D = program.G @ H_G
        scale = 1.0 / np.sqrt(np.diag(D))
        D = scale[:, None] * (D + D.T) / 2 * scale
        return D, scale * program.w, scale[:, None] * (program.E + program.G @ H_F), -H_F[:m], -H_G[:m] * scale


def feasible_set(mpc: MPC) -> Polytope:
    """Return the polytope of states from which some sequence of inputs keeps all limits (`projection`).

    Raises EmptySetError when it is empty, flat or unbounded: without state limits there is a solution everywhere.

    >>> from inc_casadi import Box, Plant
    >>> inputs, states = Box([-1.0], [1.0]), Box([-9.0], [9.0])
    >>> law = MPC(Plant([[2.0]], [[1.0]]), [[1.0]], [[1.0]], 3, inputs, states=states, terminal_set=Box([-0.5], [0.5]))
    >>> feasible_set(law).vertices.round(6).tolist()
    [[-0.9375, 0.9375]]
    """
    program = mpc.condensed
    Hx = np.vstack([-program.E, program.S])
    Hv = np.vstack([program.G, np.zeros((len(program.S), program.G.shape[1]))])
    return projection(Hx, Hv, np.concatenate([program.w, program.s]))
