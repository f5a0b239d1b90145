"""The convex quadratic program over responses to innovations, solved by Clarabel; what it finds is judged elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import InfeasibleError, InvalidInputError, SolverError
from ..sets.farthest import farthest
from ..spec import Spec
from .lyapunov import discounted_sum
from .youla import Motions, Observed

_ROUNDS, _LISTED, _LONGEST = 30, 4000, 600


@dataclass(frozen=True, eq=False)
class Cut:
    """One constraint in each column: facets of u_step at initial states points (n, c)."""

    step: np.ndarray
    facet: np.ndarray
    points: Array


def best_responses(observed: Observed, spec: Spec, room: float) -> Array:
    """Return the unknowns (Q_j, c_j) of `Observed` of least expected cost whose inputs keep 1 - room of their limits.

    min E sum_{k<T} beta^k (x_k'Q x_k + u_k'R u_k) + beta^T E z_T'P z_T, z = (xhat, x - xhat), P the cost of u = K xhat,
    T = N + n, from when on that is the law: the innovations are over, for the observer is deadbeat. Subject to
    H_u u_k(v) <= h_u at initial states v: at first those listed and k < T, then the most violated ones in each further
    round, over a time in which the motion under K settles.

    Raises
    ------
    InfeasibleError : the program has no admissible point
    SolverError : Clarabel is missing or returns no numbers
    """
    motions = observed.motions(_horizon(observed))
    rows, fixed = _residuals(observed, spec, motions)
    widths = np.linalg.norm(rows, axis=0)
    widths = np.where(widths > 1e-12 * np.max(widths, initial=1e-300), widths, np.inf)
    rows = rows / widths
    if spec.inputs is None:
        return np.asarray(np.linalg.lstsq(rows, -fixed, rcond=1e-12)[0]) / widths
    hessian, linear = rows.T @ rows, rows.T @ fixed
    hessian += 1e-13 * np.trace(hessian) / len(hessian) * np.eye(len(hessian))
    cuts = _first_cuts(observed, spec)
    h = spec.inputs.h - room * np.abs(spec.inputs.h)
    unknowns = np.zeros(len(hessian))
    for _ in range(_ROUNDS):
        G, g = _constraints(spec, motions, cuts, h)
        unknowns = _solved(hessian, linear, G / widths, g) / widths
        more = _violated(spec, motions, unknowns, spec.inputs.h - room / 2 * np.abs(spec.inputs.h))
        if not more.step.size:
            break
        cuts = Cut(*(np.concatenate(pair, axis=-1) for pair in
                     ((cuts.step, more.step), (cuts.facet, more.facet), (cuts.points, more.points))))
    return unknowns


def _horizon(observed: Observed) -> int:
    M, steps = observed.plant.A + observed.plant.B @ observed.K, 1
    while np.linalg.norm(M) > 1e-4 and steps < _LONGEST:
        M, steps = M @ (observed.plant.A + observed.plant.B @ observed.K), steps + 1
    return observed.moves + observed.plant.n + steps


def _residuals(observed: Observed, spec: Spec, motions: Motions) -> tuple[Array, Array]:
    # rows (r, unknowns) and fixed (r,) such that the expected cost is |rows unknowns + fixed|^2.
    n = observed.plant.n
    T = observed.moves + n
    L, powers = _moment_root(spec), np.sqrt(spec.discount) ** np.arange(T + 1)
    q, r, tail = _root(spec.Q), _root(spec.R), _root(_tail(observed, spec))
    states, unknowns = motions.estimate + motions.errors, motions.estimate_response.shape[-1]
    fixed = [np.einsum("k,ij,kjs->kis", powers[:T], q, states[:T] @ L),
             np.einsum("k,ij,kjs->kis", powers[:T], r, motions.inputs[:T] @ L),
             powers[T] * tail @ np.vstack([motions.estimate[T], motions.errors[T]]) @ L]
    rows = [np.einsum("k,ij,kjsu,st->kitu", powers[:T], q, motions.estimate_response[:T], L, optimize=True),
            np.einsum("k,ij,kjsu,st->kitu", powers[:T], r, motions.input_response[:T], L, optimize=True),
            np.einsum("ij,jsu,st->itu", powers[T] * tail[:, :n], motions.estimate_response[T], L, optimize=True)]
    return np.concatenate([part.reshape(-1, unknowns) for part in rows]), np.concatenate([part.ravel() for part in fixed])


def _tail(observed: Observed, spec: Spec) -> Array:
    A, C, K, L, n = observed.plant.A, observed.plant.C, observed.K, observed.L, observed.plant.n
    loop = np.block([[A + observed.plant.B @ K, L @ C], [np.zeros((n, n)), A - L @ C]])
    x, u = np.hstack([np.eye(n), np.eye(n)]), np.hstack([K, np.zeros_like(K)])
    P = discounted_sum(loop, x.T @ spec.Q @ x + u.T @ spec.R @ u, spec.discount)
    if P is None:
        raise InfeasibleError("the output does not show an unstable mode, so no output feedback can stabilize it: "
                              "measure more")
    return P


def _moment_root(spec: Spec) -> Array:
    # L (n + 1, n + 1) with L L' = E [x_0; 1][x_0; 1]'.
    T, mean = _root(spec.initial.covariance), spec.initial.mean[:, None]
    return np.block([[T, mean], [np.zeros((1, len(T))), np.ones((1, 1))]])


def _root(M: Array) -> Array:
    eigenvalues, V = np.linalg.eigh(M)
    return (V * np.sqrt(np.maximum(eigenvalues, 0.0))) @ V.T


def _first_cuts(observed: Observed, spec: Spec) -> Cut:
    assert spec.inputs is not None
    steps, facets = observed.moves + observed.plant.n, len(spec.inputs.h)
    axes = np.eye(spec.n)
    points = farthest(spec.initial, np.hstack([axes, -axes]))
    try:
        vertices = spec.initial.vertices
    except InvalidInputError:  # an ellipsoid, or a box of too many vertices
        vertices = points
    if vertices.shape[1] * steps * facets <= _LISTED:
        points = vertices
    step, facet, point = np.meshgrid(np.arange(steps), np.arange(facets), np.arange(points.shape[1]), indexing="ij")
    return Cut(step.ravel(), facet.ravel(), points[:, point.ravel()])


def _constraints(spec: Spec, motions: Motions, cuts: Cut, h: Array) -> tuple[Array, Array]:
    assert spec.inputs is not None
    H, at = spec.inputs.H[cuts.facet], np.vstack([cuts.points, np.ones((1, cuts.step.size))])
    G = np.einsum("ca,casu,sc->cu", H, motions.input_response[cuts.step], at, optimize=True)
    return G, h[cuts.facet] - np.einsum("ca,cas,sc->c", H, motions.inputs[cuts.step], at, optimize=True)


def _violated(spec: Spec, motions: Motions, unknowns: Array, h: Array) -> Cut:
    # For every step and facet the initial state that violates it most, if any does.
    assert spec.inputs is not None
    rows = (spec.inputs.H @ (motions.inputs + motions.input_response @ unknowns)).reshape(-1, spec.n + 1)
    points = farthest(spec.initial, rows[:, :-1].T)
    over = np.sum(rows[:, :-1] * points.T, axis=1) + rows[:, -1] > np.tile(h, len(motions.inputs))
    worse = np.flatnonzero(over)
    return Cut(worse // len(h), worse % len(h), points[:, worse])


def _solved(hessian: Array, linear: Array, G: Array, g: Array) -> Array:
    try:
        import clarabel
        from scipy import sparse
    except ImportError as error:
        raise SolverError("the search for linear controllers needs scipy and clarabel: pip install clarabel") from error
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    scale = float(np.max(np.abs(np.append(linear, np.diag(hessian))))) or 1.0
    sizes = np.maximum(np.max(np.abs(G), axis=1), np.abs(g))
    sizes = np.where(sizes > 0, sizes, 1.0)
    upper = sparse.triu(sparse.csc_matrix(hessian / scale)).tocsc()
    rows = sparse.csc_matrix(G / sizes[:, None])
    cones = [clarabel.NonnegativeConeT(len(g))]
    found = clarabel.DefaultSolver(upper, linear / scale, rows, g / sizes, cones, settings).solve()
    if "Infeasible" in str(found.status):
        raise InfeasibleError("no linear controller of this form keeps the input limits from every initial state")
    unknowns = np.array(found.x)
    if not np.all(np.isfinite(unknowns)):
        raise SolverError(f"Clarabel ended with status {found.status} and without finite numbers")
    return unknowns
