"""The best linear dynamic controller found: how far linear control can go."""

from __future__ import annotations

from inc_casadi.errors import InfeasibleError
from inc_casadi.linear import LinearController, LinearCost, best_dynamic_linear

from ..plants.paper import Case

MOVES, LISTED = 20, 4000  # moves to begin with; rows of the program, which adds others as they are violated
WORK, MORE_WORK = 3e8, 5e7  # rows times squared unknowns that take some seconds, and that a further attempt may take


def best_dynamic(case: Case, seed: int = 0) -> LinearController:
    """Return the controller of `best_dynamic_linear`, whose limits are certified to be kept at all times.

    20 moves are free, or as many as `work` allows; where no controller of this form keeps the limits, twice as many and
    again twice, as far as that is quick. Its cost is near the least of all linear controllers of any order.

    seed is not used: the program is convex

    Raises
    ------
    InfeasibleError : none was found

    >>> from ..plants import scalar
    >>> best_dynamic(scalar(0.9, 0.05)).order
    20
    """
    return affordable(case).controller


def affordable(case: Case) -> LinearCost:
    """Return the controller of `best_dynamic` with its certificate of cost and limits.

    Raises what `best_dynamic` raises.

    >>> from benchmarks.plants import two_state
    >>> round(affordable(two_state()).bound, 4)
    2.1168
    """
    moves = max(1, next((N for N in range(MOVES, 0, -1) if work(case, N) <= WORK), 1))
    while True:
        try:
            return best_dynamic_linear(case.plant, case.spec, moves)
        except InfeasibleError:
            moves *= 2
            if moves > 4 * MOVES or work(case, moves) > MORE_WORK:
                raise


def work(case: Case, moves: int) -> float:
    """Return rows times squared unknowns of the quadratic program with so many moves.

    Rows: facets of the limits times vertices of the initial box times moves, up to 4000; unknowns: a gain (m, p) and a
    constant (m,) for each move.

    >>> from ..plants import two_state
    >>> work(two_state(), 20)  # 160 rows, 60 unknowns
    576000.0
    """
    plant, limits = case.plant, case.spec.inputs
    facets = 0 if limits is None else len(limits.h)
    return float(min(LISTED, facets * 2**plant.n * moves) * (moves * plant.m * (plant.p + 1)) ** 2)
