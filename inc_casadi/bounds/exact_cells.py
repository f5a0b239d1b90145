"""Bounds of cells in exact arithmetic: integers on a common scale, with one rounding that is paid for in full."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..integers import over_common_denominator
from ..plant import Plant
from ..sets import Box, Polytope
from ..spec import Spec
from .cell_bounds import Trials, columns
from .exact_polytope import corners
from .price import Price
from .shapes import Shapes

_WEIGHT_BITS = 128  # of beta^k, rounded down: stage costs are not negative, so less of them is a lower bound
_TRIAL_BITS = 62  # of the trial numbers, against the largest: any numbers may be tried
_COSTATE_BITS = 64  # of the costates beyond those


@dataclass(frozen=True, eq=False)
class Scaled:
    """Integers `number` that stand for number / 2^bits."""

    number: np.ndarray
    bits: int

    @classmethod
    def of(cls, value: Array) -> Scaled:
        """Return floats as exactly the numbers they are.

        >>> Scaled.of(np.array([0.75])).bits
        2
        """
        number, denominator = over_common_denominator(value)
        return cls(number, denominator.bit_length() - 1)

    @classmethod
    def near(cls, value: Array) -> Scaled:
        """Return numbers within 2^-63 of the largest of floats."""
        exponent = int(np.frexp(np.max(np.abs(value), initial=0.0))[1])
        bits = _TRIAL_BITS - exponent
        return cls(np.rint(np.ldexp(value, bits)).astype(np.int64).astype(object), bits)

    def fractions(self) -> np.ndarray:
        """Return the numbers as Fractions."""
        unit = Fraction(2) ** -self.bits
        return self.number * unit


def exact_bounds(plant: Plant, spec: Spec, P: Array, shapes: Shapes, cells: Shapes, trials: Trials,
                 price: Price | None = None) -> np.ndarray | str:
    """Return in Fractions (c,) lower bounds on the expectation of the least cost given each cell, or why there are none.

    The argument of `cell_bounds`, which see, with these numbers: floats of plant and spec as they are; beta^k rounded down;
    the trial inputs v and the states y under them rounded somehow, as any will do; costates p on a grid of step s, each
    the exact value from its successor rounded down by less than 2 s per entry. The last changes the right side by
    e_k(x)'x_k with e_k(x) = sum_j xi_j e_kj, |xi_j| <= 1: at most 2 (1 + q) s sum_k |x_k|_1 over what can be reached. That
    is subtracted. The weight P of the last state must be positive semidefinite, as Q and R must, which is the caller's care.
    On a simplex xi has the covariance (I - 11'/k)/divisor, k = n + 1, less than I/divisor where squares are subtracted, and
    the same where the spans, of sum 0, are a factor.

    Parameters
    ----------
    P : (n, n) weight of the last state
    shapes, cells : the cells in floats, from which trial numbers are computed, and in Fractions, which count
    price : as for `cell_bounds`, its values in Fractions whose denominators are powers of two, as of boxes
    """
    assert spec.inputs is not None
    vertices = _vertices(spec.inputs)
    if isinstance(vertices, str):
        return vertices
    floats = columns(plant, shapes, trials)
    if not all(np.all(np.isfinite(each)) for each in floats):
        return "the trial inputs of a cell are not finite"
    y, v = (Scaled.near(each) for each in floats)
    offset, p0, g, step = _tangents(plant, spec, P, y, v)
    if price is not None and len(price.at):
        g = _priced(g, price, cells)
    n, q, c = cells.spans.shape
    x0 = np.concatenate([cells.centers[:, None], cells.spans], axis=1).reshape(n, -1)
    value = (_dot(p0, x0) - offset).reshape(1 + q, c)
    lost = 2 * (1 + q) * step * _most_reached(plant, cells.reach, vertices, len(trials.u))
    slopes = g.number.reshape(*g.number.shape[:2], 1 + q, c)
    least = _least(spec.inputs, vertices, cells, slopes[:, :, 0], slopes[:, :, 1:]) * Fraction(2) ** -g.bits
    return value[0] + value[1:].sum(axis=0) / Fraction(cells.divisor) + least - lost


def _vertices(limits: Box | Polytope) -> np.ndarray | str:
    # (m, w) in Fractions; of a box its two ends, which bound |u| and are all that is needed.
    if isinstance(limits, Box):
        return np.stack([exact(limits.lower), exact(limits.upper)], axis=1)
    found = corners(limits)
    return found if isinstance(found, str) else found.points.T


def _priced(g: Scaled, price: Price, cells: Shapes) -> Scaled:
    # The slopes with the price added, at the centers and along the spans.
    along = np.sum(exact(price.slopes)[:, :, :, None] * cells.spans, axis=2)
    r, m = price.at.shape[:2]
    number, denominator = over_common_denominator(np.concatenate([price.at[:, :, None], along], axis=2).reshape(r, m, -1))
    assert denominator & (denominator - 1) == 0
    bits = denominator.bit_length() - 1
    finest = max(g.bits, bits)
    total = g.number << (finest - g.bits)
    total[:r] += number << (finest - bits)
    return Scaled(total, finest)


def _dot(p: Scaled, x: np.ndarray) -> np.ndarray:
    number, denominator = over_common_denominator(x)
    return np.sum(p.number * number, axis=0) * (Fraction(2) ** -p.bits / denominator)


def _powers(discount: float, T: int) -> list[int]:
    # beta^k 2^bits for k = 0..T, rounded down.
    above, below = discount.as_integer_ratio()
    return [(above**k << _WEIGHT_BITS) // below**k for k in range(T + 1)]


def _tangents(plant: Plant, spec: Spec, P: Array, y: Scaled, v: Scaled) -> tuple[np.ndarray, Scaled, Scaled, Fraction]:
    # Offsets of the columns, p_0, the slopes (T, m, columns), and the step of the grid of the costates.
    A, B, Q, R, last = (Scaled.of(each) for each in (plant.A, plant.B, spec.Q, spec.R, P))
    T, w = len(v.number), _powers(spec.discount, len(v.number))
    size = int(np.frexp(max(np.max(np.abs(P)), np.max(np.abs(spec.Q)), np.finfo(float).tiny))[1])
    grid = y.bits + _COSTATE_BITS - size
    bent = last.number @ y.number[T]
    offset = Scaled(w[T] * np.sum(bent * y.number[T], axis=0), _WEIGHT_BITS + last.bits + 2 * y.bits).fractions()
    p = _shifted(2 * w[T] * bent, grid - (_WEIGHT_BITS + last.bits + y.bits))
    states, inputs = 0 * p[0], 0 * p[0]
    slopes = np.empty(v.number.shape, dtype=object)
    of_p, of_v = B.bits + grid, _WEIGHT_BITS + R.bits + v.bits
    for k in range(T - 1, -1, -1):
        weighed, bent = R.number @ v.number[k], Q.number @ y.number[k]
        inputs = inputs + w[k] * np.sum(weighed * v.number[k], axis=0)
        states = states + w[k] * np.sum(bent * y.number[k], axis=0)
        slopes[k] = ((B.number.T @ p) << max(0, of_v - of_p)) + ((2 * w[k] * weighed) << max(0, of_p - of_v))
        p = _shifted(A.number.T @ p, -A.bits) + _shifted(2 * w[k] * bent, grid - (_WEIGHT_BITS + Q.bits + y.bits))
    offset = offset + Scaled(states, _WEIGHT_BITS + Q.bits + 2 * y.bits).fractions()
    offset = offset + Scaled(inputs, of_v + v.bits).fractions()
    return offset, Scaled(p, grid), Scaled(slopes, max(of_p, of_v)), Fraction(2) ** -grid


def _shifted(number: np.ndarray, left: int) -> np.ndarray:
    return number << left if left >= 0 else number >> -left


def _most_reached(plant: Plant, start: np.ndarray, vertices: np.ndarray, T: int) -> Fraction:
    # Above sum_{k<=T} |x_k|_1 over all |x_0| <= start (n, c) and inputs within the limits, by powers rounded up.
    A, B = Scaled.of(plant.A), Scaled.of(plant.B)
    x0, u = start.max(axis=1), np.abs(vertices).max(axis=1)
    power, total, pushed = Scaled(np.eye(plant.n, dtype=int).astype(object), 0), Fraction(0), np.zeros(plant.m, dtype=object)
    for _ in range(T + 1):
        total += (_above(power) @ x0).sum() + pushed @ u
        pushed = pushed + _above(Scaled(power.number @ B.number, power.bits + B.bits)).sum(axis=0)
        power = Scaled(A.number @ power.number, power.bits + A.bits)
    return Fraction(total)


def _above(value: Scaled) -> np.ndarray:
    return -(-np.abs(value.number) >> value.bits)


def _least(limits: Box | Polytope, vertices: np.ndarray, cells: Shapes, g: np.ndarray, along: np.ndarray) -> np.ndarray:
    # Below E sum_k min over the limits of g_k(x)'u for integers g (T, m, c), along (T, m, q, c): on their scale.
    number, denominator = over_common_denominator(vertices)
    total = np.zeros(g.shape[2], dtype=object)
    for at, slopes in zip(g, along, strict=True):
        if isinstance(limits, Box):
            ends, divisor = cells.ends(at, slopes)
            total = total + np.minimum(ends * number[:, :1, None], ends * number[:, 1:, None]).sum(axis=(0, 1))
        else:
            points, divisor = cells.corners(at, slopes)
            values = np.tensordot(number, points, axes=([0], [0]))
            total = total + np.min(values, axis=0).sum(axis=0)
    return total * Fraction(1, denominator * divisor)
