"""Least expected cost over a cell, seen from trial inputs that are affine in the initial state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..plant import Plant
from ..sets import Box, Polytope
from ..spec import Spec
from .moves import minorant, rollout
from .price import Price
from .shapes import Shapes

_NUMBERS = 2**23  # about as many in one array at a time
_VERTEX_TOL = 1e-12  # relative error of the vertices of a polytope of inputs, which Qhull computes


@dataclass(frozen=True, eq=False)
class Trials:
    """Trial inputs u_k(x) = u_k + G_k (x - center) of the cells `members` (c,): u (T, m, c), G (T, m, n, c)."""

    members: np.ndarray
    u: Array
    G: Array

    def take(self, which: np.ndarray) -> Trials:
        """Return the trial inputs of some of the cells."""
        return Trials(self.members[which], self.u[:, :, which], self.G[:, :, :, which])

    def parts(self, most: int) -> list[Trials]:
        """Return the trial inputs in groups of at most so many cells."""
        c = self.members.size
        return [self.take(part) for part in np.array_split(np.arange(c), -(-c // most))] if c else []

    def fits(self, n: int, m: int, cells: int) -> bool:
        """Return whether these are m inputs, affine in n states, of some of so many cells."""
        T, c = len(self.u), self.members.size
        shapes = self.members.shape == (c,) and self.u.shape == (T, m, c) and self.G.shape == (T, m, n, c)
        return shapes and self.members.dtype.kind == "i" and bool(np.all((self.members >= 0) & (self.members < cells)))


def columns(plant: Plant, shapes: Shapes, trials: Trials) -> tuple[Array, Array]:
    """Return states (T + 1, n, (1 + q) c) and inputs (T, m, (1 + q) c): at the centers, then along each span.

    They are coefficients of xi: x_k(x_0) = first + sum_j xi_j (1 + j)th, and the same for the inputs.
    """
    n, q, c = shapes.spans.shape
    x0 = np.concatenate([shapes.centers[:, None], shapes.spans], axis=1).reshape(n, -1)
    along = np.einsum("tmnc,nqc->tmqc", trials.G, shapes.spans)
    u = np.concatenate([trials.u[:, :, None], along], axis=2).reshape(len(trials.u), plant.m, -1)
    return rollout(plant.A, plant.B, x0, u), u


def cell_bounds(plant: Plant, spec: Spec, P: Array, shapes: Shapes, trials: Trials, price: Price | None = None) -> Array:
    """Return for every cell (c,) a lower bound on the expectation of the least cost from x_0, given the cell.

    The least cost is V(x) = min over u_k in the limits of sum_{k<T} beta^k (x_k'Q x_k + u_k'R u_k) + beta^T x_T'P x_T.
    On the cell x = center + spans xi let v_k(x) be the trial inputs and y_k(x) the states under them, both affine in xi. For
    each x the tangent of the cost at (y(x), v(x)) lies below it (`minorant`), so

        V(x) >= p_0(x)'x - offset(x) + sum_k min over the limits of g_k(x)'u

    with costates p and slopes g affine in xi and the offset quadratic. In expectation over the cell:

    * p_0(x)'x - offset(x) is quadratic in xi: its value at the center, and the sum of its values along the spans divided by
      `divisor`, exactly, because E xi = 0 and the covariance is spans spans' / divisor;
    * min over the limits of g_k(x)'u is concave in x. On limits that are a box it is a sum over the entries g_ki, each above
      the chord over its range on the cell (`Shapes.ends`); on a polytope it is at least its average over the corners of the
      cell (`Shapes.corners`). Both are exact where one point of the limits is best all over the cell.

    So where the active limits of the best sequence are the same all over the cell, and the trial inputs are that sequence,
    nothing is lost. Any other trial inputs prove something lower.

    Parameters
    ----------
    P : (n, n) weight of the last state
    price : what the first r <= T inputs cost besides, which is added to the slopes g_k; nothing when left out

    Notes
    -----
    Rounding is subtracted. Errors of (y, v) do no harm. Those of the costates change the right side by e(x)'x_k with
    e(x) = sum_j xi_j e_j, |xi_j| <= 1: at most the sum of the slacks of the columns, each for all states reached from the
    cell. A weight negative by rounding costs (sum of q + 1 terms)^2 <= (q + 1) sum of their squares. The center is off by
    `rounding`, and so are the spans.
    """
    assert spec.inputs is not None
    q, c = shapes.spans.shape[1:]
    if len(P) * trials.u.size * (1 + q) > _NUMBERS and c > 1:
        halves = np.array_split(np.arange(c), 2)
        return np.concatenate([cell_bounds(plant, spec, P, shapes.take(each), trials.take(each),
                                           None if price is None else price.take(each)) for each in halves])
    x, u = columns(plant, shapes, trials)
    limit = np.max(np.abs(spec.inputs.vertices), axis=1)[None, :, None]
    below = minorant(plant, spec, P, x, u, limit, np.tile(shapes.reach, 1 + q))
    value = (np.sum(below.state * x[0], axis=0) - below.offset).reshape(1 + q, c)
    slack = (1 + q) * below.slack + 2 * np.sum(np.abs(below.state) * shapes.rounding[:, None], axis=0)
    g = below.inputs.reshape(*u.shape[:2], 1 + q, c)
    expected = value[0] + value[1:].sum(axis=0) / shapes.divisor - slack.reshape(1 + q, c).sum(axis=0)
    if price is not None:
        expected = expected - price.onto(g, shapes, limit[0, :, 0])
    return expected + _least(spec.inputs, shapes, g[:, :, 0], g[:, :, 1:])


def _least(limits: Box | Polytope, shapes: Shapes, g: Array, along: Array) -> Array:
    # Below E sum_k min over the limits of g_k(x)'u, from the slopes (T, m, c) at the centers and (T, m, q, c) along spans.
    if isinstance(limits, Box):
        ends, divisor = shapes.ends(g, along)
        low, high = limits.lower[:, None, None], limits.upper[:, None, None]
        return np.asarray(np.minimum(ends * low, ends * high).sum(axis=(0, 1, 2)) / divisor)
    sizes = _VERTEX_TOL * np.max(np.abs(limits.vertices), axis=1)
    total = np.zeros(g.shape[2])
    for at, slopes in zip(g, along, strict=True):
        corners, divisor = shapes.corners(at, slopes)
        values = np.einsum("iw,iec->wec", limits.vertices, corners, optimize=True)
        total += (np.min(values, axis=0).sum(axis=0) - np.einsum("i,iec->c", sizes, np.abs(corners))) / divisor
    return total
