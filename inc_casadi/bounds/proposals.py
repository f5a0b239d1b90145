"""Propose trial inputs for cells, and estimate what halving them would gain. Nothing here is trusted.

The dual of the best sequence from x lowers the cost J by multipliers l(x) >= 0 of the limits H u_k <= h: any such l gives
V(x) >= min over all inputs v of J(x, v) + sum l_k(x)'(H v_k - h), with equality at the best ones. Multipliers that are
affine on a cell and nonnegative all over it give the trial inputs: those that attain the minimum, affine in x too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..plant import Plant
from ..spec import Spec
from .cell_bounds import Trials, cell_bounds
from .moves import discount_powers, rollout
from .pressing import Pressed, foreseen, press, responses, unproved
from .price import Price
from .sequences import Factors, Interior, costs, factor, optimal_sequences
from .shapes import Shapes

_RIDGE = 1e-14  # of the weight of the inputs, so that inputs without any effect have a best value
_TOL = 1e-9  # relative gap of the sequences; what is lost by it in the end is of the order of its square


@dataclass(frozen=True, eq=False)
class Proposal:
    """Trial inputs, the bounds (c,) that they prove, and estimates of what halving each way gains (w, c)."""

    trials: Trials
    values: Array
    gains: Array


def propose(plant: Plant, spec: Spec, P: Array, members: np.ndarray, shapes: Shapes, T: int,
            price: Price | None = None) -> Proposal:
    """Return trial inputs over T moves for cells `members` (c,) of these shapes, P (n, n) weighing the last state.

    price: what the first r <= T inputs cost besides; nothing when left out.

    For each cell the better of two: the best sequence from its center with the responses of the plant without limits,
    which makes the slopes constant on the cell (Jensen's inequality), and what affine multipliers give.
    """
    assert spec.inputs is not None
    price = Price.none(plant.m, plant.n, members.size) if price is None else price
    point = optimal_sequences(plant, spec, spec.inputs, P, shapes.centers, T, _TOL, price.at)
    H = spec.inputs.H
    ridge = _RIDGE * discount_powers(spec.discount, T) * _weight(plant, spec, P) / np.sum(H**2)
    free = factor(plant, spec, P, H, np.broadcast_to(ridge, (T, len(H), 1)))
    curvature = 1 / np.einsum("fi,tij,fj->tf", H, free.inverses[:, 0], H)[:, :, None]
    pressed = press(plant, spec, P, shapes, point.multipliers / curvature - point.slack, curvature, ridge, price)
    unpressed = responses(plant, free.gains, foreseen(plant, free, price.slopes)[0])
    steady = Trials(members, point.u, np.broadcast_to(unpressed, (T, plant.m, plant.n, members.size)))
    mean, slopes = _multipliers(shapes, point, pressed)
    forces = np.einsum("fm,tfnc->tmnc", H, np.concatenate([mean[:, :, None], slopes], axis=2))
    forces[:len(price.at)] += np.concatenate([price.at[:, :, None], price.slopes], axis=2)
    affine = _minimizers(plant, free, shapes, members, forces)
    values, found = (cell_bounds(plant, spec, P, shapes, each, price) for each in (steady, affine))
    better = found > values
    trials = Trials(members, np.where(better, affine.u, steady.u), np.where(better, affine.G, steady.G))
    best = np.maximum(found, values)
    at = costs(spec, P, rollout(plant.A, plant.B, shapes.centers, point.u), point.u)
    return Proposal(trials, best, _gains(shapes, pressed, curvature, at + price.of(point.u) - best))


def _weight(plant: Plant, spec: Spec, P: Array) -> float:
    return float(np.linalg.norm(spec.R) + np.linalg.norm(plant.B.T @ P @ plant.B)) or 1.0


def _multipliers(shapes: Shapes, point: Interior, pressed: Pressed) -> tuple[Array, Array]:
    # At the centers (T, f, c) and their slopes in x (T, f, n, c): not negative on the cells. Where a limit is imposed in
    # part they touch zero at one end; where in whole but the slopes are too steep, both the slopes and the mean give way.
    slopes = pressed.multipliers
    least = shapes.depth(np.einsum("tfnc,nqc->tfqc", slopes, shapes.spans))
    whole = (point.multipliers + np.maximum(point.multipliers, least)) / 2
    mean = np.where(pressed.share < 1, least, whole)
    return mean, slopes * np.divide(mean, least, out=np.ones_like(mean), where=least > mean)[:, :, None]


def _minimizers(plant: Plant, free: Factors, shapes: Shapes, members: np.ndarray, forces: Array) -> Trials:
    # The inputs that minimize the cost plus f_k(x)'u_k, f (T, m, 1 + n, c) at the centers and its slopes in x.
    T, m, _, c = forces.shape
    n, flat = plant.n, forces.reshape(T, m, -1)
    gains, inverses = free.gains[:, 0], free.inverses[:, 0]
    offsets, q = np.empty_like(flat), np.zeros((n, flat.shape[2]))
    for k in range(T - 1, -1, -1):
        slope = flat[k] + plant.B.T @ q
        offsets[k] = -inverses[k] @ slope
        q = plant.A.T @ q + gains[k].T @ slope
    x = np.concatenate([shapes.centers[:, None], np.repeat(np.eye(n)[:, :, None], c, axis=2)], axis=1).reshape(n, -1)
    u = np.empty_like(flat)
    for k in range(T):
        u[k] = offsets[k] + gains[k] @ x
        x = plant.A @ x + plant.B @ u[k]
    found = u.reshape(T, m, 1 + n, c)
    return Trials(members, found[:, :, 0], found[:, :, 1:])


def _gains(shapes: Shapes, pressed: Pressed, curvature: Array, gap: Array) -> Array:
    # The losses of the limits one by one, or if that is more, what the Hessian at the center adds to the gap there,
    # shared out alike, or by the Hessian where no limit is met.
    gains, hessian = unproved(shapes, pressed, curvature), pressed.hessian
    curved = np.einsum("iqc,cij,jqc->c", shapes.spans, hessian, shapes.spans, optimize=True) / (2 * shapes.divisor)
    missing = np.maximum(gap + curved - gains.sum(axis=0), 0.0)
    lengths = np.maximum(np.einsum("iwc,cij,jwc->wc", shapes.ways, hessian, shapes.ways, optimize=True), 0.0)
    shares = np.where(gains.sum(axis=0) > 1e-9 * missing, gains, lengths)
    whole = shares.sum(axis=0)
    return gains + missing * np.divide(shares, whole, out=np.zeros_like(shares), where=whole > 0)
