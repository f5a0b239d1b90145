"""A linear gain clipped so seldom that what clipping adds to its cost is bounded move by move."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from inc_casadi.arrays import Array
from inc_casadi.inc import INC
from inc_casadi.linear.clipped_cost import clipped_cost
from inc_casadi.linear.kept_gain import best_kept_gain
from inc_casadi.linear.regulator import discounted_lqr
from inc_casadi.linear.static_gain import best_static_gain
from inc_casadi.plant import Plant, as_plant
from inc_casadi.sets import Box
from inc_casadi.spec import Spec

GRID = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0)
HALVINGS = 4  # of the step around the best of them


def seldom_clipped_gain(plant: Any, spec: Spec, seed: int = 0) -> Array:
    """Return F (m, p) of the cheapest bound found for u = clip((1 - t) F_kept y + t F_free y), 0 <= t <= 1.

    F_kept is the best gain found that keeps the limits at all times, F_free the best without limits. With t = 0 nothing is
    clipped and the cost is known; the more of F_free, the less the linear loop costs and the more clipping may add, until
    its bound no longer ends (`ClippedCost`). It takes about a second at any number of states.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    spec : Spec; limits that are no Box cannot be clipped to, and F_kept is returned, as where there are none
    seed : of the searches for gains

    Raises
    ------
    As `best_kept_gain`.

    >>> spec = Spec(Q=1.0, R=0.0, discount=0.5, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> F = seldom_clipped_gain(Plant(1.5, 1.0), spec)
    >>> -1.5 < F.item() < -1.05
    True
    """
    plant = as_plant(plant)
    kept = best_kept_gain(plant, spec, seed=seed).controller.D_c
    if not isinstance(spec.inputs, Box):
        return kept
    free = _free(plant, spec, seed)
    return kept + _best_share(plant, spec, spec.inputs, kept, free) * (free - kept)


def _best_share(plant: Plant, spec: Spec, limits: Box, kept: Array, free: Array) -> float:
    def bound(t: float) -> float:
        law = INC.linear(kept + t * (free - kept)).with_saturated_output(limits)
        found = clipped_cost(plant, spec, law)
        return found.bound if found.holds() else np.inf

    bounds = {t: bound(t) for t in GRID}
    best, step = min(bounds, key=lambda t: bounds[t]), 0.05
    for _ in range(HALVINGS):
        step /= 2
        bounds |= {t: bound(t) for t in (best - step, best + step) if 0 < t < 1 and t not in bounds}
        best = min(bounds, key=lambda t: bounds[t])
    return best if np.isfinite(bounds[best]) else 0.0


def _free(plant: Plant, spec: Spec, seed: int) -> Array:
    if plant.p == plant.n and np.linalg.matrix_rank(plant.C) == plant.n:
        return np.asarray(np.linalg.solve(plant.C.T, discounted_lqr(plant, spec)[0].T).T)
    return best_static_gain(plant, replace(spec, inputs=None), seed=seed).F
