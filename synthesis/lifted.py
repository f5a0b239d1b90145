"""Training in its lifted form: IPOPT on states, preactivations and inputs at once, kinks rounded less and less."""

from __future__ import annotations

import numpy as np

from inc_casadi.arrays import Array

from .levels import LEVELS, POOR, by_levels
from .lifted_stages import Lifted
from .objective import Objective
from .outcome import Outcome, Progress, Track
from .rollout import Motion, Parameters, Scenario, hidden, roll

_OUTSIDE = 100.0  # the worth of a law: its cost and this many times the cost scale at once the size of a set outside


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

    def note(variables: Array) -> None:
        law = form.layout.parameters(variables[:form.layout.size])
        motion = roll(form.scenario, law)
        track.note(law, motion.cost, motion.cost + _OUTSIDE * form.scale * outside(form, motion))

    x0 = form.point(x, objective.layout.parameters(x), begin)
    return track.outcome(start, by_levels(form, levels, x0, max_iterations, track, note))


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
    if gain is None or own.cost <= POOR * objective.scale:
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
