"""Upper bounds on affine functions of state and hidden vector over cells, by multipliers on the units' lines."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from ..intervals import EPS, Lines, lines_on
from .cells import Cells
from .interval import Enclosure, Law, enclose

SIGN_ROUNDS = 30
TIGHTENINGS = 8
TINY = 1e-280


@dataclass(frozen=True, eq=False)
class Forms:
    """Functions f(x) = direct x + hidden eta(x) + constant: direct (k, n), hidden (k, q), constant (k,).

    The sizes are the same products with every term taken absolutely; rounding is relative to them.
    """

    direct: Array
    hidden: Array
    constant: Array
    direct_size: Array
    hidden_size: Array
    constant_size: Array

    def negative(self) -> Forms:
        """Return -f."""
        return replace(self, direct=-self.direct, hidden=-self.hidden, constant=-self.constant)

    def take(self, which: np.ndarray) -> Forms:
        """Return a choice of the functions."""
        return Forms(*(part[which] for part in (self.direct, self.hidden, self.constant, self.direct_size,
                                                self.hidden_size, self.constant_size)))


@dataclass(frozen=True, eq=False)
class Majorant:
    """Upper bounds of k functions over N cells: bound (N, k), and weight (N, q), how much of them each unit costs."""

    bound: Array
    weight: Array


def output_forms(law: Law, E: Array, G: Array, t: Array, E_size: Array, G_size: Array) -> Forms:
    """Return E x + G u - t as functions of (x, eta), u = K C x + V eta + d; the sizes are those of E and G.

    >>> from inc_casadi import INC
    >>> one = np.eye(1)
    >>> output_forms(Law(INC([[0.0]], one, [[2.0]], [[3.0]]), one), 0 * one, one, np.ones(1), 0 * one, one).hidden.tolist()
    [[2.0]]
    """
    inc = law.inc
    KC, KC_size = inc.K @ law.C, np.abs(inc.K) @ np.abs(law.C)
    return Forms(E + G @ KC, G @ inc.V, G @ inc.d - t, E_size + G_size @ KC_size, G_size @ np.abs(inc.V),
                 G_size @ np.abs(inc.d) + np.abs(t))


def hidden_forms(law: Law) -> Forms:
    """Return z = U C x + W eta + b as functions of (x, eta)."""
    inc = law.inc
    return Forms(law.drive, inc.W, inc.b, law.drive_size, np.abs(inc.W), np.abs(inc.b))


def majorant(law: Law, forms: Forms, cells: Cells, box: Enclosure, lines: Lines, mu: Array) -> Majorant:
    """Return sup f(x) from above over each cell, for any multipliers mu (N, k, q).

    0 = mu (phi(z) - eta), and mu_i phi_i(z_i) <= mu_i (r_i z_i + o_i) with the upper line where mu_i > 0 and the lower one
    elsewhere. With z = W eta + U C x + b, therefore

        f <= (direct + (mu r) U C) x + (hidden - mu + (mu r) W) eta + (mu r) b + mu o + constant,

    where (mu r)_i = mu_i r_i. The first term has its maximum at a corner of the cell, the second is bounded through the
    intervals of eta; a good mu makes it vanish. Nothing else is asked of mu, so it may come from rounded arithmetic; what
    rounding does here is at most `steps` eps times the sum of the terms' sizes.
    """
    inc, up = law.inc, mu > 0
    risen = mu * np.where(up, lines.upper_rise[:, None], lines.lower_rise[:, None])
    offset = mu * np.where(up, lines.upper_offset[:, None], lines.lower_offset[:, None])
    rest = forms.hidden - mu + risen @ inc.W
    through = np.maximum(rest * box.eta_low[:, None], rest * box.eta_high[:, None]).sum(axis=2)
    bound = cells.most(forms.direct + risen @ law.drive) + through + risen @ inc.b + offset.sum(axis=2) + forms.constant
    x = np.maximum(np.abs(box.low), np.abs(box.high))
    eta = np.maximum(np.abs(box.eta_low), np.abs(box.eta_high))
    steep = np.abs(risen)
    size = (((forms.direct_size + steep @ law.drive_size) @ x[:, :, None])[:, :, 0] + steep @ np.abs(inc.b)
            + ((forms.hidden_size + np.abs(mu) + steep @ np.abs(inc.W)) @ eta[:, :, None])[:, :, 0]
            + np.abs(offset).sum(axis=2) + forms.constant_size)
    apart = (lines.upper_rise - lines.lower_rise) * (box.z_low + box.z_high) / 2 + lines.upper_offset - lines.lower_offset
    return Majorant(bound + law.steps * EPS * size + TINY, (np.abs(mu) * apart[:, None]).max(axis=1, initial=0.0))


def parallel_multipliers(law: Law, forms: Forms, lines: Lines) -> Array:
    """Return mu (N, k, q) with mu (I - diag(r) W) = hidden, r the common slope of parallel lines: no rest is left.

    I - diag(r) W is nonsingular for slopes within the activations' own range, by either test of well-posedness.
    """
    system = np.eye(law.inc.q) - lines.upper_rise[:, :, None] * law.inc.W
    right = np.broadcast_to(forms.hidden.T, (len(system), *forms.hidden.T.shape))
    return np.swapaxes(np.linalg.solve(np.swapaxes(system, 1, 2), right), 1, 2)


def signed_multipliers(law: Law, forms: Forms, lines: Lines, mu: Array) -> Array:
    """Return multipliers after the iteration mu <- hidden + (mu r) W, where r follows the sign of mu at every turn.

    For a feedforward W this is back substitution from the last layer to the first, exact after as many turns as there are
    layers; for a contraction it converges; what is left of the rest is the majorant's to bound.
    """
    for _ in range(law.levels or SIGN_ROUNDS):
        rise = np.where(mu > 0, lines.upper_rise[:, None], lines.lower_rise[:, None])
        after = forms.hidden + (mu * rise) @ law.inc.W
        if np.allclose(after, mu, rtol=1e-12, atol=0.0):
            break
        mu = after
    return mu


def tightened(law: Law, cells: Cells, box: Enclosure) -> Enclosure:
    """Return the enclosure with z bounded through parallel lines as well, which keep what the units have in common."""
    parallel, _ = lines_on(law.inc.activations, box.z_low, box.z_high)
    forms = hidden_forms(law)
    mu = parallel_multipliers(law, forms, parallel)
    high = majorant(law, forms, cells, box, parallel, mu).bound
    low = -majorant(law, forms.negative(), cells, box, parallel, -mu).bound
    return box.within(low, high, law)


def enclosure(law: Law, cells: Cells, tightenings: int = TIGHTENINGS) -> Enclosure:
    """Return intervals of z and eta over the cells, tightened while that takes a tenth off the widths of z.

    Where only a multiplier T proves well-posedness, `enclose` is coarse and the first few turns gain most.

    >>> from inc_casadi import INC
    >>> from inc_casadi.output_bounds.cells import Boxes
    >>> law = Law(INC([[-3.0]], [[1.0]], [[1.0]], [[0.0]]), np.eye(1))  # eta = max(x, 0) / 4
    >>> enclosure(law, Boxes(np.array([[1.0]]), np.array([[2.0]]))).eta_high.round(6).tolist()
    [[0.5]]
    """
    box = enclose(law, cells.low, cells.high)
    for _ in range(tightenings if law.inc.W.any() else 0):
        before = box.z_high - box.z_low
        box = tightened(law, cells, box)
        if np.sum(box.z_high - box.z_low) > 0.9 * np.sum(before):
            break
    return box


def upper_bounds(law: Law, forms: Forms, cells: Cells, tightenings: int = TIGHTENINGS) -> Majorant:
    """Return upper bounds (N, k) on the functions over every cell: the least that parallel and close lines and mu = 0 give.

    tightenings: how often z is bounded anew before, at most (`enclosure`).

    >>> from inc_casadi import INC
    >>> from inc_casadi.output_bounds.cells import Boxes
    >>> law = Law(INC(np.zeros((2, 2)), [[1.0], [-1.0]], [[1.0, -1.0]], [[-1.0]]), np.eye(1))  # x+ - (-x)+ - x = 0
    >>> one = np.eye(1)
    >>> forms = output_forms(law, 0 * one, one, np.zeros(1), 0 * one, one)
    >>> upper_bounds(law, forms, Boxes(np.array([[-1.0], [-1.0]]), np.array([[1.0], [0.0]]))).bound.round(9).tolist()
    [[0.5], [0.0]]
    """
    box = enclosure(law, cells, tightenings)
    parallel, close = lines_on(law.inc.activations, box.z_low, box.z_high)
    mu = parallel_multipliers(law, forms, parallel)
    found = _least(majorant(law, forms, cells, box, parallel, mu), majorant(law, forms, cells, box, parallel, 0 * mu))
    if not law.inc.contraction.contracts or law.inc.q == 0:
        return found
    return _least(majorant(law, forms, cells, box, close, signed_multipliers(law, forms, close, mu)), found)


def _least(found: Majorant, other: Majorant) -> Majorant:
    """The smaller bounds of two; the units' weights of the first, which say where to cut."""
    return Majorant(np.minimum(found.bound, other.bound), found.weight)
