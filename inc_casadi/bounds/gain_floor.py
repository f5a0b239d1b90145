"""A convex lower bound on the cost of all gains at once: one step of u = F y, and the best inputs whatever after it."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

from ..arrays import Array
from ..blocks import exact
from .gain_algebra import Gains
from .gain_halfspaces import HalfSpaces
from .gain_quadratics import lowest
from .moves import UNIT
from .value_iteration import settled_steps, value_iteration


@dataclass(frozen=True, eq=False)
class Floor:
    """J(F) >= tr((Q + C'F'RFC + beta A_F'P A_F) S0) for x'P x at most the cost-to-go under any inputs whatever.

    P is value iteration from zero. With f = vec F the right-hand side is f'H f + 2 g'f + c,

        H = (R + beta B'P B) x (C S0 C'),    g = vec(beta B'P A S0 C'),    c = tr((Q + beta A'P A) S0).
    """

    gains: Gains

    @cached_property
    def P(self) -> Array:
        """The matrix (n, n) of value iteration."""
        plant, spec = self.gains.plant, self.gains.spec
        return value_iteration(plant, spec, settled_steps(plant, spec))[0][-1]

    @cached_property
    def exactly(self) -> tuple[np.ndarray, np.ndarray, Fraction]:
        """H (d, d), g (d,) and c in Fractions.

        >>> from inc_casadi import Box, Plant, Spec
        >>> floor = Floor(Gains(Plant(2.0, 1.0), Spec(1.0, 0.0, 1.0, Box(-3, 3))))  # 3 (1 + (2 + f)^2)
        >>> [round(float(np.ravel(part)[0]), 9) for part in floor.exactly]
        [3.0, 6.0, 15.0]
        """
        plant, spec, P = self.gains.plant, self.gains.spec, exact(self.P)
        A, B, C, Q, R = exact(plant.A), exact(plant.B), exact(plant.C), exact(spec.Q), exact(spec.R)
        S0, beta = exact(spec.initial.second_moment), Fraction(spec.discount)
        H = np.kron(R + beta * (B.T @ P @ B), C @ S0 @ C.T)
        g = (beta * (B.T @ P @ A @ S0 @ C.T)).ravel()
        return H, g, np.sum((Q + beta * (A.T @ P @ A)) * S0)

    @cached_property
    def floats(self) -> tuple[Array, Array, float]:
        """The same, rounded once."""
        H, g, c = self.exactly
        return H.astype(float), g.astype(float), float(c)

    def on(self, half: HalfSpaces) -> Array:
        """Return what every admissible gain of boxes costs at least, (N,), rounded down."""
        H, g, c = self.floats
        f, w = half.centers, half.widths
        value = c + np.sum(f * (f @ H + 2 * g), axis=1)
        size = abs(c) + np.sum((np.abs(f) + w) * ((np.abs(f) + w) @ np.abs(H) + 2 * np.abs(g)), axis=1)
        curvature = 2 * w[:, :, None] * H * w[:, None, :]
        rows = half.rows * w[:, None]
        least = lowest(2 * w * (f @ H + g), curvature, rows, half.room, sweeps=0)
        return value + least - 16 * UNIT * (len(g) + 8) * size
