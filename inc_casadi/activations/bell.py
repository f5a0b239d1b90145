"""Smooth activations whose derivative is a bell: even, and falling on both sides of 0. Their local slopes and sectors."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from .base import Activation
from .piecewise import EPS, around, as_interval

VALUE_ROUNDING = 16.0  # phi as computed errs by less than this times eps |phi|: tanh of a good library by 2 eps
DERIVATIVE_ROUNDING = 64.0  # the derivative as computed errs by less than this times eps times its largest value
HALVINGS, STEP = 40, 1e-5


class Bell(Activation):
    """An activation with a derivative that is even and falls on both sides of 0, such as tanh.

    Then a chord's slope, the mean of the derivative between its ends, rises and then falls as one end moves. With f(z) the
    slope of the chord from c >= 0 to z (the other sign is its mirror image):

    * f is least at an end of the interval of z, and over an interval of c at an end of that too;
    * f is largest at the tangent point t in (-c, 0], where phi'(t) = f(t) (f rises while phi' > f, and the mean over
      [-c, c] exceeds phi'(c)), or at the end next to it when the interval does not contain it. The largest value over an
      interval of c is at the c nearest to 0: nearer centers take in more of the bell's middle.

    Values and derivatives are taken as computed, with errors below 16 eps |phi| and 64 eps max phi'; the bounds are
    moved outward by as much.
    """

    def slopes_on(self, low: ArrayLike, high: ArrayLike) -> tuple[Array, Array]:
        """Return the derivative's smallest and largest value on [low, high], at the far end and nearest to 0."""
        low, high = as_interval(low, high)
        far = np.where(-low > high, low, high)
        return self._inside(self.derivative(far) - self._room, self.derivative(np.clip(0.0, low, high)) + self._room)

    def sector_on(self, center: ArrayLike, low: ArrayLike, high: ArrayLike,
                  spread: ArrayLike = 0.0) -> tuple[Array, Array]:
        """Return bounds on (phi(z) - phi(c)) / (z - c), z in [low, high], |c - center| <= spread; sharp to about 1e-5."""
        first, last = around(center, spread)
        low, high = as_interval(low, high)
        low, high = np.minimum(low, first), np.maximum(high, last)
        hull = self.slopes_on(low, high)
        corners = [self._chord(c, z)[0] for c in (first, last) for z in (low, high)]
        lowest = np.maximum(np.min(np.broadcast_arrays(*corners), axis=0), hull[0])
        c = np.clip(0.0, first, last)
        mirrored = c < 0
        return lowest, np.minimum(self._steepest(np.abs(c), np.where(mirrored, -high, low), mirrored), hull[1])

    @property
    def _room(self) -> float:
        return DERIVATIVE_ROUNDING * EPS * self.slopes[1]

    def _inside(self, lowest: Array, highest: Array) -> tuple[Array, Array]:
        return np.clip(lowest, *self.slopes), np.clip(highest, *self.slopes)

    def _steepest(self, c: Array, low: Array, mirrored: Array) -> Array:
        """Return an upper bound on the slopes of chords from c >= 0 to z >= low; mirrored: c and z stand for -c and -z.

        Any t in [tangent point, 0] serves: the largest slope is phi'(tangent point) <= phi'(t).
        """
        t = self._beyond_tangent(c, mirrored)
        sign = np.where(mirrored, -1.0, 1.0)
        return np.where(low >= t, self._chord(sign * c, sign * low)[1], self.derivative(t) + self._room)

    def _beyond_tangent(self, c: Array, mirrored: Array) -> Array:
        """Return t in [tangent point, 0], close to it, or 0 where rounding does not let it be told."""
        sign = np.where(mirrored, -1.0, 1.0)
        at_c, steep, gentle = sign * self(sign * c), 0.0 * c, -1.0 * c

        def excess(t: Array) -> tuple[Array, Array]:  # phi'(t) (c - t) - (phi(c) - phi(t)), and a bound on its error
            at_t, slope = sign * self(sign * t), self.derivative(t)
            error = 2 * self._room * (c - t) + (VALUE_ROUNDING + 4) * EPS * (np.abs(at_c) + np.abs(at_t))
            return slope * (c - t) - (at_c - at_t), error

        for _ in range(HALVINGS):
            middle = (steep + gentle) / 2
            above = excess(middle)[0] > 0
            steep, gentle = np.where(above, middle, steep), np.where(above, gentle, middle)
        t = (1 - STEP) * steep
        value, error = excess(t)
        return np.where(value > error, t, 0.0)

    def _chord(self, c: Array, z: Array) -> tuple[Array, Array]:
        """Return bounds on the slope of the chord from c to z, infinite where the two are one."""
        at_c, at_z, gap = self(c), self(z), np.abs(z - c)
        apart = np.where(gap > 0, gap, 1.0)
        slope = np.where(z > c, at_z - at_c, at_c - at_z) / apart
        room = (VALUE_ROUNDING + 4) * EPS * ((np.abs(at_c) + np.abs(at_z)) / apart + np.abs(slope)) * (1 + 8 * EPS)
        return np.where(gap > 0, slope - room, -np.inf), np.where(gap > 0, slope + room, np.inf)
