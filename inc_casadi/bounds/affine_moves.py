"""A lower bound on the cost of every admissible linear controller of any order: its moves are affine in x_0."""

from __future__ import annotations

from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InvalidInputError
from ..figures import at_least
from ..plant import as_plant
from ..sets import Box, Distribution, Ellipsoid
from ..sets.farthest import farthest
from ..sets.rules import whole
from ..spec import Spec
from .affine_problem import AffineProgram, Cuts, best_moves, moment_root
from .bound import Bound
from .lagrangian import Lagrangian
from .measured import measured_rows
from .value_iteration import discrete, unlimited

_MOST_CUTS, _ROUNDS = 20_000, 12  # constraints listed at once; rounds of adding the violated ones otherwise


@dataclass(frozen=True, eq=False)
class AffineMovesBound(Bound):
    """The bound of `affine_moves`, with the trial moves and multipliers that prove it.

    Parameters
    ----------
    moves : U (N, m, n + 1), the tangent point u_k = U_k [x_0; 1]
    cuts : constraints H[facet] u_move(point) <= h[facet] at initial states that may occur, c of them
    multipliers : (c,) >= 0 of the cuts
    anchors : (n, a) initial states that may occur and span all that do
    """

    moves: Array = field(repr=False)
    cuts: Cuts = field(repr=False)
    multipliers: Array = field(repr=False)
    anchors: Array = field(repr=False)

    @property
    def statement(self) -> str:
        """One sentence for an engineer."""
        seen = "" if self.plant.full_state else " that measures y = C x"
        N = len(self.moves)
        judged = "its first move" if N == 1 else f"its first {N} moves"
        return (f"Every linear controller of any finite order{seen}, started from a fixed state and keeping the input "
                f"limits from every initial state, costs at least {at_least(self.value)} on average over the initial "
                f"states ({judged} counted).")

    def dual(self) -> tuple[float, float]:
        """Return the Lagrangian, minimized over all moves within the limits, and its rounding allowance."""
        return Lagrangian(self.plant, self.spec, self.moves, self.cuts, self.multipliers, self.anchors).lower()

    def holds(self) -> bool:
        """Return whether the stored numbers prove the value: NumPy only, no solver.

        The multipliers must be nonnegative, and the points of the cuts and the anchors initial states that may occur.
        """
        points = np.hstack([self.cuts.point, self.anchors])
        return bool(np.all(self.multipliers >= 0)) and _may_occur(self.spec.initial, points) and super().holds()


def affine_moves(plant: Any, spec: Spec, moves: int = 20) -> Bound:
    """Return a lower bound on the expected cost of every admissible linear controller of any finite order.

    With xi_{k+1} = A_c xi_k + B_c y_k, u_k = C_c xi_k + D_c y_k and a fixed xi_0, every move is affine in x_0:
    u_k = D_k x_0 + d_k, D_k = Theta_k [C; CA; ...; CA^k]. Proof: y_j = C A^j x_0 + sum_{i<j} C A^{j-1-i} B u_i, and
    u_k is affine in y_0..y_k with fixed coefficients. If the linear parts of u_0..u_{k-1} have rows in the span of
    C, ..., CA^{k-1}, then y_0..y_k have rows in the span of C, ..., CA^k, and so has u_k. Hence the bound

        min E sum_{k<N} beta^k (x_k'Q x_k + u_k'R u_k) + beta^N E x_N'Q x_N
        subject to H_u u_k(v) <= h_u for all initial states v that may occur (the vertices suffice), k < N,

    a convex quadratic program in (Theta_k, d_k) that needs only the mean and second moment of x_0.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    spec : Spec; initial on a bounded set. Without input limits nothing is inadmissible and the bound is tr(P S0) after
        moves + 1 steps of value iteration from zero, which every controller whatever obeys
    moves : N >= 1; more moves raise the bound

    Returns
    -------
    Bound whose value is that of the Lagrangian at the solver's multipliers, minimized over moves that keep the limits
    at finitely many initial states: the solver need not be right. Of an ellipsoid, or a box or polytope of very many
    vertices, finitely many points count, and violated ones are added in up to 12 rounds. Should the solver do so badly
    that value iteration without limits proves more, the bound is that.

    Raises
    ------
    InvalidInputError : a Gaussian initial state with input limits, a continuous plant, moves < 1
    DimensionError : spec does not fit the plant
    SolverError : Clarabel is missing or fails to return numbers

    Notes
    -----
    Source: generalizes sec:general_certificate, which is N = 1, and the proof of thm:longrun_dyn.

    Examples
    --------
    >>> from inc_casadi import Box, Plant, Spec
    >>> plant = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
    >>> spec = Spec([[1, 0], [0, 1]], 0.05, 0.98, initial=Box([-0.8, -0.8], [0.8, 0.8]), inputs=Box(-1, 1))
    >>> bound = affine_moves(plant, spec, moves=3)
    >>> round(float(bound), 5), bound.holds()
    (1.80115, True)
    """
    begun = perf_counter()
    plant = discrete(as_plant(plant))
    spec.check(plant)
    N = whole("moves", moves, 1)
    if spec.inputs is None:
        return unlimited(plant, spec, N + 1)
    if spec.initial.support is None:
        _refuse_unbounded(spec.initial)
    anchors, cuts = _start(spec, N)
    program = AffineProgram(plant, spec, moment_root(spec.initial), measured_rows(plant, N))
    U, multipliers = best_moves(program, cuts)
    for _ in range(_ROUNDS):
        more = _violated(spec, U, cuts)
        if not more.move.size:
            break
        cuts = cuts.joined(more)
        U, multipliers = best_moves(program, cuts)
    value, allowance = Lagrangian(plant, spec, U, cuts, multipliers, anchors).lower()
    free = unlimited(plant, spec, N + 1)
    if not value - allowance > free.value - 1e-6 * abs(free.value):
        return free  # the solver failed, or rounding took too much: what holds without limits holds with them
    return AffineMovesBound(plant, spec, value - allowance, perf_counter() - begun, U, cuts, multipliers, anchors)


