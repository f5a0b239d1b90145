"""How fast the loops of a box of gains contract at least: one positive map that dominates all of theirs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from .gain_algebra import Gains, Upper

_ROUNDS = 4
_TINY = 1e-30


@dataclass(frozen=True, eq=False)
class Contraction:
    """For every X >= 0 and every gain of the box, A_F'X A_F <= (1 + t) A0'X A0 + (1 + 1/t) d sum_i w_i^2 B_i'X B_i.

    For A_F = A0 + D, D = sum_i delta_i B_i: (A0 + D)'X (A0 + D) <= (1 + t) A0'X A0 + (1 + 1/t) D'X D, and
    D'X D <= d sum_i delta_i^2 B_i'X B_i by Cauchy and Schwarz.

    Parameters
    ----------
    operator, spread : (N, s, s) matrices of X -> A0'X A0 and X -> d sum_i w_i^2 B_i'X B_i
    split : t (N,), any positive numbers; a search makes the right-hand side small
    radius : (N,) about the spectral radius of the map on the right; nothing rests on it
    """

    operator: Array
    spread: Array
    split: Array
    radius: Array

    @property
    def total(self) -> Array:
        """The matrices (N, s, s) of the map on the right."""
        t = self.split[:, None, None]
        return (1 + t) * self.operator + (1 + 1 / t) * self.spread

    def chosen(self, which: np.ndarray) -> Contraction:
        """Return the same for some of the boxes."""
        return Contraction(self.operator[which], self.spread[which], self.split[which], self.radius[which])


def contraction(gains: Gains, centers: Array, widths: Array) -> Contraction:
    """Return the map for boxes of centres and half-widths (N, d).

    >>> from inc_casadi import Box, Plant, Spec
    >>> gains = Gains(Plant(1.5, 1.0), Spec(1.0, 0.0, 1.0, Box(-1, 1)))
    >>> contraction(gains, -np.ones((1, 1)), np.full((1, 1), 0.1)).radius.round(6).tolist()  # (0.5 + 0.1)^2
    [0.36]
    """
    upper = Upper(gains.plant.n)
    operator = upper.congruence(gains.closed(centers)[1])
    spread = gains.d * np.tensordot(widths**2, upper.congruence(gains.states), axes=1)
    trace = upper.pack(np.eye(gains.plant.n))
    x = np.broadcast_to(trace[:, None], (len(centers), trace.size, 1))
    t = np.ones(len(centers))
    for _ in range(_ROUNDS):
        still, moved = operator @ x, spread @ x
        t = np.sqrt(np.maximum((trace @ moved)[:, 0], _TINY) / np.maximum((trace @ still)[:, 0], _TINY))
        t = np.clip(t, 1e-8, 1e8)
        x = (1 + t)[:, None, None] * still + (1 + 1 / t)[:, None, None] * moved
        x = x / np.maximum((trace @ x)[:, 0], _TINY)[:, None, None]
    found = Contraction(operator, spread, t, t)
    radius = np.maximum(np.max(np.abs(np.linalg.eigvals(found.total)), axis=1), _TINY)
    return Contraction(operator, spread, t, radius)
