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
from .pressing import Pressed, press, responses, unproved
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


def propose(plant: Plant, spec: Spec, P: Array, members: np.ndarray, shapes: Shapes, T: int) -> Proposal:
    """Return trial inputs over T moves for cells `members` (c,) of these shapes, P (n, n) weighing the last state.

    For each cell the better of two: the best sequence from its center with the responses of the plant without limits,
    which makes the slopes constant on the cell (Jensen's inequality), and what affine multipliers give.
    """
    assert spec.inputs is not None
    point = optimal_sequences(plant, spec, spec.inputs, P, shapes.centers, T, _TOL)
    H = spec.inputs.H
    ridge = _RIDGE * discount_powers(spec.discount, T) * _weight(plant, spec, P) / np.sum(H**2)
    free = factor(plant, spec, P, H, np.broadcast_to(ridge, (T, len(H), 1)))
    curvature = 1 / np.einsum("fi,tij,fj->tf", H, free.inverses[:, 0], H)[:, :, None]
    pressed = press(plant, spec, P, shapes, point.multipliers / curvature - point.slack, curvature, ridge)
    steady = Trials(members, point.u, np.repeat(responses(plant, free.gains), members.size, axis=3))
    affine = _minimizers(plant, free, H, shapes, members, *_multipliers(shapes, point, pressed))
    values, found = (cell_bounds(plant, spec, P, shapes, each) for each in (steady, affine))
    better = found > values
    trials = Trials(members, np.where(better, affine.u, steady.u), np.where(better, affine.G, steady.G))
    best = np.maximum(found, values)
    at = costs(spec, P, rollout(plant.A, plant.B, shapes.centers, point.u), point.u)
    return Proposal(trials, best, _gains(shapes, pressed, curvature, at - best))


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


def _minimizers(plant: Plant, free: Factors, H: Array, shapes: Shapes, members: np.ndarray, mean: Array,
                slopes: Array) -> Trials:
    # The inputs that minimize the cost plus l_k(x)'H u_k, l (T, f, c) at the centers with slopes (T, f, n, c) in x.
    T, f, n, c = slopes.shape
    forces = H.T @ np.concatenate([mean[:, :, None], slopes], axis=2).reshape(T, f, -1)
    gains, inverses = free.gains[:, 0], free.inverses[:, 0]
    offsets, q = np.empty_like(forces), np.zeros((n, forces.shape[2]))
    for k in range(T - 1, -1, -1):
        slope = forces[k] + plant.B.T @ q
        offsets[k] = -inverses[k] @ slope
        q = plant.A.T @ q + gains[k].T @ slope
    x = np.concatenate([shapes.centers[:, None], np.repeat(np.eye(n)[:, :, None], c, axis=2)], axis=1).reshape(n, -1)
    u = np.empty_like(forces)
    for k in range(T):
        u[k] = offsets[k] + gains[k] @ x
        x = plant.A @ x + plant.B @ u[k]
    u = u.reshape(T, plant.m, 1 + n, c)
    return Trials(members, u[:, :, 0], u[:, :, 1:])


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