def _refuse_unbounded(initial: Distribution) -> None:
    try:
        initial.vertices  # noqa: B018  # points in a hyperplane have vertices, though no full-dimensional support
    except InvalidInputError as error:
        raise InvalidInputError(
            f"initial is a {type(initial).__name__}, which no bounded set carries: a move that is affine in x_0 and "
            "keeps the input limits from every x_0 would be constant, so the class of admissible linear controllers is "
            "void of feedback; use any_controller, or a distribution on a bounded set"
        ) from error


def _start(spec: Spec, N: int) -> tuple[Array, Cuts]:
    # Anchors, and the constraints at all vertices when they can be listed, else at the anchors.
    assert spec.inputs is not None
    facets, support = len(spec.inputs.h), spec.initial.support
    if isinstance(support, Ellipsoid):
        eigenvalues, V = np.linalg.eigh(support.P)
        anchors = _star(support.center, V * np.sqrt(support.level / eigenvalues))
    elif isinstance(support, Box) and 2**support.dimension * facets * N > _MOST_CUTS:
        anchors = _star(support.center, np.diag((support.upper - support.lower) / 2))
    else:
        anchors = (spec.initial if support is None else support).vertices
    if anchors.shape[1] * facets * N > _MOST_CUTS:
        anchors = _spanning(anchors)
    points = anchors.shape[1]
    move, facet, point = np.meshgrid(np.arange(N), np.arange(facets), np.arange(points), indexing="ij")
    return anchors, Cuts(move.ravel(), facet.ravel(), anchors[:, point.ravel()])


def _star(center: Array, axes: Array) -> Array:
    return np.hstack([center[:, None] + axes, center[:, None] - axes])


def _spanning(points: Array) -> Array:
    # The farthest points along the axes and against them, and along random directions: few, and spanning the hull.
    n = len(points)
    directions = np.hstack([np.eye(n), -np.eye(n), np.random.default_rng(0).standard_normal((n, 2 * n))])
    scaled = points / np.maximum(np.ptp(points, axis=1, keepdims=True), np.finfo(float).tiny)
    return points[:, np.unique(np.argmax(directions.T @ scaled, axis=1))]


def _violated(spec: Spec, U: Array, cuts: Cuts) -> Cuts:
    # For every move and facet the initial state that violates it most, if any does.
    assert spec.inputs is not None
    H, h = spec.inputs.H, spec.inputs.h
    N, m, size = U.shape
    rows = (H @ U).reshape(-1, size)
    points = farthest(spec.initial, rows[:, :-1].T)
    excess = np.sum(rows[:, :-1] * points.T, axis=1) + rows[:, -1] - np.tile(h, N)
    worse = np.flatnonzero(excess > 1e-7 * np.tile(np.max(np.abs(H), axis=1) * np.max(np.abs(spec.inputs.vertices)), N))
    return Cuts(worse // len(h), worse % len(h), points[:, worse])


def _may_occur(initial: Distribution, points: Array) -> bool:
    support = initial.support
    if support is not None:
        size = float(np.max(np.abs(points)))
        return bool(np.all(support.contains(points, 1e-9 if isinstance(support, Ellipsoid) else 1e-9 * size)))
    return {tuple(point) for point in points.T} <= {tuple(point) for point in initial.vertices.T}
