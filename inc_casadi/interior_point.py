"""Solve a semidefinite program in inequality form by a primal-dual interior-point method, with NumPy and LAPACK alone.

minimize cost'y subject to S = C + sum_e y_e A_e in the cone; its dual is to maximize -<C, X> subject to <A_e, X> = cost_e
with X in the cone, and the difference of the two values is <X, S> >= 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .arrays import Array, vector
from .cone_program import ConeProgram, normalized
from .lmi_problem import Problem, Solution
from .newton_step import Iterate, advance, inner, inside, inverse_of, roots

SIZE = 10.0  # of S and of X at an infeasible start, in a program of numbers near 1
FLOOR = 1e-2  # value of a program of numbers near 1 below which its gap is not taken relative to it
RESIDUAL = 1e-6  # of <A_e, X> = cost_e at an optimum, in the same numbers
RAY = 1e-8  # of <A_e, X> = 0, relative to -<C, X>, at a proof of infeasibility
DEEP = 1e-4  # relative gap of the interior point that is returned beside the optimal one
SHORT = 1e-10  # step length that counts as none; on the way to a far optimum useful steps can be as short as 1e-8
PATIENCE = 12  # iterations without progress
REPAIRS = (0.0, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2, 1.0)  # of the way to the interior point, against rounding errors
Stop = Callable[[Array], bool]


@dataclass(frozen=True, eq=False)
class View:
    """What an iterate shows: relative gap, residual of <A_e, X> = cost_e, and whether X proves infeasibility."""

    gap: float
    residual: float
    infeasible: bool


@dataclass(frozen=True, eq=False)
class Run:
    """A run so far. best: the strictly feasible iterate of least gap; deep: the last with a gap above depth; None so far."""

    at: Iterate
    depth: float = DEEP
    best: Iterate | None = None
    deep: Iterate | None = None
    gap: float = np.inf
    residual: float = np.inf
    status: str = "limit"
    iterations: int = 0


def solve(problem: Problem, *, tolerance: float = 1e-8, max_iterations: int = 100, start: Array | None = None,
          stop: Stop | None = None, depth: float = DEEP) -> Solution:
    """Return the minimizer of the problem, strictly inside the constraints whenever any point is found there.

    Infeasible primal-dual predictor-corrector steps (`newton_step.advance`) from a multiple of the identity. From the
    first y on whose slack S(y) is inside the cone, S is that slack, recomputed from y, so every later iterate satisfies
    the constraints strictly. The words of the status:
        "optimal"     the relative gap is at most `tolerance`
        "infeasible"  an X in the cone has <C, X> = -1 and |<A_e, X>| <= 1e-8, all in scaled numbers, while S(y) >= 0
                      would say 0 <= <S(y), X> = -1 + sum_e y_e <A_e, X>: no y of moderate size is feasible
        "stopped"     `stop` said so
        "stalled"     no more progress, as when the cost has no minimum; "limit": `max_iterations` are over.
    A run that finds neither a feasible point nor a proof is followed by one without cost, then by one from its point.

    tolerance: relative gap; start: (v,) a strictly feasible y to begin at, with X = mu S^-1 (ignored when it is not
    strictly feasible); stop: called with strictly feasible y, True ends the search; depth: relative gap of the interior
    point that is returned beside the optimal one. X and the residual are those of the least gap.
    Raises DimensionError when start has not the size of the cost.

    >>> from inc_casadi.lmi_problem import Block, Term
    >>> cone = Block(np.array([[0.0, 1.0], [1.0, 0.0]]), (Term(np.array([[0, -1], [-1, 1]]), np.eye(2), np.eye(2)),))
    >>> free = np.full(2, np.inf)
    >>> found = solve(Problem(np.array([1.0, 4.0]), (cone,), np.zeros((0, 2)), np.zeros(0), -free, free))
    >>> found.status, np.round(found.y, 5).tolist(), float(np.prod(found.y)) > 1.0
    ('optimal', [2.0, 0.5], True)
    >>> found.X[0].round(5).tolist()
    [[1.0, -2.0], [-2.0, 4.0]]
    """
    y = None if start is None else vector("start", start, problem.size)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # a diverging run ends as "stalled"
        program = normalized(problem)
        if not (program.degree and problem.size):
            return without_search(problem)
        y = None if y is None else y / program.unknowns
        halt = None if stop is None else lambda y: stop(y * program.unknowns)
        first = (None if y is None else _warm(program, y)) or _cold(program)
        run = _run(program, Run(first, depth), tolerance, max_iterations, halt)
        if run.best is None and run.status != "infeasible":
            run = _second_chance(program, run, tolerance, max_iterations, halt)
        return _solution(problem, program, run)


def without_search(problem: Problem) -> Solution:
    """Return the answer to a problem without unknowns or without constraints.

    >>> none = np.zeros(0)
    >>> without_search(Problem(none, (), np.zeros((1, 0)), np.array([-1.0]), none, none)).status
    'infeasible'
    """
    y = np.zeros(problem.size)
    feasible, bounded = problem.violation(y) <= 0.0, not np.any(problem.cost)
    status = "infeasible" if not feasible else "optimal" if bounded else "stalled"
    return Solution(y, y if problem.violation(y) < 0.0 else None, status, 0.0 if status == "optimal" else np.inf, 0)


def _cold(program: ConeProgram) -> Iterate:
    """Return y = 0 with multiples of the identity; a bound that y = 0 satisfies keeps its own slack, however large."""
    linear, rows = program.constants[-1], len(program.rows)
    slack = np.concatenate([np.full(rows, SIZE), np.maximum(linear[rows:], 1.0)])
    identities = [SIZE * np.eye(len(constant)) for constant in program.constants[:-1]]
    return Iterate(np.zeros(program.cost.size), (*identities, slack), (*identities, SIZE**2 / slack), False)


def _warm(program: ConeProgram, y: Array) -> Iterate | None:
    """Return y with S = S(y) and X = mu S^-1, or None when S(y) is not inside the cone.

    On the central path mu A(S^-1) = cost, so mu compares the norms of the two: away from the path a larger X leaves more
    room for the first steps than the least-squares mu would. Nor may mu be so small that they are caught at the boundary.
    """
    S = program.slack(y)
    if not inside(S):
        return None
    Z = inverse_of(roots(S))
    image = program.adjoint(Z)
    fit = float(np.linalg.norm(program.cost)) / max(float(np.linalg.norm(image)), np.finfo(float).tiny)
    least = 1e-3 * max(abs(float(program.cost @ y)), FLOOR) / program.degree
    mu = max(fit, least)
    return Iterate(y, S, tuple(mu * z for z in Z), True)


def _run(program: ConeProgram, run: Run, tolerance: float, max_iterations: int, stop: Stop | None) -> Run:
    """Return where the iterations of a run that has only begun end."""
    merits = [np.inf]
    for count in range(max_iterations + 1):
        seen = _view(program, run.at)
        run = _remembered(run, seen, count)
        merits.append(max(seen.gap, seen.residual))
        if stop is not None and run.at.exact and stop(run.at.y):
            return replace(run, status="stopped", best=run.at, gap=seen.gap, residual=seen.residual)
        status = _verdict(run.at, seen, merits, tolerance)
        if status:
            return replace(run, status=status)
        if count == max_iterations:
            break
        try:
            at, step = advance(program, run.at)
        except np.linalg.LinAlgError:
            return replace(run, status="stalled")
        if step < SHORT:
            return replace(run, status="stalled")
        run = replace(run, at=at)
    return run


def _view(program: ConeProgram, at: Iterate) -> View:
    objective, constant, image = float(program.cost @ at.y), inner(program.constants, at.X), program.adjoint(at.X)
    size = max(abs(objective), abs(constant), FLOOR)
    return View(max(inner(at.X, at.S), abs(objective + constant)) / size, float(np.max(np.abs(image - program.cost))),
                bool(np.max(np.abs(image)) <= -RAY * constant))


def _remembered(run: Run, seen: View, count: int) -> Run:
    """Return the run with its memory of strictly feasible iterates brought up to date."""
    if run.at.exact and (run.best is None or seen.gap <= run.gap):
        run = replace(run, best=run.at, gap=seen.gap, residual=seen.residual)
    if run.at.exact and (run.deep is None or seen.gap >= run.depth):
        run = replace(run, deep=run.at)
    return replace(run, iterations=count)


def _verdict(at: Iterate, seen: View, merits: list[float], tolerance: float) -> str:
    """Return the status with which to end here, or "" to go on."""
    if at.exact and seen.gap <= tolerance and seen.residual <= RESIDUAL:
        return "optimal"
    if seen.infeasible and not at.exact:
        return "infeasible"
    old = min(merits[:-PATIENCE], default=np.inf)
    return "stalled" if len(merits) > 2 * PATIENCE and min(merits[-PATIENCE:]) > 0.9 * old else ""


def _second_chance(program: ConeProgram, run: Run, tolerance: float, max_iterations: int, stop: Stop | None) -> Run:
    """Return what comes of first looking for any feasible point, as if there was no cost, and then going on from it.

    The proof of infeasibility does not read the cost, but a cost without a minimum can keep a run from finding it.
    """
    free = replace(program, cost=np.zeros_like(program.cost))
    probe = _run(free, Run(_cold(free)), tolerance, max_iterations, lambda _: True)
    if probe.best is None:
        return replace(run, status=probe.status if probe.status == "infeasible" else run.status)
    return _run(program, Run(_warm(program, probe.best.y) or probe.best, run.depth), tolerance, max_iterations, stop)


def _solution(problem: Problem, program: ConeProgram, run: Run) -> Solution:
    """Return the run's end in the problem's own units, moved inside by a trifle when rounding in them costs the inside."""
    if run.best is None or run.deep is None:
        return Solution(run.at.y * program.unknowns, None, run.status, np.inf, run.iterations)
    best, deep = run.best.y * program.unknowns, run.deep.y * program.unknowns
    inner_point = deep if problem.violation(deep) < 0.0 else None
    X = tuple(size * block for size, block in zip(program.multipliers, run.best.X, strict=False))
    found = Solution(best, inner_point, run.status, run.gap, run.iterations, X, run.residual)
    for part in REPAIRS:
        y = best + part * (deep - best)
        if problem.violation(y) < 0.0:
            return replace(found, y=y)
    return replace(found, status="stalled" if run.status == "optimal" else run.status)
