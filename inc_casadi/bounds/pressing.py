"""How much of each limit to impose on a cell that the limit cuts through. Nothing here is trusted.

Let z be by how far an input would overstep a limit if it were free, w >= 0 by how far a multiplier pushes it back and s
its curvature: the limit costs s max(z, 0)^2 / 2, of which s (2 w z - w^2) / 2 is proved. Multipliers must not be negative
anywhere on the cell. Among affine w >= 0 the best is the projection of z in the mean: with z = zbar + d, d >= -r and
E d^2 = v, it is w = a (r + d) where a = (r zbar + v) / (r^2 + v) if that is in [0, 1], w = 0 if that is negative, and w = z
if zbar >= r. The share a is that of the limit which is imposed: a barrier of s a / (1 - a) on the input.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..plant import Plant
from ..spec import Spec
from .price import Price
from .sequences import Factors, factor
from .shapes import Shapes

_STIFF = 1e7  # barriers this many times the curvature are as good as a limit, and leave digits for their multipliers


@dataclass(frozen=True, eq=False)
class Pressed:
    """What is imposed on each cell, and what follows to first order.

    Parameters
    ----------
    mean : (T, f, c) zbar at every limit
    slopes : (T, f, q, c) z along the spans
    share : (T, f, c) the shares a
    multipliers : (T, f, n, c) slopes of the multipliers in x
    hessian : (c, n, n) of the least cost in x, the shares being imposed
    """

    mean: Array
    slopes: Array
    share: Array
    multipliers: Array
    hessian: Array


def press(plant: Plant, spec: Spec, P: Array, shapes: Shapes, mean: Array, curvature: Array, ridge: Array,
          price: Price) -> Pressed:
    """Return the shares, found in two rounds from the limits that are met at the centers.

    mean (T, f, c): zbar; curvature, ridge (T, f, 1): s, and what is added to the weight of the inputs anyway; price:
    what the first inputs cost besides.
    """
    assert spec.inputs is not None
    H, share = spec.inputs.H, (mean > 0).astype(float)
    slopes = np.zeros((*mean.shape[:2], *shapes.spans.shape[1:]))
    for remaining in (2, 1, 0):
        barrier = curvature * np.minimum(share / np.maximum(1 - share, 1 / _STIFF), _STIFF)
        factors = factor(plant, spec, P, H, barrier + ridge)
        offsets, bend = foreseen(plant, factors, price.slopes)
        moved = np.einsum("fm,tmnc->tfnc", H, responses(plant, factors.gains, offsets))
        if not remaining:
            break
        slopes = np.einsum("tfnc,nqc->tfqc", moved * (1 + barrier / curvature)[:, :, None], shapes.spans)
        share = _share(shapes, mean, slopes)
    return Pressed(mean, slopes, share, barrier[:, :, None] * moved, factors.hessian + bend)


def foreseen(plant: Plant, factors: Factors, price: Array) -> tuple[Array, Array]:
    """Return what a price Pi (r, m, n, c) of the inputs, (Pi_k x_0)'u_k, adds to the best ones, and to the Hessian in x_0.

    The best are u_k = K_k x_k + offset_k x_0, offset (r, c, m, n), and the Hessian is changed by (c, n, n).

    >>> flat = Factors(np.zeros((1, 1, 1, 1)), np.full((1, 1, 1, 1), 0.5), np.zeros((1, 1, 1)))  # min over u of u^2 + 4 x u
    >>> [found.ravel().tolist() for found in foreseen(Plant(1.0, 1.0), flat, np.full((1, 1, 1, 1), 4.0))]
    [[-2.0], [-8.0]]
    """
    r, m, n, c = price.shape
    price = price.transpose(0, 3, 1, 2)
    offsets, bend, q = np.empty((r, c, m, n)), np.zeros((c, n, n)), np.zeros((c, n, n))
    for k in range(r - 1, -1, -1):
        slope = price[k] + plant.B.T @ q
        offsets[k] = -factors.inverses[k] @ slope
        bend += slope.transpose(0, 2, 1) @ offsets[k]
        q = plant.A.T @ q + factors.gains[k].transpose(0, 2, 1) @ slope
    return offsets, bend + q + q.transpose(0, 2, 1)


def responses(plant: Plant, gains: Array, offsets: Array) -> Array:
    """Return du_k/dx_0 (T, m, n, c) of u_k = K_k x_k + offset_k x_0 for gains K (T, c, m, n), offsets (r, c, m, n), r <= T.

    >>> responses(Plant(2.0, 1.0), np.array([[[[-1.0]]], [[[-2.0]]]]), np.zeros((0, 1, 1, 1))).ravel().tolist()
    [-1.0, -2.0]
    """
    T, m, n = len(gains), *gains.shape[2:]
    c = max(gains.shape[1], offsets.shape[1])
    x, found = np.broadcast_to(np.eye(n), (c, n, n)), np.empty((T, m, n, c))
    for k in range(T):
        u = gains[k] @ x + (offsets[k] if k < len(offsets) else 0.0)
        x = plant.A @ x + plant.B @ u
        found[k] = u.transpose(1, 2, 0)
    return found


def _share(shapes: Shapes, mean: Array, slopes: Array) -> Array:
    depth, square = shapes.depth(slopes), np.sum(slopes**2, axis=2) / shapes.divisor
    whole = depth**2 + square
    part = np.divide(depth * mean + square, whole, out=np.zeros_like(mean), where=whole > 0)
    return np.where(mean >= depth, 1.0, np.clip(part, 0.0, 1.0)) * (mean > -depth)


def unproved(shapes: Shapes, pressed: Pressed, curvature: Array) -> Array:
    """Return estimates (w, c) of what the limits cost beyond what is proved, shared out by the ways to halve a cell.

    Each limit counts alone, z as if uniform; its loss is shared out by the squared changes of z.
    """
    z, a, square = pressed.mean, pressed.share, np.sum(pressed.slopes**2, axis=2) / shapes.divisor
    depth, wide = shapes.depth(pressed.slopes), np.sqrt(3 * square)
    third = np.divide(np.clip(z + wide, 0, 2 * wide) ** 3, 6 * wide, out=np.zeros_like(z), where=wide > 0)
    cost = np.where(z >= wide, z**2 + square, third)
    proved = np.where(z >= depth, z**2 + square, 2 * a * (depth * z + square) - a**2 * (depth**2 + square))
    lost = curvature / 2 * np.maximum(cost - proved * (z > -depth), 0.0)
    ways = shapes.changes(pressed.slopes) ** 2
    whole = ways.sum(axis=2)
    rate = np.divide(lost, whole, out=np.zeros_like(lost), where=whole > 0)
    return np.einsum("tfc,tfwc->wc", rate, ways)
