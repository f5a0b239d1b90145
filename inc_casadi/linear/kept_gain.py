"""The best static gain found that keeps the input limits at all times, not only at the first move."""

from __future__ import annotations

import time
from math import inf
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import INCError, InfeasibleError, InvalidInputError
from ..plant import Plant, as_plant
from ..sets.farthest import farthest
from ..spec import Spec
from .controller import LinearController
from .gain_search import evaluate
from .linear_cost import LinearCost, linear_cost
from .regulator import damped_plant, discounted_lqr
from .static_gain import best_static_gain

WATCHED, FAR = 30, 300  # moves whose limits a search sees, and those that a gain is tried on before it is judged
ROUNDS, ROOMS = 100, (1e-6, 1e-4, 1e-2)  # of a search; shares of the limits that it leaves free
HALVINGS = 30
MOST_ENTRIES = 60  # of a gain that is searched for
MANY, FEW, USUAL = 2000, 2, 6  # vertices times facets, and how many starts a search has above that and below
LOST, LARGE = 1e3, 1e6  # of the cost, what an unstable gain counts; where a motion that grows is cut off


def best_kept_gain(plant: Any, spec: Spec, *, seed: int = 0, starts: int | None = None,
                   seconds: float | None = None) -> LinearCost:
    """Return the cheapest gain found of those that are proved to stabilize and to keep the input limits for ever.

    `best_static_gain` asks for the limits at k = 0 only. From its gain and the regulator's, each scaled down until they are
    kept, a sequential quadratic program (SciPy's SLSQP) lowers

        tr(P_F S0) over F (m, p) subject to H_u F C (A + B F C)^k x_0 <= h_u for k < 30 and every initial state x_0,

    with exact slopes: of the cost by Lyapunov equations, of each limit at the initial state that reaches farthest, which is
    an element of Clarke's gradient. Later moves are judged by `linear_cost` alone, which proves them.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    spec : Spec; with input limits 0 must be well inside them, and initial on a bounded set
    seed, starts : of `best_static_gain`; by default 6 starts, and 2 where vertices and facets multiply to many
    seconds : after which each of the searches ends with what it has

    Returns
    -------
    LinearCost that holds: an upper bound on the best gain's cost, which need not be global.

    Raises
    ------
    InfeasibleError : no gain was found that is proved to stabilize and to keep the limits
    NotStabilizableError, InvalidInputError, SolverError : as `best_static_gain`

    Examples
    --------
    >>> from inc_casadi import Box, Plant, Spec
    >>> scalar = Spec(Q=1.0, R=0.0, discount=0.5, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> best_kept_gain(Plant(1.5, 1.0), scalar).controller.D_c.round(5).tolist()
    [[-1.0]]
    """
    plant = as_plant(plant)
    if not plant.discrete:
        raise InvalidInputError("the moves are steps, but the plant is continuous (dt = 0): use plant.sampled(dt)")
    starts = _starts(plant, spec) if starts is None else starts
    first = best_static_gain(plant, spec, seed=seed, starts=starts, seconds=seconds)  # where there is none, this says why
    until = inf if seconds is None else time.monotonic() + seconds
    found = [one for one in (_judged(plant, spec, F) for F in _scaled(plant, spec, first.F)) if one is not None]
    if not found:
        raise InfeasibleError("no gain u = F y was found that is proved to stabilize the plant and to keep the input limits "
                              "at all times from every initial state: neither the best one at k = 0 nor the regulator's, "
                              "scaled down, does; that is evidence, not proof. Try a smaller initial set, or hidden units")
    best = min(found, key=lambda one: one.bound)
    if spec.inputs is None or best.bound <= first.cost * (1 + 1e-9):  # no gain kept at k = 0 is known that costs less
        return best
    return _improved(plant, spec, best, until)


def shares(plant: Plant, spec: Spec, F: Array, moves: int = WATCHED) -> Array:
    """Return the largest share of each limit that u = F y takes at each move k < moves: (moves, f), limits h > 0.

    >>> from inc_casadi import Box, Plant, Spec
    >>> spec = Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-1, 1))
    >>> shares(Plant(1.5, 1.0), spec, np.array([[-1.0]]), 3)[:, 0].tolist()
    [1.0, 0.5, 0.25]
    """
    rows = _rows(plant, spec, F, moves)
    flat = rows.reshape(-1, plant.n)
    return np.sum(flat * farthest(spec.initial, flat.T).T, axis=1).reshape(rows.shape[:2])


def _rows(plant: Plant, spec: Spec, F: Array, moves: int) -> Array:
    """H_u F C (A + B F C)^k, each row over its limit: (moves, f, n)."""
    assert spec.inputs is not None
    G = F @ plant.C
    closed, row = plant.A + plant.B @ G, (spec.inputs.H / spec.inputs.h[:, None]) @ G
    found = [row]
    for _ in range(moves - 1):
        found.append(np.clip(found[-1] @ closed, -LARGE, LARGE))
    return np.stack(found)


