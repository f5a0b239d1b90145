"""A lower model of the cost of u = F y on boxes of gains: of second order, with a remainder that covers all the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from .gain_algebra import Gains, Upper, absolute, norm, powers
from .gain_contraction import Contraction
from .gain_expansion import Expansion, expansion, inverse, third_order
from .moves import UNIT

_ROOM = 1e-6  # by this share of itself the remainder's source is enlarged, so that the remainder is positive definite


@dataclass(frozen=True, eq=False)
class Models:
    """On N boxes of gains F0 + delta, |delta| <= w: J(F) >= constant + slope's + s'curvature s / 2 with s = delta / w.

    constant : (N,), minus infinity where nothing was proved
    slope : (N, d); curvature : (N, d, d) symmetric
    lost : (N, d) how much of the remainder goes with the width of each entry, by which boxes are split
    cost : (N,) tr(P_F S0) at the centre, up to rounding, for the discount used; infinite where nothing was proved
    """

    constant: Array
    slope: Array
    curvature: Array
    lost: Array
    cost: Array


def models(gains: Gains, centers: Array, widths: Array, b: Array, shrink: Contraction) -> Models:
    """Return lower models of J(F) = tr(P_F S0) on boxes of gains, whether the loops are stable or not.

    Let T_F(P) = Q + C'F'RFC + b A_F'P A_F for a discount b <= beta, and P(F) = P0 + P_1 + P_2 - R with the terms of
    `expansion` and a remainder R > 0. Then T_F(P(F)) - P(F) is what the expansion misses, plus the third-order terms
    M of `third_order`, plus b D'P_2 D (D = A_F - A0), plus R - b A_F'R A_F. By |M| and |P_ij|, and by `Contraction`,
    that is >= 0 on the whole box if

        R - b (1 + t) A0'R A0 - b (1 + 1/t) d sum_i w_i^2 B_i'R B_i
            >= sum_ijk w_i w_j w_k |M_ijk| + b d sum_i w_i^2 B_i'W B_i + what is missed,    W = sum_ij w_i w_j |P_ij|.

    If it holds strictly, R - b A_F'R A_F > 0, so sqrt(b) A_F is stable for every F of the box, and P(F) <= T_F(P(F))
    <= T_F(T_F(P(F))) <= ..., which converges to the cost matrix for the discount b. Costs of stages are not negative, so
    the cost for beta >= b is no smaller. Hence J(F) >= tr(P(F) S0).

    Parameters
    ----------
    centers, widths : (N, d)
    b : (N,) discounts in (0, beta]; the smaller, the larger the boxes that can be handled
    shrink : `contraction` of the boxes

    Notes
    -----
    Sufficient. R is solved for, enlarged and verified, and every rounding is bounded, by norms. R = O(w^3). The matrices
    are those in the coordinates of `gains`; J does not depend on them, R does.

    >>> from inc_casadi import Box, Plant, Spec
    >>> from inc_casadi.bounds.gain_contraction import contraction
    >>> gains = Gains(Plant(1.5, 1.0), Spec(1.0, 0.0, 1.0, Box(-1, 1)))
    >>> F, w = -np.ones((1, 1)), np.full((1, 1), 0.01)
    >>> found = models(gains, F, w, np.ones(1), contraction(gains, F, w))
    >>> round(found.cost.item(), 6), round(found.constant.item(), 4), round(found.slope.item(), 6)  # 4/9, 16/27 w
    (0.444444, 0.4444, 0.005926)
    """
    found = expansion(gains, centers, widths, b, shrink.operator)
    M = third_order(gains, found, centers, b)
    R, proved = remainder(gains, widths, b, shrink, source_of(gains, found, M, widths, b, shrink),
                           Sizes(gains, centers, widths, b, shrink.split, found))
    S0 = gains.data.S0
    cost, taken = np.tensordot(found.P0, S0, axes=2), np.tensordot(R, S0, axes=2)
    slope = np.tensordot(found.P1, S0, axes=2) * widths
    second = np.tensordot(found.P2, S0, axes=2) * powers(widths, gains.pairs)
    curvature = np.zeros((len(centers), gains.d, gains.d))
    i, j = gains.pairs.T
    curvature[:, i, j] += second
    curvature[:, j, i] += second
    units = 64 * (gains.plant.n**2 + gains.d**2) * UNIT + gains.data.slack
    rounding = units * (found.size + norm(R)) * np.linalg.norm(S0)
    lost = (norm(M) * powers(widths, gains.triples)) @ gains.counts
    return Models(np.where(proved, cost - taken - rounding, -np.inf), slope, curvature, lost,
                  np.where(proved, cost, np.inf))


def source_of(gains: Gains, found: Expansion, M: Array, widths: Array, b: Array,
              shrink: Contraction) -> tuple[Array, Array]:
    """Return what the remainder must outweigh (N, n, n), and a bound (N,) on the norm of what was missed in forming it."""
    upper = Upper(gains.plant.n)
    third, off = absolute(M, powers(widths, gains.triples))
    W, more = absolute(found.P2, powers(widths, gains.pairs))
    fourth = upper.unpack(b[:, None] * (shrink.spread @ upper.pack(W)[..., None])[..., 0])
    turned = gains.d * (widths**2 @ gains.sizes**2)
    return third + fourth, found.missed + off + b * turned * more


def remainder(gains: Gains, widths: Array, b: Array, shrink: Contraction, source: tuple[Array, Array],
              sizes: Sizes) -> tuple[Array, np.ndarray]:
    """Return R (N, n, n) with R - b total(R) = source + room I, and whether (N,) the room outweighs all errors.

    Where it does, R - b A_F'R A_F exceeds the source for every gain of the box, and R > 0.
    """
    upper, n = Upper(gains.plant.n), gains.plant.n
    identity = np.eye(n)
    allowed = source[1] + sizes.rounding
    room = _ROOM * norm(source[0]) + 4 * allowed
    left = np.eye(len(upper.index[0])) - b[:, None, None] * shrink.total
    packed = inverse(left) @ upper.pack(source[0] + room[:, None, None] * identity)[..., None]
    R = upper.unpack(packed[..., 0])
    slack = upper.unpack((left @ packed)[..., 0]) - source[0]
    off = norm(slack - room[:, None, None] * identity)
    eigenvalues = np.linalg.eigvalsh(R)
    positive = eigenvalues[:, 0] > 16 * n * UNIT * eigenvalues[:, -1]
    return R, positive & (off + sizes.contracting * (norm(R) + norm(source[0])) + allowed < room)


@dataclass(frozen=True, eq=False)
class Sizes:
    """Roundings (N,) by norms: the absolute values of all terms of T(P) - P, times the number of roundings on the way."""

    gains: Gains
    centers: Array
    widths: Array
    b: Array
    split: Array
    found: Expansion

    @property
    def units(self) -> float:
        """The relative rounding of a term."""
        plant, d = self.gains.plant, self.gains.d
        return 16 * (UNIT * plant.n * (plant.n + plant.m + plant.p + d * d + 8) + self.gains.data.slack)

    @property
    def reach(self) -> Array:
        """The largest size (N, d) of each entry of the gain."""
        return np.abs(self.centers) + self.widths

    @property
    def loop(self) -> Array:
        """A bound on the norm of A_F."""
        return np.linalg.norm(self.gains.data.A) + self.reach @ self.gains.sizes

    @property
    def moved(self) -> Array:
        """A bound on the norm of the spread."""
        return self.gains.d * (self.widths**2 @ self.gains.sizes**2)

    @property
    def rounding(self) -> Array:
        """That of T(P) - P without the remainder."""
        stage = np.linalg.norm(self.gains.data.Q) + np.sum(self.reach * (self.reach @ self.gains.prices), axis=1)
        return self.units * (stage + (1 + self.b * (self.loop**2 + self.moved)) * self.found.size)

    @property
    def contracting(self) -> Array:
        """That of R - b total(R), relative to R."""
        t = self.split
        return self.units * (2 + self.b * ((1 + t) * self.loop**2 + (1 + 1 / t) * self.moved))
