"""A lower bound on the cost of every admissible linear controller of any order: its moves are affine in x_0, and tied."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from ..arrays import Array, number
from ..errors import InvalidInputError, SolverError
from ..plant import Plant, as_plant
from ..sets import Distribution
from ..sets.rules import whole
from ..spec import Spec
from .affine_bound import AffineMovesBound, seen_by_moves
from .affine_cuts import first_cuts, violated
from .affine_problem import AffineProgram, best_moves, extended, moment_root
from .bound import Bound
from .clock import Clock
from .exact_anchors import nearly_flat
from .lagrangian import NEARLY_FLAT, Lagrangian
from .measured import measured_rows
from .tied import hidden_states, ties_count
from .value_iteration import discrete, unlimited

_ROUNDS, _HALVED = 12, 3  # of adding violated constraints; of halving between a horizon and one too long to solve
_MOST_ROUNDING = 1e-6  # allowance for rounding, relative to the bound, beyond which other moves are tried as well
_LONGER = 2.0  # times that twice the moves take, at least
_TOLD_APART = 0.1  # weight of the anchors beside the distribution in what makes functions orthonormal


def affine_moves(plant: Any, spec: Spec, moves: int | None = None, *, relaxed: bool = False, time_varying: bool = False,
                 tolerance: float = 1e-7, most: int = 128, seconds: float | None = None) -> Bound:
    """Return a lower bound on the expected cost of every admissible linear controller of any finite order.

    With xi_{k+1} = A_c xi_k + B_c y_k, u_k = C_c xi_k + D_c y_k and a fixed xi_0, every move is affine in x_0:

        u_k = Y_k x_0 + d_k,   Y_k = sum_{j<=k} T_j C A^{k-j},   the same T_j for all k.

    Proof: y = y^0 + G u with y^0_k = C A^k x_0 and G strictly causal, and u = F y + what xi_0 adds, F causal; both are
    invariant in time. So u = T y^0 + d with T = (I - F G)^{-1} F, which exists and is causal and invariant too. Hence the
    bound

        min E sum_{k<N} beta^k (x_k'Q x_k + u_k'R u_k) + beta^N E x_N'Q x_N
        subject to H_u u_k(v) <= h_u for all initial states v that may occur (the vertices suffice), k < N,

    a convex quadratic program in (T_k, d_k) that needs only the mean and second moment of x_0 and its support. It is
    written in (Y_k, d_k), which the limits keep of moderate size however unstable the plant, with the ties
    Y_k - Y_{k-1} A = T_k C, free of powers of A (`tied.hidden_states`). With the full state measured they restrict nothing.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    spec : Spec; initial on a bounded set. Without input limits nothing is inadmissible and the bound is tr(P S0) of value
        iteration, moves + 1 steps or as many as it takes to settle, which every controller whatever obeys
    moves : N >= 1, more moves raise the bound; None doubles N from 1 until it has passed the number of states and the
        bound rises by less than the tolerance, and returns the best. `horizons` of the bound lists what was found on the way
    relaxed : let Y_k be any matrix, as with the full state measured: a bound no larger, in favour of the linear
        controllers (sec:general_certificate)
    time_varying : let the controller's matrices change with k, Y_k = Theta_k [C; CA; ...; CA^k] (by induction u_k is
        affine in y_0..y_k, whose linear parts have rows in the span of C, ..., CA^k): a larger class, a bound no larger
    tolerance : of the rise, relative to the bound; for moves = None
    most : the largest N tried; for moves = None
    seconds : after which no other horizon is begun, and a solve is ended as it is: a bound all the same, `cut_short`

    Returns
    -------
    Bound whose value is that of the Lagrangian at the solver's multipliers, minimized over moves that keep the limits
    at finitely many initial states: the solver need not be right. Of an ellipsoid, or a box or polytope of very many
    vertices, finitely many points count, and violated ones are added in up to 12 rounds. Should the solver do so badly
    that value iteration without limits proves more, the bound is that.

    Raises
    ------
    InvalidInputError : a Gaussian initial state with input limits, or states within rounding of a hyperplane but not on
        it; a continuous plant, moves or most < 1, tolerance or seconds < 0
    DimensionError : spec does not fit the plant
    SolverError : Clarabel is missing or fails to return numbers

    Notes
    -----
    Source: generalizes sec:general_certificate, which is N = 1, and the proof of thm:longrun_dyn. Any T of finite
    length is the response of some controller of finite order; so the gap to `best_dynamic_linear` may close. That the rise
    has stopped is no proof that a longer horizon adds nothing; every horizon's bound is valid. Where the initial states
    lie in a hyperplane the ties are left out, as if time_varying: the hidden part of Y_k is then out of the limits' reach.

    Examples
    --------
    >>> from inc_casadi import Box, Plant, Spec
    >>> plant = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
    >>> spec = Spec([[1, 0], [0, 1]], 0.05, 0.98, initial=Box([-0.8, -0.8], [0.8, 0.8]), inputs=Box(-1, 1))
    >>> bound = affine_moves(plant, spec, moves=3)
    >>> round(float(bound), 5), bound.holds(), bound.prove().succeeded
    (1.80115, True, True)
    >>> [(N, round(value, 5)) for N, value in affine_moves(plant, spec, most=8).horizons]
    [(1, 0.84652), (2, 1.3508), (4, 2.0271), (8, 2.11675)]
    >>> output = Plant(plant.A, plant.B, C=[[1, 0]])
    >>> [round(float(affine_moves(output, spec, 20, time_varying=varying)), 3) for varying in (False, True)]
    [5.917, 4.706]
    """
    begun, clock = perf_counter(), Clock.of(seconds)
    plant = discrete(as_plant(plant))
    spec.check(plant)
    N = None if moves is None else whole("moves", moves, 1)
    tolerance, most = number("tolerance", tolerance, 0.0), whole("most", most, 1)
    if spec.inputs is None:
        return unlimited(plant, spec, None if N is None else N + 1)
    if spec.initial.support is None:
        _refuse_unbounded(spec.initial)
    solve = partial(_fixed, plant, spec, relaxed=relaxed, tied=not time_varying, clock=clock)
    best = _rising(solve, plant.n, tolerance, most, clock) if N is None else solve(N)
    free = unlimited(plant, spec, None if N is None else N + 1)
    if not (best.value > free.value - 1e-6 * abs(free.value) and best.holds()):
        # The solver failed or had no time, or rounding took too much: what holds without limits holds with them.
        return replace(free, cut_short=best.cut_short)
    return replace(best, seconds=perf_counter() - begun)


def _rising(solve: Callable[[int], AffineMovesBound], n: int, tolerance: float, most: int,
            clock: Clock) -> AffineMovesBound:
    # Doubled horizons. The exact minima never fall, so one that does is beyond what the solver can do, and horizons
    # between it and the one before are tried. None is begun that surely takes longer than what is left.
    found, cut_short = [solve(1)], False
    while len(found[-1].moves) < most:
        cut_short = found[-1].cut_short or clock.left < _LONGER * found[-1].seconds or clock.is_over
        if cut_short:
            break
        N = min(2 * len(found[-1].moves), most)
        try:
            found.append(solve(N))
        except SolverError:
            break
        if not found[-1].value - found[-2].value > tolerance * abs(found[-1].value) and N > n:
            if found[-1].value < found[-2].value * (1 - tolerance):
                found += _between(solve, found[-2], found[-1], clock)
            break
    found.sort(key=lambda bound: len(bound.moves))
    best = max(found, key=lambda bound: bound.value)
    return replace(best, horizons=tuple((len(bound.moves), bound.value) for bound in found), cut_short=cut_short)


def _between(solve: Callable[[int], AffineMovesBound], best: AffineMovesBound,
             beyond: AffineMovesBound, clock: Clock) -> list[AffineMovesBound]:
    found, low, high = [], len(best.moves), len(beyond.moves)
    for _ in range(_HALVED):
        N = (low + high) // 2
        if N == low or clock.is_over:
            break
        found.append(solve(N))
        if found[-1].value > best.value:
            best, low = found[-1], N
        else:
            high = N
    return found


def _fixed(plant: Plant, spec: Spec, N: int, relaxed: bool, tied: bool, clock: Clock) -> AffineMovesBound:
    # The bound of N moves, untied when the initial states are so thin that rounding takes a tied one too much.
    found = _solved(plant, spec, N, relaxed, tied, clock)
    if found.ties is None or found.cut_short or found.dual()[1] < _MOST_ROUNDING * abs(found.value):
        return found
    return max(found, _solved(plant, spec, N, relaxed, False, clock), key=lambda bound: bound.value)


def _solved(plant: Plant, spec: Spec, N: int, relaxed: bool, tied: bool, clock: Clock) -> AffineMovesBound:
    begun = perf_counter()
    judged = seen_by_moves(plant, relaxed)
    anchors, cuts = first_cuts(spec, N)
    tied = tied and ties_count(judged, anchors, N)
    if nearly_flat(judged, anchors, N):
        raise InvalidInputError(NEARLY_FLAT)
    program = _program(judged, spec, anchors, N, tied)
    U, multipliers, ties = best_moves(program, cuts, clock.left)
    for _ in range(_ROUNDS):
        more = violated(spec, U)
        if not more.move.size or clock.is_over:
            break
        cuts = cuts.joined(more)
        U, multipliers, ties = best_moves(program, cuts, clock.left)
    numbers = U, cuts, multipliers, anchors
    value, allowance = Lagrangian(judged, spec, *numbers, ties if tied else None).lower()
    seconds = perf_counter() - begun
    return AffineMovesBound(plant, spec, value - allowance, seconds, *numbers, relaxed, ties if tied else None,
                            ((N, value - allowance),), cut_short=clock.is_over)


def _program(judged: Plant, spec: Spec, anchors: Array, N: int, tied: bool) -> AffineProgram:
    # Tied moves use all functions of x_0, those of no variance included, which the anchors tell apart.
    root = moment_root(spec.initial)
    if not tied:
        return AffineProgram(judged, spec, root, measured_rows(judged, N), root, np.zeros((judged.n, 0)))
    spread = np.hstack([root, _TOLD_APART / np.sqrt(anchors.shape[1]) * extended(anchors)])
    everything = measured_rows(seen_by_moves(judged, True), N)
    return AffineProgram(judged, spec, root, everything, spread, hidden_states(judged).astype(float))


def _refuse_unbounded(initial: Distribution) -> None:
    try:
        initial.vertices  # noqa: B018  # points in a hyperplane have vertices, though no full-dimensional support
    except InvalidInputError as error:
        raise InvalidInputError(
            f"initial is a {type(initial).__name__}, which no bounded set carries: a move that is affine in x_0 and "
            "keeps the input limits from every x_0 would be constant, so the class of admissible linear controllers is "
            "void of feedback; use any_controller, or a distribution on a bounded set"
        ) from error
