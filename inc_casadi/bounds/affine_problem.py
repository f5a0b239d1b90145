"""The convex program over moves that are affine in the initial state, solved by Clarabel and trusted in nothing."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import SolverError
from ..plant import Plant
from ..sets import Distribution
from ..spec import Spec
from .measured import Rows
from .steadied import steadied
from .tying_rows import tying_rows, untangled


@dataclass(frozen=True, eq=False)
class Cuts:
    """Constraints H[facet] u_move(point) <= h[facet], one in each column: move, facet (c,) integers, point (n, c)."""

    move: np.ndarray
    facet: np.ndarray
    point: Array

    def joined(self, other: Cuts) -> Cuts:
        """Return both lists of constraints as one."""
        pairs = zip((self.move, self.facet, self.point), (other.move, other.facet, other.point), strict=True)
        return Cuts(*(np.concatenate(pair, axis=-1) for pair in pairs))


@dataclass(frozen=True, eq=False)
class AffineProgram:
    """min E cost over u_k = U_k [x_0; 1], U_k = [Y_k R_k, d_k], k < N, subject to cuts and ties.

    root : (n + 1, s) factor L with E [x_0; 1][x_0; 1]' >= L L', equal up to rounding
    rows : N row bases R_k that the moves may use
    spread : (n + 1, t >= s) L and more columns; functions of x_0 are made orthonormal on them
    hidden : Z (n, q), (Y_k R_k - Y_{k-1} R_{k-1} A) Z = 0; all rows are to be used then. Without columns: no ties
    """

    plant: Plant
    spec: Spec
    root: Array
    rows: list[Rows]
    spread: Array
    hidden: Array


def moment_root(initial: Distribution) -> Array:
    """Return L (n + 1, s) with L L' = E [x; 1][x; 1]'; directions of no variance are left out.

    >>> from inc_casadi import Box, Uniform
    >>> (moment_root(Uniform(Box(0.0, 2.0))) @ moment_root(Uniform(Box(0.0, 2.0))).T).round(6).tolist()
    [[1.333333, 1.0], [1.0, 1.0]]
    """
    spread = np.sqrt(np.diag(initial.covariance))
    scale = np.where(spread > 0, spread, 1.0)
    eigenvalues, V = np.linalg.eigh(initial.covariance / np.outer(scale, scale))
    kept = eigenvalues > 1e-12
    T = scale[:, None] * (V[:, kept] * np.sqrt(eigenvalues[kept]))
    below = np.zeros((1, T.shape[1]))
    return np.block([[T, initial.mean[:, None]], [below, np.ones((1, 1))]])


def extended(points: Array) -> Array:
    """Return [x; 1] for columns x.

    >>> extended(np.zeros((2, 1))).ravel().tolist()
    [0.0, 0.0, 1.0]
    """
    return np.vstack([points, np.ones((1, points.shape[1]))])


def measurement(rows: Rows) -> Array:
    """Return E (r + 1, n + 1) with E [x; 1] = [R x; 1].

    >>> measurement(Rows(np.array([[0.0, 1.0]]), 0.0)).tolist()
    [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    r, n = rows.basis.shape
    return np.block([[rows.basis, np.zeros((r, 1))], [np.zeros((1, n)), np.ones((1, 1))]])


def best_moves(program: AffineProgram, cuts: Cuts, seconds: float = inf) -> tuple[Array, Array, Array]:
    """Return U (N, m, n + 1), multipliers (c,) >= 0 of the cuts and (N, m, q) of the ties, as good as Clarabel finds them
    in so many seconds.

    The unknowns are X_k L for k = 1..N and the coefficients G_k of the moves on functions of x_0 that are orthonormal
    under its distribution, or on `spread`; inputs are scaled by their limits, the cost by the part that no move changes,
    and what is to come by the square root of its discount.

    Raises
    ------
    SolverError : Clarabel is missing or returns no numbers
    """
    features, damping = [_features(program, rows) for rows in program.rows], _damping(program)
    z, motions_and_ties, of_cuts = _solved(program, cuts, features, seconds)
    multipliers = np.empty(cuts.move.size)
    multipliers[np.argsort(cuts.move, kind="stable")] = of_cuts  # the rows are grouped by move
    of_ties = motions_and_ties[len(features) * program.plant.n * program.root.shape[1]:]
    of_ties = of_ties.reshape(len(features), program.plant.m, program.hidden.shape[1]) / _units(program)[:, None]
    ties = damping[:-1, None, None] * untangled(program.hidden, features[0][0], of_ties)
    return _moves(program, features, z), np.maximum(multipliers * damping[cuts.move], 0.0), ties


def _solved(program: AffineProgram, cuts: Cuts, features: list[tuple[Array, Array]],
            seconds: float) -> tuple[Array, Array, Array]:
    # The unknowns and the dual numbers of equalities and of inequalities, in the units of the cost.
    try:
        import clarabel
        from scipy import sparse
    except ImportError as error:
        raise SolverError("bounds on linear controllers need scipy and clarabel: pip install clarabel") from error
    hessian, G, g, equalities = _matrices(program, cuts, features, sparse)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    settings.time_limit = seconds
    cones = [clarabel.ZeroConeT(equalities), clarabel.NonnegativeConeT(len(g) - equalities)]
    found = clarabel.DefaultSolver(sparse.triu(hessian).tocsc(), np.zeros(G.shape[1]), G, g, cones, settings).solve()
    z, dual = np.array(found.x), _scale(program) * np.array(found.z)
    if not (np.all(np.isfinite(z)) and np.all(np.isfinite(dual))):
        raise SolverError(f"Clarabel ended with status {found.status} and without finite numbers")
    return z, dual[:equalities], dual[equalities:]


def _features(program: AffineProgram, rows: Rows) -> tuple[Array, Array]:
    # F (r, n + 1) with F [x_0; 1] orthonormal and spanning what the move may use, and F L.
    E = measurement(rows)
    seen = E @ program.spread
    sizes = np.linalg.norm(seen, axis=1)
    sizes = np.where(sizes > 0, sizes, 1.0)[:, None]
    left, values, Vt = np.linalg.svd(seen / sizes, full_matrices=False)
    kept = values > 1e-9 * values[0]
    return (left[:, kept] / values[kept]).T @ (E / sizes), Vt[kept, : program.root.shape[1]]


def _scale(program: AffineProgram) -> float:
    return float(np.sum(program.spec.Q * program.spec.initial.second_moment)) or 1.0


def _damping(program: AffineProgram) -> Array:
    # The factors (N + 1,) by which states and moves are scaled; far ahead they stay, not to underflow.
    return np.maximum(program.spec.discount ** (np.arange(len(program.rows) + 1) / 2), 1e-8)


def _units(program: AffineProgram) -> Array:
    assert program.spec.inputs is not None
    return np.max(np.abs(program.spec.inputs.vertices), axis=1)


def _matrices(program: AffineProgram, cuts: Cuts, features: list[tuple[Array, Array]],
              sparse: Any) -> tuple[Any, Any, Array, int]:
    # min z'(hessian)z / 2 subject to the first rows of G z = g, motions and ties, and the others G z <= g; row-major vec.
    plant, spec, units = program.plant, program.spec, _units(program)
    assert spec.inputs is not None
    N, s = len(features), program.root.shape[1]
    A, B = sparse.csr_array(plant.A), plant.B * units
    R, H = spec.R * np.outer(units, units), spec.inputs.H * units
    damping = _damping(program)
    weights = 2 * spec.discount ** np.arange(N + 1) / _scale(program) / damping**2
    blocks = [sparse.kron(weights[k + 1] * spec.Q, sparse.eye_array(s)) for k in range(N)]
    blocks += [sparse.kron(weights[k] * R, sparse.csr_array(np.round(FL @ FL.T, 14))) for k, (_, FL) in enumerate(features)]
    grid: list[list[Any]] = [[None] * (2 * N) for _ in range(2 * N)]
    right = [np.zeros(plant.n * s) for _ in range(N)]
    right[0] = damping[1] * (plant.A @ program.root[:-1]).ravel()
    for k, (F, FL) in enumerate(features):
        grid[k][k] = sparse.eye_array(plant.n * s)
        if k:
            grid[k][k - 1] = -damping[k + 1] / damping[k] * sparse.kron(A, sparse.eye_array(s))
        grid[k][N + k] = -damping[k + 1] / damping[k] * sparse.kron(sparse.coo_array(B), FL.T)
        mine = cuts.move == k
        values = (F @ extended(cuts.point[:, mine])).T
        rows = H[cuts.facet[mine]][:, :, None] * values[:, None, :]
        grid[N + k][N + k] = sparse.csr_array(rows.reshape(len(values), -1))
        right.append(damping[k] * spec.inputs.h[cuts.facet[mine]])
    ties = tying_rows(plant, program.hidden, features[0][0], damping, sparse)
    right[N:N] = [np.zeros(plant.m * program.hidden.shape[1]) for _ in ties]
    hessian, G = sparse.block_diag(blocks), sparse.block_array(grid[:N] + ties + grid[N:]).tocsc()
    return hessian, G, np.concatenate(right), N * (plant.n * s + plant.m * program.hidden.shape[1])


def _moves(program: AffineProgram, features: list[tuple[Array, Array]], z: Array) -> Array:
    plant, N = program.plant, len(features)
    sizes = [plant.m * len(F) for F, _ in features]
    parts = np.split(z[N * plant.n * program.root.shape[1]:], np.cumsum(sizes)[:-1])
    units, damping = _units(program)[:, None], _damping(program)
    triples = zip(parts, features, damping[:-1], strict=True)
    U = np.stack([units / scale * (part.reshape(plant.m, -1) @ F) for part, (F, _), scale in triples])
    motion = z[:N * plant.n * program.root.shape[1]].reshape(N, plant.n, -1) / damping[1:, None, None]
    return steadied(plant, program.spec, program.root, U, motion)
