"""By how much the initial set may grow under a controller, where that is quickly said."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.plants import Case
from inc_casadi import INC, Box, Polytope, Regional, Uniform, largest_scale
from inc_casadi.arrays import Array
from inc_casadi.pieces.walk import Budget

TOLERANCE, PIECES = 1e-2, 20_000
STEPS, GROWN, EXCESS, NEARER = 5_000, 1e3, 1e-9, 1e-6


def growth(case: Case, controller: Any, seconds: float, seed: int = 0) -> tuple[float | None, float | None]:
    """Return (factor, refuted) of `largest_scale` for a static law that is certified from the set itself.

    It is certified up to `factor`, so from 1 on, and from the set grown by `refuted` a motion breaks an input limit or does
    not come to rest. That motion is followed here once more and for longer: one that is only slow refutes nothing.

    Parameters
    ----------
    case : its initial states must be uniform over a box or polytope
    seconds : for each of some six certificates

    Returns
    -------
    Two factors; None where nothing is known. factor = 256 says that the search went no farther.

    Raises
    ------
    INCError : exact pieces do not apply to this law

    >>> from benchmarks.plants import scalar
    >>> factor, refuted = growth(scalar(), INC.saturated([[-1.5]], 1.0), 1.0)
    >>> bool(1.95 < factor < 2.0 <= refuted < 2.05)
    True
    """
    plant, spec = case.plant, case.spec
    if not isinstance(controller, INC) or not plant.discrete or not isinstance(spec.initial, Uniform):
        return None, None
    if not isinstance(spec.initial.support, Box | Polytope):
        return None, None
    claim = Regional(spec.initial, spec.inputs, spec.Q, spec.R, spec.discount)
    found = largest_scale(plant, controller, claim, tolerance=TOLERANCE, budget=Budget(PIECES, seconds=seconds), seed=seed)
    refuted = found.witness is not None and found.refuted > 1 and fails(case, controller, found.witness)
    return max(1.0, float(found.factor)), float(found.refuted) if refuted else None


def fails(case: Case, inc: INC, x: Array) -> bool:
    """Return whether the motion from x (n,) breaks an input limit, grows a thousandfold, or does not come to rest.

    It rests where the motion from the center of the initial set does; one that still comes nearer to that is only slow.

    >>> from benchmarks.plants import scalar
    >>> law = INC.saturated([[-1.5]], 1.0)
    >>> [fails(scalar(), law, np.array([start])) for start in (1.99, 2.0, 2.01)]
    [False, True, True]
    """
    plant, limits = case.plant, case.spec.inputs
    both = np.column_stack([x, case.spec.initial.mean])
    large, halfway = GROWN * max(float(np.max(np.abs(x))), 1.0), 0.0
    for step in range(STEPS):
        u = inc(plant.C @ both)
        if limits is not None and np.any(limits.H @ u[:, 0] > limits.h * (1 + EXCESS) + EXCESS):
            return True
        both = plant.A @ both + plant.B @ u
        if not np.max(np.abs(both)) <= large:
            return True
        if step == STEPS // 2:
            halfway = _apart(both)
    return _apart(both) > max((1 - NEARER) * halfway, NEARER)


def _apart(both: Array) -> float:
    return float(np.max(np.abs(both[:, 0] - both[:, 1])))
