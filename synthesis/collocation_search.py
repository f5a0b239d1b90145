"""The search of training by collocation: IPOPT on the collocated form, kinks rounded less and less."""

from __future__ import annotations

import numpy as np

from inc_casadi.arrays import Array

from .ball import project_rows
from .collocation import Collocated
from .flow import Path, follow, gain_control, law_control
from .levels import LEVELS, POOR, by_levels
from .outcome import Outcome, Progress, Track
from .rollout import Parameters, Scenario, hidden


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

    def note(variables: Array) -> None:
        law = _admissible(form, variables)
        track.note(law, follow(watched, law_control(watched, law), form.step, form.points.c).cost)

    x0 = form.point(x, law, path, _at_rest(form, law))
    return track.outcome(start, by_levels(form, levels, x0, max_iterations, track, note))


def _admissible(form: Collocated, variables: Array) -> Parameters:
    """Return the law of an iterate, which may still break the bound on the rows of W, with W projected within it."""
    law = form.layout.parameters(variables[:form.layout.size])
    return law._replace(W=project_rows(law.W, form.layout.kappa)) if form.layout.rows.size else law


def _begin(form: Collocated, law: Parameters, gain: Array) -> Path:
    scenario = form.scenario
    own = follow(scenario, law_control(scenario, law), form.step, form.points.c)
    if own.cost <= POOR * form.scale:
        return own
    return follow(scenario, gain_control(scenario, law, gain), form.step, form.points.c)


def _at_rest(form: Collocated, law: Parameters) -> Array:
    return hidden(form.scenario, law.W, law.b[None], np.zeros((1, form.scenario.q)))[0][0]
