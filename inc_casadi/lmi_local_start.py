"""Where the search for bounds on hidden units begins, and the least bounds that an ellipsoid asks for."""

from __future__ import annotations

import numpy as np

from .arrays import Array
from .errors import SolverError
from .local.base import Setting
from .local.unit_bounds import linearized, near_rest

WIDE = 3.0  # units of a hidden unit's own scale, at which the search for a first ellipsoid starts
LARGEST_BOUND = 1e9
SWEEPS = 80
LEAST = 1e-9  # of a unit's own scale, the bound to begin with


def linear_start(setting: Setting) -> Array | None:
    """Return P of a Lyapunov equation of the linearized loop, or None when that is not stable.

    A*'P A* - P = -I, or A*'P + P A* = -I, with A* from the units' derivatives at rest; scaled so that in {e'P e <= 1} the
    units move by a few of their own scales. Only a place to start at: nothing rests on it.

    >>> from inc_casadi import INC, Plant, close_loop
    >>> from inc_casadi.claims.attraction import Attraction
    >>> from inc_casadi.local.rest import rest_of
    >>> loops = [close_loop(Plant([[1.5]], [[1.0]]), INC.saturated([[k]], 1.0)) for k in (-1.0, -0.1)]
    >>> [linear_start(Setting(loop, Attraction(), rest_of(loop))) for loop in loops]
    [array([[0.11111111]]), None]
    """
    try:
        from scipy.linalg import LinAlgError, solve_continuous_lyapunov, solve_discrete_lyapunov
    except ImportError as error:
        raise SolverError("the search for an ellipsoid needs SciPy: pip install scipy") from error
    loop, (center, _) = setting.loop, near_rest(setting.rest)
    slope = np.array([unit.derivative(z) for unit, z in zip(loop.inc.activations, center, strict=True)])
    Z, n = loop.Z, loop.n
    eta = np.linalg.solve(np.eye(loop.q) - slope[:, None] * Z[:, n:], slope[:, None] * Z[:, :n])
    A = loop.F[:, :n] + loop.F[:, n:] @ eta
    discrete = loop.plant.discrete
    modes = np.linalg.eigvals(A)
    if (np.max(np.abs(modes)) >= 1.0) if discrete else (np.max(modes.real) >= 0.0):
        return None
    try:
        P = solve_discrete_lyapunov(A.T, np.eye(n)) if discrete else solve_continuous_lyapunov(A.T, -np.eye(n))
    except LinAlgError:
        return None
    P = (P + P.T) / 2
    reach = np.sqrt(np.einsum("ij,jk,ik->i", Z[:, :n], np.linalg.inv(P), Z[:, :n])) / (WIDE * unit_scales(setting, center))
    widest = float(np.max(reach, initial=0.0))
    return P * widest**2 if widest > 0 else P


def unit_scales(setting: Setting, center: Array) -> Array:
    """Return how far each unit must move for its slope to change by much: to its nearest kink, or 1; (q,), all positive.

    center: (q,) pre-activations at rest.
    """
    found = []
    for unit, z in zip(setting.loop.inc.activations, center, strict=True):
        kinks = np.abs(unit.pieces.kinks - z) if unit.pieces else np.empty(0)
        found.append(float(np.min(kinks, initial=np.inf)))
    scales = np.array(found)
    return np.where(np.isfinite(scales) & (scales > 0), scales, 1.0)


def consistent_bounds(setting: Setting, P: Array, factor: Array, bounded: np.ndarray) -> Array | None:
    """Return r (q,) with factor_i |g_i e| + slack_i < r_i on {e'P e <= 1}, close to the least, or None.

    Sweeps r_i <- factor_i |g_i| + slack_i from below until nothing grows; r_i = 0 for units that need no bound.
    factor: (q,); bounded: (q,), which units need one.

    >>> from inc_casadi import INC, Plant, close_loop
    >>> from inc_casadi.claims.attraction import Attraction
    >>> from inc_casadi.local.rest import rest_of
    >>> loop = close_loop(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.0]], 1.0))
    >>> setting = Setting(loop, Attraction(), rest_of(loop))
    >>> consistent_bounds(setting, np.array([[0.25]]), np.ones(1), np.array([True])).round(5).tolist()
    [2.0]
    """
    root = np.linalg.cholesky(np.linalg.inv(P))
    direct = setting.loop.Z[:, : setting.loop.n]
    r = np.where(bounded, LEAST * unit_scales(setting, near_rest(setting.rest)[0]), 0.0)
    for _ in range(SWEEPS):
        bounds = linearized(setting, r, P)
        asked = factor * np.linalg.norm(bounds.rows(direct) @ root, axis=1) + bounds.slack
        if not np.all(asked[bounded] < LARGEST_BOUND):
            return None
        if np.all(asked[bounded] <= r[bounded]):
            return r
        r = np.where(bounded, np.maximum(r, asked * (1 + 1e-6)), 0.0)
    return None
