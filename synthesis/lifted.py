"""Training in its lifted form: IPOPT on states, preactivations and inputs at once, kinks rounded less and less."""

from __future__ import annotations

from typing import Any

import numpy as np

from inc_casadi.arrays import Array

from .ipopt import Stop, Watch, options, run
from .lifted_stages import Lifted
from .objective import Objective
from .outcome import Outcome, Progress, Track
from .rollout import Motion, Parameters, Scenario, hidden, roll

LEVELS = (0.1, 0.01, 0.001)
_POOR = 4.0  # a start this many times above the cost scale is left for the motion of a given gain
_OUTSIDE = 100.0  # the worth of a law: its cost and this many times the cost scale at once the size of a set outside
_BARRIER, _WARM = 1e-2, 1e-4  # IPOPT's first barrier parameter, from a start and from the level before
# Scaling by a maximal matching makes MUMPS delay the pivots of the fixed points: some factorizations take 30 times longer.
_MUMPS = {"ipopt.mumps_permuting_scaling": 0, "ipopt.mumps_pivot_order": 5}


def minimize_lifted(objective: Objective, start: Parameters, *, readout: bool = True,
                    states: tuple[Array, Array] | None = None, gain: Array | None = None,
                    levels: tuple[float, ...] = LEVELS, max_iterations: int = 60, time_limit: float | None = None,
                    progress: Progress | None = None) -> Outcome:
    """Return the best law that IPOPT meets on the lifted form of an objective (see `Lifted`), with exact Hessians.

    The kinks are rounded over each of `levels` in turn, every solve starting at the variables and multipliers of the one
    before. Each iterate's law is rolled out as it is, without rounding and with its input clipped: the costs of the
    history are of these rollouts, and so is the choice of the best.

    Parameters
    ----------
    objective : scenario, layout and scale; its logarithm is not used
    start : where x, z and v begin, along its own motion, or, when that is poor, along that of u = clip(gain x):
        the equations need not hold at the start, so an unstable law is no obstacle
    readout : clip inputs within the law; else the limits are constraints at the nodes
    states : (G, g), hard constraints G x_k <= g for k >= 1
    gain : (m, n)
    levels : falling widths; one is enough where every unit is smooth and inputs are free
    max_iterations : of all levels together
    time_limit : seconds, looked at between steps
    progress : called with (iteration, cost, seconds)

    Notes
    -----
    One factorization takes of the order of S (q + m + n) P^2 operations, with P ~ q^2 entries of the law and S scenario
    stages: a form for q up to about 16.
    """
    form = Lifted(objective.scenario, objective.layout, objective.scale, readout, states)
    track = Track(progress, np.inf if time_limit is None else time_limit)
    x = objective.layout.start(start)
    begin = _begin(objective, objective.layout.parameters(x), gain)
    if not np.all(np.isfinite(begin.x)):
        return track.outcome(start, "failed: the start and its gain lose the state")
    point: dict[str, Any] = {"x0": form.point(x, objective.layout.parameters(x), begin)}
    status, spent = "nothing searched", 0
    for level in levels:
        before = len(track.history)
        left = max_iterations - spent
        share = left if level == levels[-1] else -(-max_iterations // len(levels))
        if left <= 0 or track.late or status == "interrupted":
            break
        status, found = _solve(form, level, point, min(share, left), track)
        if found is None:
            break
        point = {"x0": found["x"], "lam_x0": found["lam_x"], "lam_g0": found["lam_g"]}
        spent += len(track.history) - before - 1
    return track.outcome(start, status)


def _solve(form: Lifted, level: float, point: dict[str, Any], iterations: int,
           track: Track) -> tuple[str, dict[str, Any] | None]:
    problem, stop, bounds = form.problem(level), Stop(), form.bounds()
    x, f, g = problem.expressions()
    late = False

    def seen(variables: Array, value: float) -> None:
        nonlocal late
        law = form.layout.parameters(variables[:form.layout.size])
        motion = roll(form.scenario, law)
        track.note(law, motion.cost, motion.cost + _OUTSIDE * form.scale * outside(form, motion))
        late = track.late
        stop.requested = stop.requested or late

    warm = "lam_g0" in point
    chosen = options(iterations, None if np.isinf(track.limit) else track.limit - track.seconds) | _MUMPS | {
        "iteration_callback": Watch(problem.size, g.numel(), seen, stop), "ipopt.mu_init": _WARM if warm else _BARRIER,
        "ipopt.warm_start_init_point": "yes" if warm else "no", "ipopt.acceptable_constr_viol_tol": 1e-6,
        "grad_f": problem.gradient(), "jac_g": problem.jacobian(), "hess_lag": problem.hessian()}
    status, found = run({"x": x, "f": f, "g": g}, chosen, point | bounds, stop)
    if stop.failure is not None:
        raise stop.failure
    return ("time limit" if late else status), found


def outside(form: Lifted, motion: Motion) -> float:
    """Return how far a motion leaves H u <= h and, after its first state, G x <= g: a share of the larger of |g| and 1."""
    pairs = [(motion.u, form.scenario.H, form.scenario.h)]
    if form.states is not None:
        pairs.append((motion.x[1:], *form.states))
    shares = [(points @ rows.T - sides) / np.maximum(np.abs(sides), 1.0) for points, rows, sides in pairs]
    excess = max(float(np.max(share, initial=0.0)) for share in shares)
    return excess if np.isfinite(excess) else np.inf


def _begin(objective: Objective, law: Parameters, gain: Array | None) -> Motion:
    own = roll(objective.scenario, law)
    if gain is None or own.cost <= _POOR * objective.scale:
        return own
    return _along(objective.scenario, law, gain)


def _along(scenario: Scenario, law: Parameters, gain: Array) -> Motion:
    """Return the motion of u = clip(gain x), with the hidden units that the law has on its states."""
    x = np.empty((scenario.steps + 1, scenario.weights.size, scenario.A.shape[0]))
    x[0] = scenario.nodes.T
    for k in range(scenario.steps):
        u = np.clip(x[k] @ gain.T, scenario.lower, scenario.upper)
        x[k + 1] = x[k] @ scenario.A.T + u @ scenario.B.T
    v = np.clip(x[:-1] @ gain.T, scenario.lower, scenario.upper)
    r = (x[:-1] @ scenario.C.T @ law.U.T + law.b).reshape(-1, scenario.q)
    eta, slope = hidden(scenario, law.W, r, np.zeros_like(r))
    origin, origin_slope = hidden(scenario, law.W, law.b[None], np.zeros((1, scenario.q)))
    shape = (scenario.steps, scenario.weights.size, scenario.q)
    return Motion(x, v, v, eta.reshape(shape), slope.reshape(shape), origin[0], origin_slope[0], np.inf)
