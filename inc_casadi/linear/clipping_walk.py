"""How far motions of a loop that is linear but for a few clipped moves can go, step by step, until none is clipped."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..definite import is_surely_positive
from ..errors import InvalidInputError
from ..readings import EPS, Rounded
from ..sets import Distribution
from .reach_of_rows import enclosing_box
from .tails import beyond, moments_known

MOST_MOVES = 400
MOST_CLIPPED = 100.0  # times its limits, of an output; what grows so far does not end
OFF = 1e-10  # share of the limits that rounding may take
_UP = 1 + 1e-12


class Parts(NamedTuple):
    """x+ = F x - N d and outputs r = Z x; |d_i| <= slope_i times what r_i is beyond [-low_i, high_i].

    F (n, n), N (n, r), Z (r, n), L (r, n): Rounded; low, high, slope (r,): floats, the limits rounded inward; W (n, n): with
    W > 0, W >= F'W F + Z'D Z, D = diag(1 / min(low, high)^2), which is the caller's to prove.
    """

    F: Rounded
    N: Rounded
    Z: Rounded
    L: Rounded
    low: Array
    high: Array
    slope: Array
    W: Array


@dataclass(frozen=True, eq=False)
class Clipping:
    """Bounds for each move k (moves, r): |d| <= most always, E |d| <= first, (E d^2)^(1/2) <= second, |L x| <= along."""

    most: Array
    first: Array
    second: Array
    along: Array


def clipping(parts: Parts, initial: Distribution) -> Clipping | str:
    """Return the bounds of every move that may be clipped, or in words why it is open whether clipping ends.

    x_k = F^k x_0 - sum_j F^(k-1-j) N d_j. With |d_j| <= most_j from the moves before, each a bound over all initial states,

        r_k = Z F^k x_0 + w,   |w_i| <= reach_i = sum_j |Z_i F^(k-1-j) N| most_j,

    so that |d_k,i| <= slope_i max(|Z_i F^k x_0| + reach_i - limit_i, 0): its largest value over the initial states is the
    next bound, and its moments follow from those of Z_i F^k x_0, which is linear in x_0 (`tails.beyond`). Once |x_k|_W <= 1
    for all of them, no limit is reached any more, for sum_{j >= k} |D^(1/2) Z x_j|^2 <= |x_k|_W^2 along F.

    Columns are rounded; F does not let their errors grow in the norm of W, and |Z_i e| <= min(low_i, high_i) |e|_W.
    """
    try:
        center, half = enclosing_box(initial)
    except InvalidInputError as error:
        return str(error)
    floor = _least_eigenvalue(parts.W)
    if floor <= 0:
        return "W is too near to singular"
    n, weights, orders = len(half), np.sqrt(np.diag(parts.W)) * _UP, moments_known(initial)
    half = (half + np.abs(center - initial.mean)) * _UP  # about the mean
    columns = np.column_stack([_spread(initial.covariance), initial.mean, np.diag(half)])
    lost = np.zeros(1 + 2 * n)
    found: list[tuple[Array, ...]] = []
    for _ in range(MOST_MOVES):
        off = float(lost.sum()) * _UP
        if off > OFF:
            return "rounding has built up, so that it is open whether clipping ends"
        if _size(columns[:, n:], parts.W) + off <= 1 - 1e-9:
            return Clipping(*(np.array(list(rows)) for rows in zip(*found, strict=True))) if found else _nothing(parts)
        found.append(_move(parts, columns, orders, off, floor))
        most = found[-1][0]
        if not np.all(most <= MOST_CLIPPED * parts.slope * np.minimum(parts.low, parts.high)):
            return "more and more may be clipped, so that it is open whether clipping ends"
        columns, lost = _stepped(parts, columns, lost, weights, most)
    return f"clipping does not end for certain within {MOST_MOVES} moves"


def _nothing(parts: Parts) -> Clipping:
    none = np.zeros((0, len(parts.low)))
    return Clipping(none, none, none, none)


def _move(parts: Parts, columns: Array, orders: int, off: float, floor: float) -> tuple[Array, ...]:
    """Bounds on one move from the columns of x_k: n of a root of its covariance, its mean, n sides, and what was clipped."""
    low, high, slope, n = parts.low, parts.high, parts.slope, len(columns)
    r = parts.Z @ columns
    error = r.error.sum(axis=1) + off * np.minimum(low, high)
    middle, sides = r.value[:, n], np.abs(r.value[:, n + 1:])
    linear, reach = sides[:, :n].sum(axis=1) * _UP, (sides[:, n:].sum(axis=1) + error) * _UP
    limits = np.stack([high, low])
    rounding = 8 * EPS * (np.where(np.isfinite(limits), limits, 0.0) + np.abs(middle) + linear + reach)
    rooms = np.stack([high - middle, low + middle]) - reach - rounding  # for the linear part before a unit switches
    most = slope * np.maximum(np.max(linear - rooms, axis=0), 0.0) * _UP
    deviation = np.broadcast_to((np.sqrt(np.sum(r.value[:, :n] ** 2, axis=1)) + error) * _UP, rooms.shape)
    share = 0.5 if orders > 1 else 1.0  # a symmetric variable is beyond either end half of the time
    levels, farthest = np.maximum(rooms, 1e-300), np.broadcast_to(linear, rooms.shape)
    beyonds = [share * np.where(rooms > 0, beyond(deviation, levels, farthest, power, orders), np.inf).sum(axis=0)
               for power in (1, 2)]
    first, second = np.minimum(slope * beyonds[0], most), np.minimum(slope * np.sqrt(beyonds[1]), most)
    along = parts.L @ columns[:, n:]
    drift = off * np.sqrt(np.sum(parts.L.size**2, axis=1) / floor)
    return most, first, second, ((np.abs(along.value) + along.error).sum(axis=1) + drift) * _UP


def _stepped(parts: Parts, columns: Array, lost: Array, weights: Array, most: Array) -> tuple[Array, Array]:
    """One step on: F times the columns, and new ones for what this move may have clipped."""
    moved = parts.F @ columns
    lost = (lost + weights @ moved.error) * _UP
    active = most > 0
    scaled = parts.N @ np.diag(most)[:, active]
    return (np.hstack([moved.value, scaled.value]), np.concatenate([lost, weights @ scaled.error]))


def _spread(covariance: Array) -> Array:
    """A matrix S with S S' >= the covariance."""
    n = len(covariance)
    return np.linalg.cholesky(covariance * (1 + 1e-9) + 1e-12 * np.trace(covariance) / n * np.eye(n))


def _size(columns: Array, W: Array) -> float:
    """A bound on |x|_W over the middle plus and minus each of the other columns."""
    forms = np.ones((1, len(W))) @ ((W @ Rounded.lift(columns)) * columns)
    return float(np.sqrt(np.maximum(forms.value + forms.error, 0.0)).sum()) * _UP


def _least_eigenvalue(W: Array) -> float:
    """A number mu > 0 with W - mu I > 0 for certain, or 0."""
    mu = float(np.linalg.eigvalsh(W)[0]) / 2
    return mu if mu > 0 and is_surely_positive(Rounded.lift(W) - Rounded.lift(mu * np.eye(len(W)))) else 0.0
