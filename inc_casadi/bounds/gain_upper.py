"""The best gain known: from local search at first, then from the middles of boxes, which lead to other valleys."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..errors import InfeasibleError, NotStabilizableError, SolverError
from ..linear.gain_search import ADMISSIBLE_TOL, Admissible, annealed, excess
from ..linear.lyapunov import discounted_sum
from ..linear.regulator import damped_plant
from ..linear.static_gain import StaticGain, best_static_gain
from ..sets.farthest import farthest
from .gain_algebra import Gains, Upper
from .gain_cells import CellBounds
from .gain_expansion import inverse
from .gain_limits import GainLimits

_LONGEST = 20_000  # moves after which a motion counts as one that does not die out
_STEPS, _ROUNDS, _DRAWS, _TRIED = 200, 40, 64, 16
_BETTER = 1e-6  # relative gain in cost that is worth a local search


def first_gain(limits: GainLimits, seed: int) -> StaticGain:
    """Return the best gain that local search finds, or zero at infinite cost when it finds none."""
    plant, spec = limits.gains.plant, limits.gains.spec
    none = StaticGain(np.zeros((plant.m, plant.p)), np.inf, False)
    try:
        found = best_static_gain(plant, spec, seed=seed)
    except (InfeasibleError, NotStabilizableError, SolverError):
        return none
    found = found if found.admissible else none
    if not limits.moves or keeps(limits, found.F):
        return found
    return polished(limits, found.F, none, seed)


def improved(limits: GainLimits, bounds: CellBounds, best: StaticGain, seed: int) -> StaticGain:
    """Return a better gain if the middle of a box is one, after local search from there."""
    worth = np.flatnonzero(bounds.cost < best.cost * (1 - _BETTER))
    if not worth.size:
        return best
    worth = worth[np.argsort(bounds.cost[worth], kind="stable")]
    rows, limit = limits.first
    inside = worth[np.all(bounds.gains[worth] @ rows.T <= limit, axis=1)][:_TRIED]
    if limits.moves and inside.size:
        inside = inside[worst(limits, bounds.gains[inside]) <= ADMISSIBLE_TOL]
    if not inside.size:
        return best
    return polished(limits, bounds.gains[inside[0]].reshape(best.F.shape), best, seed)


def polished(limits: GainLimits, F: Array, best: StaticGain, seed: int) -> StaticGain:
    """Return the better of `best` and what local search makes of F."""
    found = _drawn(limits, F, seed) if limits.moves else _descended(limits, F)
    if not found.cost < best.cost or limits.moves and not keeps(limits, found.F):
        return best
    return found


def _descended(limits: GainLimits, F: Array) -> StaticGain:
    plant, spec = limits.gains.plant, limits.gains.spec
    reached = annealed(damped_plant(plant, spec), Admissible(plant, spec), F)
    F = F if reached is None else reached
    admissible = spec.inputs is None or bool(np.max(excess(plant, spec, F)[0]) <= ADMISSIBLE_TOL)
    cost = float(costs(limits.gains, F.reshape(1, -1))[0])
    return StaticGain(F, cost if admissible else np.inf, admissible)


def _drawn(limits: GainLimits, F: Array, seed: int) -> StaticGain:
    # The best of gains drawn around the best so far, ever closer; those that exceed the limits less come first.
    rng, best = np.random.default_rng(seed), F.ravel()
    scale, rank = float(np.linalg.norm(best)) + 1e-3, (np.inf, np.inf)
    for _ in range(_ROUNDS):
        draws = best + scale * rng.standard_normal((_DRAWS, best.size)) * rng.random((_DRAWS, 1)) ** 2
        draws[0] = best
        draws[1:9] = best * np.linspace(0.3, 0.99, 8)[:, None]
        over = np.maximum(worst(limits, draws), 0.0)
        over[over <= ADMISSIBLE_TOL] = 0.0
        price = costs(limits.gains, draws)
        first = int(np.lexsort((price, over))[0])
        scale *= 1.3 if (over[first], price[first]) < rank else 0.7
        rank, best = (over[first], price[first]), draws[first]
    return StaticGain(best.reshape(F.shape), float(rank[1]) if rank[0] == 0 else np.inf, rank[0] == 0)


def costs(gains: Gains, F: Array) -> Array:
    """Return tr(P_F S0) (N,) of gains F (N, d), infinite where sqrt(beta) (A + BFC) is not stable.

    >>> from inc_casadi import Box, Plant, Spec
    >>> costs(Gains(Plant(1.5, 1.0), Spec(1.0, 0.0, 1.0, Box(-1, 1))), np.array([[-1.0], [0.0]])).round(6).tolist()
    [0.444444, inf]
    """
    spec, upper = gains.spec, Upper(gains.plant.n)
    G, A = gains.closed(F)
    stable = np.sqrt(spec.discount) * np.max(np.abs(np.linalg.eigvals(A)), axis=1) < 1 - 1e-12
    left = np.eye(len(upper.index[0])) - spec.discount * upper.congruence(A[stable])
    stage = upper.pack(spec.Q + np.swapaxes(G[stable], 1, 2) @ spec.R @ G[stable])
    P = upper.unpack((inverse(left) @ stage[..., None])[..., 0])
    out = np.full(len(F), np.inf)
    out[stable] = np.tensordot(P, spec.initial.second_moment, axes=2)
    return out


def worst(limits: GainLimits, F: Array) -> Array:
    """Return by how much gains F (N, d) exceed the limits in the first 200 moves, relative to their size (N,)."""
    inputs, (G, A) = limits.gains.spec.inputs, limits.gains.closed(F)
    if inputs is None:
        return np.zeros(len(F))
    x = np.broadcast_to(limits.points, (len(F), *limits.points.shape))
    over, start = np.full(len(F), -np.inf), float(np.max(np.abs(limits.points), initial=1e-300))
    for _ in range(_STEPS):
        excess_now = (inputs.H @ G @ x - inputs.h[:, None]) / limits.sizes[:, None]
        over = np.maximum(over, np.max(excess_now, axis=(1, 2)))
        x = np.clip(A @ x, -1e6 * start, 1e6 * start)
        if np.max(np.abs(x)) < 1e-9 * start:
            break
    return over


def keeps(limits: GainLimits, F: Array) -> bool:
    """Return whether u = F y keeps the input limits for ever from every initial state, within 1e-9 of their size.

    Move by move over the whole initial set, until its states lie in an ellipsoid x'P x <= r, P - A_F'P A_F = I, which no
    motion leaves, and on which H_u F C x <= (H_u F C P^-1 C'F'H_u')^(1/2) r^(1/2) <= h_u.
    """
    gains, inputs = limits.gains, limits.gains.spec.inputs
    if inputs is None:
        return True
    G, A = (part[0] for part in gains.closed(F.reshape(1, -1)))
    P = discounted_sum(A, np.eye(len(A)))
    if P is None or np.any(inputs.h <= 0):
        return False
    rows, root = inputs.H @ G, np.linalg.cholesky(P).T
    steep = np.sqrt(np.sum((rows @ np.linalg.inv(root)) ** 2, axis=1))
    for _ in range(_LONGEST):
        if np.any(_reach(limits, rows) > limits.widened):
            return False
        if np.all(steep * np.linalg.norm(np.maximum(_reach(limits, root), _reach(limits, -root))) <= inputs.h):
            return True
        rows, root = rows @ A, root @ A
    return False


def _reach(limits: GainLimits, rows: Array) -> Array:
    return np.sum(rows.T * farthest(limits.gains.spec.initial, rows.T), axis=0)
