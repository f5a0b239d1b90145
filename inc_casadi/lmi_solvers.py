"""Which solver gets a semidefinite program, and what happens when it gives up."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .errors import InvalidInputError, SolverError
from .lmi_problem import Problem, Solution

SOLVERS = ("auto", "interior point", "clarabel")
GOOD_GAP = 1e-6  # relative gap above which a solver has given up too early
GOOD_VIOLATION = 1e-6  # of the constraints, in a program of numbers near 1


@dataclass(frozen=True)
class Solvers:
    """A solver by name, or "auto": the one that suits the problem's size, and the other where that gives up.

    Clarabel factors a system with N (N + 1) / 2 rows for a block of size N, the interior-point method one with a row for
    each unknown. So the sector rung at size goes to the latter (by a hundred times at 10 states and 64 units), and a rung
    with more unknowns than the blocks have entries to the former, when it is installed.

    Raises InvalidInputError for another name.

    >>> Solvers("clarabel").name
    'clarabel'
    """

    name: str = "auto"

    def __post_init__(self) -> None:
        if self.name not in SOLVERS:
            raise InvalidInputError(f"solver is {self.name!r}, but must be one of {', '.join(map(repr, SOLVERS))}")

    def order(self, problem: Problem) -> tuple[str, ...]:
        """Return the solvers to ask, one after the other."""
        if self.name != "auto":
            return (self.name,)
        entries = sum(len(block.constant) * (len(block.constant) + 1) // 2 for block in problem.blocks)
        first, second = "interior point", "clarabel"
        return (first, second) if problem.size <= entries or not _clarabel_is_there() else (second, first)

    def ends_inside(self, problem: Problem) -> bool:
        """Whether the solver that is asked first ends strictly inside the constraints; Clarabel ends on their boundary."""
        return self.order(problem)[0] == "interior point"

    def solve(self, problem: Problem, tolerance: float = 1e-8) -> Solution:
        """Return the first answer to rely on, or the one that violates the constraints least.

        Raises SolverError when the only solver that is asked for is missing.
        """
        found: list[Solution] = []
        for solver in self.order(problem):
            try:
                found.append(_ask(solver, problem, tolerance))
            except SolverError:
                if not found:
                    raise
                break
            if found[-1].status == "infeasible" or _to_rely_on(found[-1], problem, max(GOOD_GAP, tolerance)):
                return found[-1]
        return min(found, key=lambda solution: problem.violation(solution.y) if np.all(np.isfinite(solution.y)) else np.inf)


def _to_rely_on(found: Solution, problem: Problem, gap: float) -> bool:
    """Whether a point is close to optimal and satisfies the constraints as well as it says: Clarabel's "optimal" may not."""
    return (found.status == "optimal" or found.gap <= gap) and problem.violation(found.y) <= GOOD_VIOLATION


def _ask(solver: str, problem: Problem, tolerance: float) -> Solution:
    from . import interior_point, lmi_clarabel
    if solver == "clarabel":
        return lmi_clarabel.solve(_without_box(problem))
    return interior_point.solve(problem, tolerance=tolerance)


def _without_box(problem: Problem) -> Problem:
    """Return the problem with its signs but without the wide bounds, by whose size Clarabel would measure its tolerance."""
    return replace(problem, lower=np.where(problem.lower < 0, -np.inf, problem.lower),
                   upper=np.where(problem.upper > 1.0, np.inf, problem.upper))


def _clarabel_is_there() -> bool:
    try:
        import clarabel  # noqa: F401
    except ImportError:
        return False
    return True
