"""Lower bounds on the cost of all admissible gains of boxes, thousands of boxes at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from .gain_algebra import Gains
from .gain_box import FirstBox
from .gain_contraction import Contraction, contraction
from .gain_halfspaces import HalfSpaces, narrowed
from .gain_limits import GainLimits
from .gain_models import models
from .gain_quadratics import lowest
from .halvings import Halvings
from .moves import UNIT

_CHUNK = 4_000_000  # floats that the largest intermediate array of a chunk of boxes may hold
_MARGINS = ((0.5, 1.0), (2.0, 1.0), (8.0, 1.0), (1.0, 0.5), (3.0, 0.5), (np.inf, 1.0))  # factor and power of the
# relative width of the box: by so much the discount stays below 1 / radius
_LEAST, _MOST = 1e-5, 0.75  # limits of that margin


@dataclass(frozen=True, eq=False)
class CellBounds:
    """What N boxes of gains are known to cost: value (N,), infinite where no gain is admissible.

    lost : (N, d) by which entry the bound suffers, shares of 1
    gains : (N, d) the gains in the middle of what the limits leave; cost : (N,) of these, where it is known, else infinite
    """

    value: Array
    lost: Array
    gains: Array
    cost: Array


def boxes(box: FirstBox, record: Halvings) -> tuple[Array, Array]:
    """Return centres and half-widths (N, d) of the boxes never cut, a little too wide, so that nothing is left between."""
    return placed(box, record.unfolded(np.zeros((1, 2, box.lower.size), dtype=np.int64), halved)[record.leaves])


def halved(places: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the two halves of boxes; a place (N, 2, d) is how often each axis was halved, and which part it is.

    >>> halved(np.zeros((1, 2, 1), dtype=np.int64), np.array([0]))[1].tolist()
    [[[1], [1]]]
    """
    first, rows = places.copy(), np.arange(len(places))
    first[rows, 0, along] += 1
    first[rows, 1, along] *= 2
    second = first.copy()
    second[rows, 1, along] += 1
    return first, second


def placed(box: FirstBox, places: np.ndarray) -> tuple[Array, Array]:
    """Return centres and half-widths (N, d) of places in the first box."""
    part = np.ldexp(1.0, -places[:, 0])
    span = box.upper - box.lower
    centers = box.lower + span * ((places[:, 1] + 0.5) * part)
    return centers, span / 2 * part * (1 + 1e-12) + 8 * UNIT * (np.abs(box.lower) + np.abs(box.upper))


def cell_bounds(limits: GainLimits, centers: Array, widths: Array, target: float) -> CellBounds:
    """Return lower bounds on J(F) over the admissible gains of boxes; no more is tried once a bound is above `target`.

    `Floor` is one for every gain, and `models` gives one for each of a few discounts.
    """
    gains = limits.gains
    n, d = gains.plant.n, gains.d
    floats = n * n * (d**3 + 2 * d**2 * (d + 1) + n * n)
    if limits.moves:
        floats = max(floats, d * d * n * limits.points.shape[1],
                     limits.moves * (d + 1) * len(limits.sizes) * limits.points.shape[1])
    size = max(8, _CHUNK // floats)
    parts = [_chunk(limits, centers[i:i + size], widths[i:i + size], target) for i in range(0, len(centers), size)]
    return CellBounds(*(np.concatenate(arrays) for arrays in zip(*[(p.value, p.lost, p.gains, p.cost) for p in parts],
                                                                strict=True)))


def _chunk(limits: GainLimits, centers: Array, widths: Array, target: float) -> CellBounds:
    gains = limits.inner
    half, empty = narrowed(limits.on(centers, widths))
    shrink = contraction(gains, half.centers, half.widths)
    beta, N = gains.spec.discount, len(centers)
    value = limits.floor.on(half)
    value[empty] = np.inf
    cost, lost = np.full(N, np.inf), _even(gains, half.widths)
    best: Array = np.full(N, -np.inf)
    going: np.ndarray = value < target
    for factor, power in _MARGINS:
        b = np.minimum(beta, (1 - np.clip(factor * shrink.split**power, _LEAST, _MOST)) / shrink.radius)
        now = np.flatnonzero(going)
        if not now.size:
            break
        found, share, centre_cost = _at(gains, half, now, b[now], shrink.chosen(now), target)
        better = found > best[now]
        best[now[better]], lost[now[better]] = found[better], share[better]
        cost[now] = np.where(b[now] == beta, np.minimum(cost[now], centre_cost), cost[now])
        # A smaller discount is tried as long as that helps, and where it is another one.
        going[now] = (better | ~np.isfinite(best[now])) & (best[now] < target) & (b[now] < beta)
    value = np.maximum(value, best)
    return CellBounds(value, lost, half.centers, cost)


def _at(gains: Gains, half: HalfSpaces, which: np.ndarray, b: Array, shrink: Contraction,
        target: float) -> tuple[Array, Array, Array]:
    # Bounds on the chosen boxes at the discounts b, shares of the loss, and costs of the centres.
    widths = half.widths[which]
    model = models(gains, half.centers[which], widths, b, shrink)
    rows, room = half.rows[which] * widths[:, None], half.room[which]
    least = lowest(model.slope, model.curvature, rows, room, sweeps=0)
    hard = np.flatnonzero(np.isfinite(model.constant) & (model.constant + least < target))
    if hard.size:
        least[hard] = np.maximum(least[hard], lowest(model.slope[hard], model.curvature[hard], rows[hard], room[hard]))
    value = model.constant + least
    total = np.sum(model.lost, axis=1, keepdims=True)
    share = 0.9 * model.lost / np.where(total > 0, total, 1.0) + 0.1 * _even(gains, widths)
    return value - 4 * UNIT * np.abs(value), share, model.cost


def _even(gains: Gains, widths: Array) -> Array:
    moved = widths * (np.linalg.norm(gains.states, axis=(1, 2)) + np.finfo(float).tiny)
    return moved / np.sum(moved, axis=1, keepdims=True)
