"""How large every quantity of a law can be, and how far from the truth its computed value, for every measurement at once.

A bound is a row (a, r): the quantity is at most a + r t for every y with |y_j| <= t. Over a box of measurements r is 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...activations.stack import Units, groups, lipschitz
from ...arrays import Array
from ...inc import INC
from ...sets import Box
from .expressions import rounding
from .precision import DOUBLE, Precision
from .stages import Stage


@dataclass(frozen=True, eq=False)
class Sizes:
    """Bounds (.., 2) on |y_j|, on the computed hidden units and on their distance from the true ones, in units done so
    far.

    `largest` (2,) bounds everything that is formed on the way; precision: of the floats that are computed with.
    """

    y: Array
    eta: Array
    error: Array
    largest: Array
    precision: Precision = DOUBLE

    def with_stage(self, eta: Array, error: Array, *formed: Array) -> Sizes:
        """Return the bounds with the units of the next stage, of true size eta (k, 2), and what was formed for them."""
        largest = np.max(np.vstack([self.largest, eta + error, *(np.atleast_2d(part) for part in formed)]), axis=0)
        return Sizes(self.y, np.vstack([self.eta, eta + error]), np.vstack([self.error, error]), largest, self.precision)


def begin(inc: INC, inputs: Box | None, precision: Precision = DOUBLE) -> Sizes:
    """Return the bounds before the first stage: |y_j| over the box, or by t."""
    columns = np.zeros((inc.p, 2))
    if inputs is None:
        columns[:, 1] = 1.0
    else:
        columns[:, 0] = np.maximum(np.abs(inputs.lower), np.abs(inputs.upper))
    none = np.zeros((0, 2))
    return Sizes(columns, none, none, columns.max(axis=0), precision)


def drive(law: INC, stage: Stage, sizes: Sizes) -> Array:
    """Return bounds (k, 2) on |b| + |U||y| + |W||eta| over the units that a stage reads from before."""
    bias = np.column_stack([np.abs(law.b[stage.own]), np.zeros(stage.size)])
    return bias + np.abs(law.U[stage.own]) @ sizes.y + np.abs(law.W[stage.own, stage.read]) @ sizes.eta[stage.read]


def inherited(law: INC, stage: Stage, sizes: Sizes) -> Array:
    """Return bounds (k, 2) on what the errors of earlier units do to phi(z): S |W| error."""
    slope = lipschitz(law.activations[stage.own])[:, None]
    return slope * (np.abs(law.W[stage.own, stage.read]) @ sizes.error[stage.read])


def image(units: Units, z: Array) -> Array:
    """Return bounds (k, 2) on |phi(z)| <= |phi(0)| + S |z|, or what a bounded unit states of itself if that is less.

    >>> from inc_casadi import ReLU, Saturation
    >>> image((ReLU(), Saturation()), np.array([[1.0, 2.0], [1.0, 2.0]])).tolist()
    [[1.0, 2.0], [1.0, 0.0]]
    """
    at_zero = np.array([abs(float(unit(0.0))) for unit in units])
    out = lipschitz(units)[:, None] * z
    out[:, 0] += at_zero
    most = np.array([max(abs(end) for end in unit.bounds) for unit in units])
    capped = np.isfinite(most) & ((out[:, 1] > 0) | (out[:, 0] > most))
    out[capped] = np.column_stack([most, np.zeros(most.size)])[capped]
    return out


def evaluation_error(units: Units, z: Array, terms: int, precision: Precision) -> Array:
    """Return bounds (k, 2) on |computed phi(z) - phi(z)|, z a sum of so many products of total size z (k, 2).

    A sum of n products in floating point, in any order and with or without fused multiply-add, errs by gamma_n times the
    sum of their sizes (Higham, Accuracy and Stability of Numerical Algorithms, sec. 3.1); n eps here, twice gamma_n. That
    covers coefficients which single precision rounds, too: each is one factor more in its product, and gamma_(n + 1) does.
    """
    eps = precision.eps
    size = (1 + eps * terms) * z
    out = lipschitz(units)[:, None] * (eps * (terms + 4) * z)
    for unit, rows in groups(units):
        for column in range(2):
            part = rounding(unit, size[rows, column], eps)
            out[rows, column] += part if column == 0 else part - rounding(unit, np.zeros(rows.size), eps)
    out[:, 0] += (terms + 4) * precision.tiny * (1 + lipschitz(units))
    return out


def layer(law: INC, stage: Stage, sizes: Sizes) -> Sizes:
    """Return the bounds after a layer: its error is its own rounding and what it inherits."""
    units, z = law.activations[stage.own], drive(law, stage, sizes)
    terms = law.p + stage.high - stage.low + 1
    error = evaluation_error(units, z, terms, sizes.precision) + inherited(law, stage, sizes)
    return sizes.with_stage(image(units, z), error, z)


def output_error(law: INC, sizes: Sizes) -> tuple[Array, Array]:
    """Return bounds (m, 2) on |computed u - u|, and (2,) on everything that was formed."""
    size = np.column_stack([np.abs(law.d), np.zeros(law.m)]) + np.abs(law.K) @ sizes.y + np.abs(law.V) @ sizes.eta
    terms = law.p + law.q + 5
    error = np.abs(law.V) @ sizes.error + sizes.precision.eps * terms * size
    error[:, 0] += terms * sizes.precision.tiny
    return error, np.maximum(sizes.largest, size.max(axis=0))


def by_column(bound: Callable[[Array], Array], rows: Array) -> Array:
    """Return a bound that is sublinear in a residual (k,), for both columns of rows (k, 2)."""
    return np.column_stack([bound(rows[:, column]) for column in range(2)])
