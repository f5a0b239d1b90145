"""The search of training by collocation: IPOPT on the collocated form, kinks rounded less and less."""

from __future__ import annotations

from typing import Any

import numpy as np

from inc_casadi.arrays import Array

from .ball import project_rows
from .collocation import Collocated
from .flow import Path, follow, gain_control, law_control
from .ipopt import Stop, Watch, options, run
from .outcome import Outcome, Progress, Track
from .rollout import Parameters, Scenario, hidden

LEVELS = (0.1, 0.01, 0.001)
_POOR = 4.0  # a start this many times above the cost scale is left for the motion of a given gain
_BARRIER, _WARM = 1e-2, 1e-4  # IPOPT's first barrier parameter, from a start and from the level before
_MUMPS = {"ipopt.mumps_permuting_scaling": 0, "ipopt.mumps_pivot_order": 5}  # as in the lifted form


def minimize_collocated(form: Collocated, start: Parameters, *, gain: Array, watched: Scenario | None = None,
                        levels: tuple[float, ...] = LEVELS, max_iterations: int = 60, time_limit: float | None = None,
                        progress: Progress | None = None) -> Outcome:
    """Return the best law that IPOPT meets on the collocated form, with exact Hessians.

    The kinks are rounded over each of `levels` in turn, every solve starting at the variables and multipliers of the one
    before. Each iterate's law is followed as it is (`flow.follow`), without rounding and with its input clipped: the costs
    of the history are of these motions, and so is the choice of the best; the start is one of the laws to choose from.

    Parameters
    ----------
    form : the NLP
    start : where the law begins, along its own motion, or, when that is poor, along that of u = clip(gain x)
    gain : (m, n)
    watched : the scenario of these motions, on the same grid; with more nodes than the form's, a law that serves the form's
        nodes alone is not chosen. By default the form's
    levels : falling widths
    max_iterations : of all levels together
    time_limit : seconds, looked at between steps
    progress : called with (iteration, cost, seconds)
    """
    track = Track(progress, np.inf if time_limit is None else time_limit)
    watched = form.scenario if watched is None else watched
    x = form.layout.start(start)
    law = form.layout.parameters(x)
    path = _begin(form, law, gain)
    if not (np.all(np.isfinite(path.x)) and np.all(np.isfinite(path.eta))):
        return track.outcome(start, "failed: the start and its gain lose the state")
    point: dict[str, Any] = {"x0": form.point(x, law, path, _at_rest(form, law))}
    status, spent = "nothing searched", 0
    for level in levels:
        before, left = len(track.history), max_iterations - spent
        if left <= 0 or track.late or status == "interrupted":
            break
        share = left if level == levels[-1] else min(left, -(-max_iterations // len(levels)))
        status, found = _solve(form, watched, level, point, share, track)
        if found is None:
            break
        point = {"x0": found["x"], "lam_x0": found["lam_x"], "lam_g0": found["lam_g"]}
        spent += len(track.history) - before - 1
    return track.outcome(start, status)


def _solve(form: Collocated, watched: Scenario, level: float, point: dict[str, Any], iterations: int,
           track: Track) -> tuple[str, dict[str, Any] | None]:
    problem, stop = form.problem(level), Stop()
    x, f, g = problem.expressions()
    late = False

    def seen(variables: Array, value: float) -> None:
        nonlocal late
        law = _admissible(form, variables)
        track.note(law, follow(watched, law_control(watched, law), form.step, form.points.c).cost)
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


def _admissible(form: Collocated, variables: Array) -> Parameters:
    """Return the law of an iterate, which may still break the bound on the rows of W, with W projected within it."""
    law = form.layout.parameters(variables[:form.layout.size])
    return law._replace(W=project_rows(law.W, form.layout.kappa)) if form.layout.rows.size else law


def _begin(form: Collocated, law: Parameters, gain: Array) -> Path:
    scenario = form.scenario
    own = follow(scenario, law_control(scenario, law), form.step, form.points.c)
    if own.cost <= _POOR * form.scale:
        return own
    return follow(scenario, gain_control(scenario, law, gain), form.step, form.points.c)


def _at_rest(form: Collocated, law: Parameters) -> Array:
    return hidden(form.scenario, law.W, law.b[None], np.zeros((1, form.scenario.q)))[0][0]
