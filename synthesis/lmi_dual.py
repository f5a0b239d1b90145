"""Primal and dual optimum of a semidefinite program: the solvers of `inc_casadi` return the primal one alone."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from inc_casadi.arrays import Array
from inc_casadi.cone_program import ConeProgram, normalized
from inc_casadi.interior_point import FLOOR, PATIENCE, RAY, RESIDUAL, SHORT, SIZE
from inc_casadi.lmi_problem import Problem
from inc_casadi.newton_step import Iterate, advance, inner

STEPS = 100
DEEP = 1e-2  # relative gap of the deeper point


@dataclass(frozen=True, eq=False)
class DualPair:
    """y (v,), strictly feasible, and one X >= 0 per block with <A_e, X> + (linear constraints) = cost_e.

    deeper (v,): a strictly feasible y on the way, with room to all constraints; gap: <X, S> relative to the cost; residual:
    the largest error of the equations, in numbers near 1; infeasible: no y of moderate size is feasible, and nothing else
    is told.
    """

    y: Array
    X: tuple[Array, ...]
    deeper: Array
    gap: float
    residual: float
    infeasible: bool = False


@dataclass(frozen=True, eq=False)
class _Seen:
    """The best strictly feasible iterate so far, by the larger of gap and residual, and the last one that was deep."""

    best: Iterate | None = None
    deep: Iterate | None = None
    merit: float = np.inf
    gap: float = np.inf
    residual: float = np.inf
    infeasible: bool = False


def dual_pair(problem: Problem, tolerance: float = 1e-9) -> DualPair | None:
    """Return the optimum of a problem with its dual; None when no strictly feasible point is found and none is ruled out.

    Minimize cost'y subject to S(y) = C + sum y_e A_e >= 0: the Lagrangian is cost'y - <X, S(y)>. The iteration is that of
    `interior_point.solve`, from the same start; it ends at a relative gap of `tolerance`, or without progress at the best
    iterate, whose gap and residual tell how good it is.

    >>> from inc_casadi.lmi_problem import Block, Term
    >>> cone = Block(np.array([[0.0, 1.0], [1.0, 0.0]]), (Term(np.array([[0, -1], [-1, 1]]), np.eye(2), np.eye(2)),))
    >>> free = np.full(2, np.inf)
    >>> problem = Problem(np.array([1.0, 4.0]), (cone,), np.zeros((0, 2)), np.zeros(0), -free, free)
    >>> dual_pair(problem).X[0].round(5).tolist()
    [[1.0, -2.0], [-2.0, 4.0]]
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        program = normalized(problem)
        seen = _followed(program, tolerance)
        if seen.infeasible:
            return DualPair(np.zeros(problem.size), (), np.zeros(problem.size), np.inf, np.inf, True)
        if seen.best is None or seen.deep is None:
            return None
        return DualPair(program.unknowns * seen.best.y, _unscaled(problem, program, seen.best),
                        program.unknowns * seen.deep.y, seen.gap, seen.residual)


def _followed(program: ConeProgram, tolerance: float) -> _Seen:
    at, seen, merits = _cold(program), _Seen(), [np.inf]
    for _ in range(STEPS):
        gap, residual, infeasible = _view(program, at)
        if infeasible and not at.exact:
            return replace(seen, infeasible=True)
        merits.append(max(gap, residual))
        if at.exact:
            deep = at if seen.deep is None or gap >= DEEP else seen.deep
            better = merits[-1] <= seen.merit
            seen = _Seen(at, deep, merits[-1], gap, residual) if better else replace(seen, deep=deep)
            if gap <= tolerance and residual <= RESIDUAL:
                return seen
        if len(merits) > 2 * PATIENCE and min(merits[-PATIENCE:]) > 0.9 * min(merits[:-PATIENCE]):
            return seen
        try:
            at, step = advance(program, at)
        except np.linalg.LinAlgError:
            return seen
        if step < SHORT:
            return seen
    return seen


def _cold(program: ConeProgram) -> Iterate:
    linear, rows = program.constants[-1], len(program.rows)
    slack = np.concatenate([np.full(rows, SIZE), np.maximum(linear[rows:], 1.0)])
    identities = [SIZE * np.eye(len(constant)) for constant in program.constants[:-1]]
    return Iterate(np.zeros(program.cost.size), (*identities, slack), (*identities, SIZE**2 / slack), False)


def _view(program: ConeProgram, at: Iterate) -> tuple[float, float, bool]:
    """Return the relative gap, the residual, and whether X proves infeasibility."""
    image, constant, goal = program.adjoint(at.X), inner(program.constants, at.X), float(program.cost @ at.y)
    gap = max(inner(at.X, at.S), abs(goal + constant)) / max(abs(goal), abs(constant), FLOOR)
    return gap, float(np.max(np.abs(image - program.cost))), bool(np.max(np.abs(image)) <= -RAY * constant)


def _unscaled(problem: Problem, program: ConeProgram, at: Iterate) -> tuple[Array, ...]:
    """Return X for the blocks as the problem states them: the program has multiplied each, and the cost, by a number.

    A block's factor is read off its linear part at one y: a sum over all unknowns, so not zero by chance.
    """
    y = np.random.default_rng(0).normal(size=program.cost.size)
    raw = program.unknowns * y
    per_cost = float(program.cost @ y) / float(problem.cost @ raw)
    factors = [np.linalg.norm(part.image(y)) / np.linalg.norm(block.value(raw) - block.constant)
               for part, block in zip(program.parts, problem.blocks, strict=True)]
    return tuple(X * (factor / per_cost) for X, factor in zip(at.X, factors, strict=False))
