"""One run of IPOPT through CasADi, ended when asked to, with its status in words; shared by the forms of training."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from inc_casadi.arrays import Array
from inc_casadi.errors import SolverError

try:
    import casadi as ca
except ImportError as error:
    raise SolverError("training needs CasADi with IPOPT: pip install casadi") from error

STATUS = {
    "Solve_Succeeded": "solved",
    "Solved_To_Acceptable_Level": "no more progress",
    "Search_Direction_Becomes_Too_Small": "no more progress",
    "Restoration_Failed": "no more progress",
    "Error_In_Step_Computation": "no more progress",
    "Maximum_Iterations_Exceeded": "iteration limit",
    "Maximum_WallTime_Exceeded": "time limit",
    "User_Requested_Stop": "interrupted",
}


@dataclass
class Stop:
    """Whether the search is to end, and why if by an error; shared by the callbacks of one solve."""

    requested: bool = False
    failure: BaseException | None = None

    @contextmanager
    def guard(self) -> Iterator[None]:
        """Turn what is raised inside into a request to stop: CasADi would print and forget it."""
        try:
            yield
        except KeyboardInterrupt:
            self.requested = True
        except BaseException as error:  # not swallowed: raised again when the solver has returned
            self.requested, self.failure = True, error


def run(problem: dict[str, Any], options: dict[str, Any], arguments: dict[str, Any],
        stop: Stop) -> tuple[str, dict[str, Any] | None]:
    """Return how the search ended, in words, and what the solver returned, None where it was cut off.

    problem: x, f, g; options: of `nlpsol`; arguments: start, bounds and multipliers. An error of a callback is not
    raised here but kept in `stop.failure`.
    """
    status, found = "interrupted", None
    try:
        solver = ca.nlpsol("training", "ipopt", problem, options)
        found = solver(**arguments)
        returned = solver.stats()["return_status"]
        status = STATUS.get(returned, f"failed: {returned}")
    except KeyboardInterrupt:
        stop.requested = True
    except RuntimeError as error:
        status = f"failed: {str(error).strip().splitlines()[-1]}"
    return ("interrupted" if stop.requested else status), found


def options(max_iterations: int, time_limit: float | None) -> dict[str, Any]:
    """Return options of `nlpsol` that every form shares."""
    chosen: dict[str, Any] = {
        "print_time": False, "show_eval_warnings": False, "calc_lam_p": False,
        "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.max_iter": max_iterations, "ipopt.tol": 1e-7,
        # At a kink the optimality conditions of a smooth NLP are never met: end where the objective stands still.
        "ipopt.acceptable_iter": 10, "ipopt.acceptable_obj_change_tol": 1e-6, "ipopt.acceptable_tol": 1e3,
        "ipopt.acceptable_dual_inf_tol": 1e3, "ipopt.acceptable_compl_inf_tol": 1e3,
    }
    if time_limit is not None:
        chosen["ipopt.max_wall_time"] = max(time_limit, 1e-3)
    return chosen


class Watch(ca.Callback):
    """Called by IPOPT after each step with its x (nx,) and its objective f; can end the search."""

    def __init__(self, size: int, rows: int, seen: Callable[[Array, float], None], stop: Stop) -> None:
        super().__init__()
        self._size, self._rows, self._seen, self._stop = size, rows, seen, stop
        self.construct("watch", {})

    def get_n_in(self) -> int:
        """Return the number of outputs of a solver, which are its inputs here."""
        return ca.nlpsol_n_out()

    def get_n_out(self) -> int:
        """Return 1."""
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Return the shape of one output of the solver."""
        shapes = {"f": (1, 1), "x": (self._size, 1), "lam_x": (self._size, 1), "lam_p": (0, 0)}
        return ca.Sparsity.dense(*shapes.get(ca.nlpsol_out(i), (self._rows, 1)))

    def eval(self, arguments: Sequence[ca.DM]) -> list[ca.DM]:
        """Pass the iterate on, and return whether the search is to end."""
        with self._stop.guard():
            if not self._stop.requested:
                self._seen(arguments[0].full().ravel(), float(arguments[1]))
        return [ca.DM(int(self._stop.requested))]


def nowhere(shape: tuple[int, int]) -> Array:
    """Return NaN of a shape: it tells IPOPT's line search to step back, and after an interruption ends the search.

    >>> nowhere((1, 2)).tolist()
    [[nan, nan]]
    """
    return np.full(shape, np.nan)
