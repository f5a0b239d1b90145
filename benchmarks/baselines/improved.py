"""Improve an admissible static gain by a local search that sees the limits at later steps too."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

from inc_casadi import Box
from inc_casadi.arrays import Array
from inc_casadi.linear import LinearCost

from ..plants.paper import Case
from .kept import certified
from .linear import lyapunov_costs

WATCHED, ROUNDS, STEP = 30, 100, 1e-6
FAR = 1e6  # where a motion that grows is cut off
ROOM = 1e-5  # share of the limits that is left free, for a search that ends early may break them a little
MOST_ENTRIES = 40  # of a gain


def improved(case: Case, found: LinearCost) -> LinearCost:
    """Return a gain of less cost near an admissible one, certified too; or the one given, where none was found.

    min tr(P_F S0) over F (m, p) subject to H_u F C (A + B F C)^k x_0 <= h_u for k < 30 and all x_0 of the initial box, by
    SciPy's SLSQP with differences for the slopes, all of a round in one batch. Over a box with center c and half widths r
    the largest a'x_0 is a'c + |a|'r. Later steps are judged by `certified` alone.

    found : an admissible gain, with its cost

    >>> from ..plants import scalar
    >>> case = scalar(0.9, 0.05)
    >>> start = certified(case.plant, case.spec, np.array([[-0.8]]))
    >>> improved(case, start).controller.D_c.round(4).tolist()
    [[-1.0]]
    """
    box, F = case.spec.initial.support, found.controller.D_c
    if not isinstance(box, Box) or F.size > MOST_ENTRIES or case.spec.inputs is None:
        return found
    size = float(np.linalg.norm(F)) or 1.0

    def gains(v: Array) -> Array:
        return np.asarray((v * size).reshape(-1, *F.shape))

    def costs(v: Array) -> Array:
        values = lyapunov_costs(case.plant, case.spec, gains(v)) / found.bound
        return np.where(np.isfinite(values), values, 1e3)

    def rooms(v: Array) -> Array:
        return 1 - ROOM - shares(case, box, gains(v))

    best = minimize(lambda v: float(costs(v)[0]), F.ravel() / size, jac=lambda v: _slopes(costs, v)[0], method="SLSQP",
                    constraints={"type": "ineq", "fun": lambda v: rooms(v)[0], "jac": lambda v: _slopes(rooms, v)},
                    options={"maxiter": ROUNDS, "ftol": 1e-9}).x
    better = certified(case.plant, case.spec, gains(best)[0]) if np.all(np.isfinite(best)) else None
    return better if better is not None and better.bound < found.bound else found


def shares(case: Case, box: Box, gains: Array) -> Array:
    """Return the largest share of each limit that u = F y takes at each step k < 30: (N, 30 f) for gains (N, m, p).

    >>> from ..plants import scalar
    >>> shares(scalar(0.9), Box(-1, 1), np.array([[[-1.0]]]))[0, :4].tolist()  # 1, then x = 0.5
    [1.0, 1.0, 0.5, 0.5]
    """
    plant, limits = case.plant, case.spec.inputs
    assert limits is not None
    G = gains @ plant.C
    closed, rows = plant.A + plant.B @ G, (limits.H / limits.h[:, None]) @ G
    center, half = (box.upper + box.lower) / 2, (box.upper - box.lower) / 2
    found = []
    for _ in range(WATCHED):
        found.append(rows @ center + np.abs(rows) @ half)
        rows = np.clip(rows @ closed, -FAR, FAR)
    return np.concatenate(found, axis=1)


def _slopes(function: Callable[[Array], Array], v: Array) -> Array:
    # Central differences (outputs, entries), all points in one call.
    steps = STEP * np.eye(v.size)
    ahead, behind = function(np.vstack([v + steps, v - steps])).reshape(2, v.size, -1)
    return np.asarray((ahead - behind).T / (2 * STEP))
