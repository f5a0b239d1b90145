"""A lower bound on the cost of every admissible linear controller of any order: its moves are affine in x_0."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import Any

from ..arrays import number
from ..errors import InvalidInputError, SolverError
from ..plant import Plant, as_plant
from ..sets import Distribution
from ..sets.rules import whole
from ..spec import Spec
from .affine_bound import AffineMovesBound, seen_by_moves
from .affine_cuts import first_cuts, violated
from .affine_problem import AffineProgram, best_moves, moment_root
from .bound import Bound
from .exact_anchors import nearly_flat
from .lagrangian import NEARLY_FLAT, Lagrangian
from .measured import measured_rows
from .value_iteration import discrete, unlimited

_ROUNDS = 12  # of adding violated constraints


def affine_moves(plant: Any, spec: Spec, moves: int | None = None, *, relaxed: bool = False, tolerance: float = 1e-7,
                 most: int = 64) -> Bound:
    """Return a lower bound on the expected cost of every admissible linear controller of any finite order.

    With xi_{k+1} = A_c xi_k + B_c y_k, u_k = C_c xi_k + D_c y_k and a fixed xi_0, every move is affine in x_0:
    u_k = D_k x_0 + d_k, D_k = Theta_k [C; CA; ...; CA^k]. Proof: y_j = C A^j x_0 + sum_{i<j} C A^{j-1-i} B u_i, and
    u_k is affine in y_0..y_k with fixed coefficients. If the linear parts of u_0..u_{k-1} have rows in the span of
    C, ..., CA^{k-1}, then y_0..y_k have rows in the span of C, ..., CA^k, and so has u_k. Hence the bound

        min E sum_{k<N} beta^k (x_k'Q x_k + u_k'R u_k) + beta^N E x_N'Q x_N
        subject to H_u u_k(v) <= h_u for all initial states v that may occur (the vertices suffice), k < N,

    a convex quadratic program in (Theta_k, d_k) that needs only the mean and second moment of x_0 and its support.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    spec : Spec; initial on a bounded set. Without input limits nothing is inadmissible and the bound is tr(P S0) of value
        iteration, moves + 1 steps or as many as it takes to settle, which every controller whatever obeys
    moves : N >= 1, more moves raise the bound; None doubles N from 1 until it has passed the number of states and the
        bound rises by less than the tolerance, and returns the best. `horizons` of the bound lists what was found on the way
    relaxed : let D_k be any matrix, as with the full state measured: a bound no larger, in favour of the linear
        controllers (sec:general_certificate)
    tolerance : of the rise, relative to the bound; for moves = None
    most : the largest N tried; for moves = None

    Returns
    -------
    Bound whose value is that of the Lagrangian at the solver's multipliers, minimized over moves that keep the limits
    at finitely many initial states: the solver need not be right. Of an ellipsoid, or a box or polytope of very many
    vertices, finitely many points count, and violated ones are added in up to 12 rounds. Should the solver do so badly
    that value iteration without limits proves more, the bound is that.

    Raises
    ------
    InvalidInputError : a Gaussian initial state with input limits, or states within rounding of a hyperplane but not on
        it; a continuous plant, moves or most < 1, tolerance < 0
    DimensionError : spec does not fit the plant
    SolverError : Clarabel is missing or fails to return numbers

    Notes
    -----
    Source: generalizes sec:general_certificate, which is N = 1, and the proof of thm:longrun_dyn. A controller need not
    attain it: with an output measured, its moves are one sequence of gains on y, not one for each row of the stack. That
    the rise has stopped is no proof that a longer horizon adds nothing; every horizon's bound is valid.

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
    """
    begun = perf_counter()
    plant = discrete(as_plant(plant))
    spec.check(plant)
    N = None if moves is None else whole("moves", moves, 1)
    tolerance, most = number("tolerance", tolerance, 0.0), whole("most", most, 1)
    if spec.inputs is None:
        return unlimited(plant, spec, None if N is None else N + 1)
    if spec.initial.support is None:
        _refuse_unbounded(spec.initial)
    best = _rising(plant, spec, relaxed, tolerance, most) if N is None else _fixed(plant, spec, N, relaxed)
    free = unlimited(plant, spec, None if N is None else N + 1)
    if not (best.value > free.value - 1e-6 * abs(free.value) and best.holds()):
        return free  # the solver failed, or rounding took too much: what holds without limits holds with them
    return replace(best, seconds=perf_counter() - begun)


def _rising(plant: Plant, spec: Spec, relaxed: bool, tolerance: float, most: int) -> AffineMovesBound:
    # Doubled horizons. The exact minima never fall, so one that does is beyond what the solver can do.
    found = [_fixed(plant, spec, 1, relaxed)]
    while len(found[-1].moves) < most:
        N = min(2 * len(found[-1].moves), most)
        try:
            found.append(_fixed(plant, spec, N, relaxed))
        except SolverError:
            break
        if not found[-1].value - found[-2].value > tolerance * abs(found[-1].value) and N > plant.n:
            break
    best = max(found, key=lambda bound: bound.value)
    return replace(best, horizons=tuple((len(bound.moves), bound.value) for bound in found))


def _fixed(plant: Plant, spec: Spec, N: int, relaxed: bool) -> AffineMovesBound:
    # The bound of N moves.
    begun = perf_counter()
    judged = seen_by_moves(plant, relaxed)
    anchors, cuts = first_cuts(spec, N)
    if nearly_flat(judged, anchors, N):
        raise InvalidInputError(NEARLY_FLAT)
    program = AffineProgram(judged, spec, moment_root(spec.initial), measured_rows(judged, N))
    U, multipliers = best_moves(program, cuts)
    for _ in range(_ROUNDS):
        more = violated(spec, U)
        if not more.move.size:
            break
        cuts = cuts.joined(more)
        U, multipliers = best_moves(program, cuts)
    value, allowance = Lagrangian(judged, spec, U, cuts, multipliers, anchors).lower()
    seconds = perf_counter() - begun
    return AffineMovesBound(plant, spec, value - allowance, seconds, U, cuts, multipliers, anchors, relaxed,
                            ((N, value - allowance),))


def _refuse_unbounded(initial: Distribution) -> None:
    try:
        initial.vertices  # noqa: B018  # points in a hyperplane have vertices, though no full-dimensional support
    except InvalidInputError as error:
        raise InvalidInputError(
            f"initial is a {type(initial).__name__}, which no bounded set carries: a move that is affine in x_0 and "
            "keeps the input limits from every x_0 would be constant, so the class of admissible linear controllers is "
            "void of feedback; use any_controller, or a distribution on a bounded set"
        ) from error
