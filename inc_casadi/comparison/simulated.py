"""What simulation adds to a row: evidence from seeded samples, never a certificate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import INCError
from ..estimate import Estimate, Law, estimate
from ..plant import Plant
from ..spec import Spec
from .effort import Effort
from .families import ANY
from .row import CERTIFIED, NO_LIMITS, NOTHING, OPEN, SEEN, SIMULATED, VIOLATED, Cost, Finding, Row

TOLERANCE = 1e-9  # of a limit, relative


def judge_callable(plant: Plant, spec: Spec, name: str, law: Law, effort: Effort) -> Row:
    """Return what simulation says of a law y -> u about which nothing else is known.

    >>> from inc_casadi import Box
    >>> spec = Spec(1.0, 0.0, 0.5, Box(-1, 1), Box(-1, 1))
    >>> row = judge_callable(Plant(1.5, 1.0), spec, "tanh", lambda y: -np.tanh(2 * y), Effort())
    >>> row.certified, row.limits.verdict, row.cost.how
    (False, 'seen in simulation', 'simulated')
    """
    return with_simulation(plant, spec, Row(name, law, "callable law", ANY), law, effort)


def with_simulation(plant: Plant, spec: Spec, row: Row, law: Law, effort: Effort) -> Row:
    """Return the row with what simulated motions say where nothing firmer is known."""
    if not plant.discrete:
        return replace(row, notes=(*row.notes, "simulation: the cost is a sum over steps, but the plant is continuous "
                                               "(dt = 0): use plant.sampled(dt)"))
    try:
        run = estimate(plant, law, spec, samples=effort.samples, seed=effort.seed)
    except INCError as error:
        return replace(row, notes=(*row.notes, f"simulation: {error}"))
    row = replace(row, limits=_limits(spec, row.limits, run), converges=_converges(row.converges, run))
    if row.cost.how != NOTHING:
        return row
    words = f"{run.samples} samples, seed {effort.seed}"
    return replace(row, cost=Cost(run.mean, SIMULATED, run.standard_error, words=words))


def _limits(spec: Spec, known: Finding, run: Estimate) -> Finding:
    if known.verdict in (CERTIFIED, VIOLATED):
        return known
    if spec.inputs is None:
        return NO_LIMITS
    if run.excess > TOLERANCE * max(1.0, float(np.max(np.abs(spec.inputs.h)))):
        return Finding(VIOLATED, f"an input limit is exceeded by {run.excess:.3g} in simulation")
    return Finding(SEEN, f"no limit exceeded by {run.samples} simulated motions")


def _converges(known: Finding, run: Estimate) -> Finding:
    if known.verdict in (CERTIFIED, VIOLATED):
        return known
    if not np.isfinite(run.mean):
        return Finding(VIOLATED, f"a simulated motion diverges within {run.steps} steps")
    if not run.settled:
        return Finding(OPEN, f"the simulated motions do not come to rest within {run.steps} steps")
    return Finding(SEEN, f"{run.samples} simulated motions come to rest")
