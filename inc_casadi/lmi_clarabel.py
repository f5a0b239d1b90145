"""Clarabel on a semidefinite program in inequality form, without a modelling layer in between."""

from __future__ import annotations

from typing import Any

import numpy as np

from .arrays import Array
from .cone_program import ConeProgram, normalized
from .errors import SolverError
from .interior_point import without_search
from .lmi_problem import Problem, Solution
from .schur import Coefficients

BATCH = 2**22  # numbers in one dense batch of coefficient columns
STATUS = {"Solved": "optimal", "PrimalInfeasible": "infeasible", "MaxIterations": "limit", "MaxTime": "limit"}


def solve(problem: Problem, *, tolerance: float = 1e-8) -> Solution:
    """Return Clarabel's answer to the problem, in the words of `Solution`.

    Clarabel minimizes q'x subject to A x + s = b with s in a product of cones. A block S = constant + sum_e x_e A_e is
    the cone of svec(S): the upper triangle column by column, off-diagonal entries times sqrt 2, which keeps inner
    products. So b = svec(constant) and the columns of A are -svec(A_e). Unknowns and constraints are scaled to size one
    first. y may violate the constraints by rounding: its words are history, and whoever uses y measures it.

    Raises SolverError when Clarabel is missing.

    >>> from inc_casadi.lmi_problem import Block, Term
    >>> cone = Block(np.array([[0.0, 1.0], [1.0, 0.0]]), (Term(np.array([[0, -1], [-1, 1]]), np.eye(2), np.eye(2)),))
    >>> free = np.full(2, np.inf)
    >>> found = solve(Problem(np.array([1.0, 4.0]), (cone,), np.zeros((0, 2)), np.zeros(0), -free, free))
    >>> found.status, np.round(found.y, 2).tolist()
    ('optimal', [2.0, 0.5])
    """
    clarabel = _clarabel()
    from scipy.sparse import csc_matrix

    program = normalized(problem)
    if not program.degree or not problem.size:
        return without_search(problem)
    A, b, cones = _data(program, clarabel)
    no_squares = csc_matrix((problem.size, problem.size))
    answer = clarabel.DefaultSolver(no_squares, program.cost, A, b, cones, _settings(clarabel, tolerance)).solve()
    y = program.unknowns * np.asarray(answer.x, dtype=float)
    high, low = float(answer.obj_val), float(answer.obj_val_dual)
    gap = abs(high - low) / max(1.0, min(abs(high), abs(low))) if np.isfinite(high - low) else np.inf
    return Solution(y, None, STATUS.get(str(answer.status), "stalled"), gap, int(answer.iterations))


def _clarabel() -> Any:
    try:
        import clarabel
    except ImportError as error:
        raise SolverError("Clarabel is not installed; `pip install clarabel` provides it") from error
    return clarabel


def _settings(clarabel: Any, tolerance: float) -> Any:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    return settings


def _data(program: ConeProgram, clarabel: Any) -> tuple[Any, Array, list[Any]]:
    """Return A (k, v), b (k,) and the cones, linear constraints first; blocks of size 0 are left out."""
    from scipy.sparse import coo_array, csc_matrix, csr_array, vstack

    kept = [(part, C) for part, C in zip(program.parts, program.constants, strict=False) if len(C)]
    bounds = coo_array((program.sign, (np.arange(program.sign.size), program.bounded)),
                       shape=(program.sign.size, program.cost.size))
    stack = vstack([csr_array(program.rows), bounds, *(svec_columns(part) for part, _ in kept)])
    b = np.concatenate([program.constants[-1], *(svec(C) for _, C in kept)])
    linear = [clarabel.NonnegativeConeT(len(program.constants[-1]))] if len(program.constants[-1]) else []
    return csc_matrix(-stack), b, linear + [clarabel.PSDTriangleConeT(len(C)) for _, C in kept]


def svec(S: Array) -> Array:
    """Return the upper triangle of a symmetric S (N, N) column by column, off-diagonal entries times sqrt 2.

    >>> np.round(svec(np.array([[1.0, 2.0], [2.0, 3.0]])), 3).tolist()
    [1.0, 2.828, 3.0]
    """
    column, row = np.tril_indices(len(S))
    return S[row, column] * np.where(row == column, 1.0, np.sqrt(2.0))


def svec_columns(A: Coefficients) -> Any:
    """Return the sparse matrix (N (N + 1) / 2, v) whose columns are svec(A_e).

    The pairs' products (u_a u_b' + u_b u_a') / 2 are formed batch by batch, and then added up with the weights E.
    """
    from scipy.sparse import csr_array, hstack

    column, row = np.tril_indices(len(A.columns))
    scale, U = np.where(row == column, 0.5, np.sqrt(0.5)), A.columns
    width, batches = max(1, BATCH // max(row.size, 1)), [csr_array((row.size, 0))]
    for start in range(0, A.a.size, width):
        a, b = U[:, A.a[start: start + width]], U[:, A.b[start: start + width]]
        batches.append(csr_array(scale[:, None] * (a[row] * b[column] + b[row] * a[column])))
    return hstack(batches) @ csr_array(A.weights.T)
