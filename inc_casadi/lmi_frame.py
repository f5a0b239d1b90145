"""Coordinates in which a loop is of size one, so that an LMI solver works on numbers near 1 whatever the units are."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .arrays import Array
from .loop import ClosedLoop

FLOOR = 1e-6  # of the mean weight, added to every direction so that none is weightless
USABLE = 1e-8  # ratio of eigenvalues below which a P is no better frame than the one at hand


@dataclass(frozen=True, eq=False)
class Frame:
    """Coordinates x~ = T x, eta~ = eta / sizes in which the loop is of size one.

    T: (n, n) invertible; sizes: (q,) positive. Conditions are looked at as S'(condition)S, a congruence, so that which
    numbers satisfy them does not change: only how far from zero a solver sees them.
    """

    T: Array
    sizes: Array

    @property
    def back(self) -> Array:
        """T^{-1}."""
        return np.linalg.inv(self.T)

    def congruence(self, loop: ClosedLoop) -> Array:
        """Return S (width, width) with s = S s~ for a loop, widened or not: one scale for each column that is no state."""
        n, scale = loop.n, np.ones(loop.width)
        scale[np.argmax(loop.H, axis=1)] = self.sizes[list(loop.units)]
        entering = slice(n + loop.q, n + loop.q + loop.inputs)
        reach = np.linalg.norm(self.T @ loop.F[:n, entering], axis=0) if loop.F.shape[0] else np.ones(loop.inputs)
        scale[entering] = 1.0 / np.where(reach > 0, reach, 1.0)
        if loop.atoms:
            scale[loop.width - len(loop.atoms):] = self.sizes[list(loop.atoms)]
        S = np.diag(scale)
        S[:n, :n] = self.back
        return S

    def refined(self, values: Mapping[str, Array], loop: ClosedLoop) -> Frame:
        """Return the frame in which the P just found is the identity, or this one when P is of no use."""
        P, back = values.get("P"), self.back
        if P is None or P.shape != back.shape:
            return self
        eigenvalues = np.linalg.eigvalsh(back.T @ P @ back)
        if not eigenvalues[0] > USABLE * eigenvalues[-1]:
            return self
        return _frame_of(P, loop) or self


def frame_of_loop(loop: ClosedLoop, stage: Array | None = None) -> Frame:
    """Return the frame in which a linear stand-in of the loop has the identity as its cost-to-go.

    The stand-in replaces each unit by the middle of its sector, and damps what is unstable. A cost-to-go moves with the
    coordinates, and so does the frame: a change of units leaves the problem that the solver sees as it is.

    stage: (n+q, n+q) cost of a step, None or zero when there is none.

    >>> from inc_casadi import INC, Plant, close_loop
    >>> loop = close_loop(Plant([[0.5]], [[1.0]]), INC.linear([[0.0]]))
    >>> frame_of_loop(loop, np.array([[3.0]])).T.round(3).tolist()
    [[2.0]]
    """
    n, q = loop.n, loop.q
    middle = (loop.lower + loop.upper)[:, None] / 2
    hidden = np.linalg.lstsq(np.eye(q) - middle * loop.Z[:, n:], middle * loop.Z[:, :n], rcond=None)[0]
    lift = np.vstack([np.eye(n), hidden])
    weight = np.zeros((n, n)) if stage is None else lift.T @ stage @ lift
    if not np.trace(weight) > 0:
        outputs = np.vstack([loop.G @ lift, loop.Z @ lift])
        weight = outputs.T @ outputs
    size = float(np.trace(weight)) / n if np.trace(weight) > 0 else 1.0
    weight = (weight + weight.T) / 2 + FLOOR * size * np.eye(n)
    frame = _frame_of(_cost_to_go(loop, loop.F @ lift, weight), loop) or _frame_of(np.eye(n), loop)
    assert frame is not None
    return frame


def _frame_of(P: Array, loop: ClosedLoop) -> Frame | None:
    """Return the frame with T'T = P, or None when P has no Cholesky factor."""
    try:
        T = np.asarray(np.linalg.cholesky(P).T, dtype=float)
    except np.linalg.LinAlgError:
        return None
    n = loop.n
    reads = np.linalg.norm(loop.Z[:, :n] @ np.linalg.inv(T), axis=1)
    acts = np.linalg.norm(T @ loop.F[:, n: n + loop.q], axis=0)
    return Frame(T, np.where(reads > 0, reads, 1.0 / np.maximum(1.0, acts)))


def _cost_to_go(loop: ClosedLoop, A: Array, weight: Array) -> Array:
    """Return the solution P of the Lyapunov equation of A, damped as far as needed."""
    from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov
    modes = np.linalg.eigvals(A)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an inaccurate P is only a poorer choice of coordinates
        if loop.plant.discrete:
            damped = A * min(1.0, 0.95 / max(float(np.max(np.abs(modes))), 1e-300))
            P = solve_discrete_lyapunov(damped.T, weight)
        else:
            shift = max(0.0, float(np.max(modes.real)) + 0.05 * max(float(np.linalg.norm(A, 2)), 1e-300))
            P = solve_continuous_lyapunov((A - shift * np.eye(len(A))).T, -weight)
    return (P + P.T) / 2