def _share_slopes(plant: Plant, spec: Spec, F: Array) -> Array:
    """The derivatives of `shares` to F, (WATCHED f, m p).

    With a = H_i / h_i, x the farthest initial state and M = A + B F C, d(a F C M^k x) is a dF C M^k x and, for each j < k,
    (a F C M^j B) dF (C M^(k-1-j) x).
    """
    assert spec.inputs is not None
    rows, (m, p), C = _rows(plant, spec, F, WATCHED), F.shape, plant.C
    facets = rows.shape[1]
    x = farthest(spec.initial, rows.reshape(-1, plant.n).T)
    closed, seen = plant.A + plant.B @ F @ C, np.empty((WATCHED, p, x.shape[1]))
    for i in range(WATCHED):
        seen[i] = C @ x
        x = np.clip(closed @ x, -LARGE, LARGE)
    far = seen.reshape(WATCHED, p, WATCHED, facets)  # i, p, k, f: C M^i x at the state that is farthest at move k
    left = rows @ plant.B  # j, f, m
    k = np.arange(WATCHED)
    slopes = np.einsum("fm,kpf->kfmp", spec.inputs.H / spec.inputs.h[:, None], far[k, :, k, :])
    for j in range(WATCHED - 1):
        later = k[j + 1:]
        slopes[j + 1:] += np.einsum("fm,kpf->kfmp", left[j], far[later - 1 - j, :, later, :])
    return slopes.reshape(-1, m * p)


def _starts(plant: Plant, spec: Spec) -> int:
    facets = 0 if spec.inputs is None else len(spec.inputs.h)
    return FEW if facets * 2**plant.n > MANY else USUAL


def _judged(plant: Plant, spec: Spec, F: Array | None) -> LinearCost | None:
    if F is None or not np.all(np.isfinite(F)):
        return None
    found = linear_cost(plant, spec, LinearController.static(F))
    return found if found.holds() else None


def _scaled(plant: Plant, spec: Spec, first: Array) -> list[Array]:
    """The gains to begin with, scaled down until the limits seem to be kept."""
    gains = [first]
    try:
        gains.append(discounted_lqr(plant, spec)[0] @ np.linalg.pinv(plant.C))
    except INCError:
        pass  # the first one is enough
    if spec.inputs is None or np.any(spec.inputs.h <= 0):
        return gains
    return [F * t for F, t in ((F, _largest(plant, spec, F)) for F in gains) if t > 0]


def _largest(plant: Plant, spec: Spec, F: Array) -> float:
    """The largest t found in [0, 1] for which t F keeps the limits for 300 moves and is stable, 0 where none is."""
    def is_kept(t: float) -> bool:
        stable = np.max(np.abs(np.linalg.eigvals(plant.A + plant.B @ (t * F) @ plant.C))) < 1
        return bool(stable and np.max(shares(plant, spec, t * F, FAR)) <= 1 - 1e-12)

    low = next((float(t) for t in np.linspace(1.0, 0.05, 20) if is_kept(float(t))), 0.0)
    high = min(1.0, low + 0.05)
    for _ in range(HALVINGS if 0 < low < 1 else 0):
        middle = (low + high) / 2
        low, high = (middle, high) if is_kept(middle) else (low, middle)
    return low


def _improved(plant: Plant, spec: Spec, found: LinearCost, until: float) -> LinearCost:
    """A gain of less cost near an admissible one, proved too; or the one given."""
    if found.controller.D_c.size > MOST_ENTRIES:
        return found
    for room in ROOMS:
        if time.monotonic() < until:
            better = _judged(plant, spec, _descended(plant, spec, found, room, until))
            if better is not None:
                return better if better.bound < found.bound else found
    return found


def _descended(plant: Plant, spec: Spec, found: LinearCost, room: float, until: float) -> Array:
    from scipy.optimize import minimize

    start, damped, S0 = found.controller.D_c, damped_plant(plant, spec), spec.initial.second_moment
    size = float(np.linalg.norm(start)) or 1.0

    def cost(v: Array) -> tuple[float, Array]:
        if time.monotonic() >= until:  # flat, so that the search ends here
            return 1.0, np.zeros(v.size)
        value, slope, _ = evaluate(damped, spec, (v * size).reshape(start.shape), S0)
        return (value / found.bound, slope.ravel() * size / found.bound) if np.isfinite(value) else (LOST, np.zeros(v.size))

    def rooms(v: Array) -> Array:
        return 1 - room - shares(plant, spec, (v * size).reshape(start.shape)).ravel()

    def slopes(v: Array) -> Array:
        return -size * _share_slopes(plant, spec, (v * size).reshape(start.shape))

    best = minimize(cost, start.ravel() / size, jac=True, method="SLSQP", options={"maxiter": ROUNDS, "ftol": 1e-10},
                    constraints={"type": "ineq", "fun": rooms, "jac": slopes}).x
    return np.asarray((best * size).reshape(start.shape))
