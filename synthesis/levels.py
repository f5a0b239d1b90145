"""IPOPT on a stage-wise form whose kinks are rounded less and less: what the lifted and the collocated form share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from inc_casadi.arrays import Array

from .ipopt import Stop, Watch, options, run
from .outcome import Track
from .stagewise import Stagewise

LEVELS = (0.1, 0.01, 0.001)
POOR = 4.0  # a start this many times above the cost scale is left for the motion of a given gain
_BARRIER, _WARM = 1e-2, 1e-4  # IPOPT's first barrier parameter, from a start and from the level before
# Scaling by a maximal matching makes MUMPS delay the pivots of the fixed points: some factorizations take 30 times longer.
_MUMPS = {"ipopt.mumps_permuting_scaling": 0, "ipopt.mumps_pivot_order": 5}


class Form(Protocol):
    """An NLP for each width over which kinks are rounded, all with the same variables and bounds."""

    def problem(self, smoothing: float) -> Stagewise:
        """Return the NLP whose kinks are rounded over this width."""

    def bounds(self) -> dict[str, Array]:
        """Return the bounds of its variables and constraints, by IPOPT's names."""


def by_levels(form: Form, levels: tuple[float, ...], x0: Array, max_iterations: int, track: Track,
              note: Callable[[Array], None]) -> str:
    """Solve at each of falling widths from the variables and multipliers of the one before; return how the last one ended.

    note : called with the variables of each iterate; it tells the track what their law is worth
    """
    point: dict[str, Any] = {"x0": x0}
    status, spent = "nothing searched", 0
    for level in levels:
        before, left = len(track.history), max_iterations - spent
        if left <= 0 or track.late or status == "interrupted":
            break
        share = left if level == levels[-1] else min(left, -(-max_iterations // len(levels)))
        status, found = _solve(form, level, point, share, track, note)
        if found is None:
            break
        point = {"x0": found["x"], "lam_x0": found["lam_x"], "lam_g0": found["lam_g"]}
        spent += len(track.history) - before - 1
    return status


def _solve(form: Form, level: float, point: dict[str, Any], iterations: int, track: Track,
           note: Callable[[Array], None]) -> tuple[str, dict[str, Any] | None]:
    problem, stop = form.problem(level), Stop()
    x, f, g = problem.expressions()
    late = False

    def seen(variables: Array, value: float) -> None:
        nonlocal late
        note(variables)
        late = track.late
        stop.requested = stop.requested or late

    warm = "lam_g0" in point
    chosen = options(iterations, None if np.isinf(track.limit) else track.limit - track.seconds) | _MUMPS | {
        "iteration_callback": Watch(problem.size, g.numel(), seen, stop), "ipopt.mu_init": _WARM if warm else _BARRIER,
        "ipopt.warm_start_init_point": "yes" if warm else "no", "ipopt.acceptable_constr_viol_tol": 1e-6,
        "grad_f": problem.gradient(), "jac_g": problem.jacobian(), "hess_lag": problem.hessian()}
    status, found = run({"x": x, "f": f, "g": g}, chosen, point | form.bounds(), stop)
    if stop.failure is not None:
        raise stop.failure
    return ("time limit" if late else status), found
