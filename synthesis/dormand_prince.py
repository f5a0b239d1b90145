"""Many initial value problems at once, every one with a step of its own: the method of Dormand and Prince in NumPy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import RK45

from inc_casadi.arrays import Array

Velocity = Callable[[Array, Array, np.ndarray], Array]
"""From times (N,), states (N, d) and the indices of these problems (N,) to derivatives (N, d)."""

MOST_STEPS = 20_000
_SAFETY, _LEAST, _LARGEST = 0.9, 0.2, 5.0


def integrate(velocity: Velocity, start: Array, begin: float, end: float, rtol: float, atol: Array) -> Array:
    """Return the states (N, d) at `end` of N problems that begin at `begin` in `start`; NaN where a motion is lost.

    The pair of orders 5(4) with SciPy's coefficients and usual step control. SciPy's own `solve_ivp` has one step for all
    components: where the right-hand side has kinks, and every problem meets them at its own time, all would take the small
    steps of each.

    Parameters
    ----------
    velocity : the right-hand side
    start : (N, d)
    begin, end : begin < end
    rtol, atol : a step's error is at most atol (d,) + rtol |state| in every component

    >>> end = integrate(lambda t, x, _: -x, np.array([[1.0], [2.0]]), 0.0, 1.0, 1e-10, np.array([1e-12]))
    >>> bool(np.max(np.abs(end[:, 0] - np.exp(-1) * np.array([1.0, 2.0]))) < 1e-9)
    True
    """
    out = np.full_like(start, np.nan)
    rows, t, x = np.arange(len(start)), np.full(len(start), begin), start
    slope = velocity(t, x, rows)
    step = np.full(len(start), (end - begin) / 100)
    for _ in range(MOST_STEPS):
        step = np.minimum(step, end - t)
        slopes, after, error = _attempt(velocity, t, x, rows, slope, step, rtol, atol)
        good = error <= 1.0
        last = t + step >= end - 1e-14 * (end - begin)
        out[rows[good & last]] = after[good & last]
        t, x, slope = (np.where(good.reshape(-1, *[1] * (old.ndim - 1)), new, old)
                       for new, old in ((t + step, t), (after, x), (slopes, slope)))
        with np.errstate(divide="ignore", invalid="ignore"):
            step = step * np.clip(_SAFETY * error ** -0.2, _LEAST, np.where(good, _LARGEST, 1.0))
        open_ = ~(good & last) & np.isfinite(step) & (step > 1e-15 * (end - begin))
        if not open_.any():
            break
        rows, t, x, slope, step = rows[open_], t[open_], x[open_], slope[open_], step[open_]
    return out


def _attempt(velocity: Velocity, t: Array, x: Array, rows: np.ndarray, slope: Array, step: Array, rtol: float,
             atol: Array) -> tuple[Array, Array, Array]:
    """Return the slope after one step of every problem, the state there, and the error in units of what is allowed."""
    K = np.empty((RK45.n_stages + 1, *x.shape))
    K[0] = slope
    for i in range(1, RK45.n_stages):
        K[i] = velocity(t + RK45.C[i] * step, x + step[:, None] * np.tensordot(RK45.A[i, :i], K[:i], 1), rows)
    after = x + step[:, None] * np.tensordot(RK45.B, K[:-1], 1)
    K[-1] = velocity(t + step, after, rows)
    allowed = atol + rtol * np.maximum(np.abs(x), np.abs(after))
    return K[-1], after, np.max(np.abs(step[:, None] * np.tensordot(RK45.E, K, 1)) / allowed, axis=1)
