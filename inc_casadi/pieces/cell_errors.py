"""How far a rounded walk over polytopes can be from the true motions, cell by cell, from the laws that are known there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..activations.stack import lipschitz, slopes
from ..arrays import Array
from ..well_posed import WellPosedness, error_from_residual
from .cell_motions import PlacedLaws
from .fixed import RESOLUTION
from .laws import PiecewiseLoop
from .places import floats

GUARD = 1 + 1e-6  # far more than the rounding of a line of floats
CONFIRMED = 1 + 1e-9  # likewise, and less than GUARD: what an inequality found by iteration is checked with
UNIT = 2.0**-52
ROUNDS, GROWTH = 200, 1e12  # an iteration that has not ended by then, or grown by so much, is given up
MOST_NUMBERS = 4_000_000  # matrices of so many entries are worked on at once


@dataclass(frozen=True, eq=False)
class Slopes:
    """Bounds from above on magnitudes of slopes, for each of P laws: what answers to what.

    z, u, x: to the state, |Z| (P, q, n), |G| (P, m, n) and |A + B G| (P, n, n). With D the slopes of the pieces and
    R = (I - D W)^{-1}, of z, u and the next state to a change of eta's equation: kink_z = |W R| (P, q, q), kink_u = |V R|
    (P, m, q), kink_x = |B V R| (P, n, q); change (P, q): the largest change of slope from the piece to another one; known
    (P,): whether the last three could be bounded.
    """

    z: Array
    u: Array
    x: Array
    kink_z: Array
    kink_u: Array
    kink_x: Array
    change: Array
    known: np.ndarray


def slopes_of(loop: PiecewiseLoop, laws: PlacedLaws, patterns: np.ndarray, rows: np.ndarray | None = None) -> Slopes:
    """Return the slopes of laws, given with 256 places, whose patterns are (P, q), or of some rows of these.

    The laws are off by 2 roundings and A + B Gx by at most 2 + m B + m G, so that 8 times this is added, and for floats a
    millionth.
    """
    plant, units = loop.plant, np.arange(loop.inc.q)
    rows = np.arange(len(patterns)) if rows is None else rows
    patterns = patterns[rows]
    slope, _, low, _ = loop.pieces_in_floats
    real = low < np.inf  # the rest of the table is padding
    steps = np.where(real[:, :, None] & real[:, None, :], np.abs(slope[:, :, None] - slope[:, None, :]), 0.0)
    Gx = np.abs(floats(laws.Gx[rows]))
    B = max(1.0, float(np.max(np.abs(plant.B))))
    small = 8 * RESOLUTION * (2 + plant.m * (B + float(np.max(Gx, initial=1.0))))
    Zx, Ax = (np.abs(floats(part[rows])) for part in (laws.Zx, laws.Ax))
    through, known = _kink_slopes(loop, slope[units, patterns])
    q, m = loop.inc.q, plant.m
    Z, G, closed = (GUARD * part + small for part in (Zx, Gx, Ax))
    return Slopes(Z, G, closed, through[:, :q], through[:, q:q + m], through[:, q + m:],
                  GUARD * steps.max(axis=2, initial=0.0)[units, patterns], known)


def _kink_slopes(loop: PiecewiseLoop, slope: Array) -> tuple[Array, np.ndarray]:
    """Bounds from above on |L R|, L = [W; V; B V], for slopes (P, q), and which of them are known.

    Let T be a computed inverse of I - D W and F = I - (I - D W) T, bounded by the computed F and its rounding, with the
    largest row sum t < 1/2. Then R = T (I - F)^{-1}, so |L R| <= |L T| + |L| |T| |F| (I - |F|)^{-1}, and an entry of
    |F| (I - |F|)^{-1} = |F| + |F|^2 (I - |F|)^{-1} is at most |F| + t^2 / (1 - t). A product of floats with q terms is off
    by q + 1 roundings of the product of magnitudes.
    """
    inc, B = loop.inc, loop.plant.B
    q = inc.q
    L = np.concatenate([inc.W, inc.V, B @ inc.V])
    size = np.concatenate([np.abs(inc.W), np.abs(inc.V), np.abs(B) @ np.abs(inc.V)])
    bounds, known = np.zeros((len(slope), len(L), q)), np.zeros(len(slope), dtype=bool)
    round_off = 4 * (q + B.shape[1] + 8) * UNIT
    stride = max(1, MOST_NUMBERS // max(1, q * len(L)))
    for begin in range(0, len(slope), stride):
        part = slice(begin, begin + stride)
        DW = slope[part, :, None] * inc.W
        T = _inverse(np.eye(q) - DW)
        F = np.abs(np.eye(q) - (np.eye(q) - DW) @ T) + round_off * (np.eye(q) + (np.eye(q) + np.abs(DW)) @ np.abs(T))
        t = GUARD * F.sum(axis=2).max(axis=1, initial=0.0)
        known[part] = t < 0.5
        t = np.where(known[part], t, 0.0)[:, None, None]
        more = F + t**2 / (1 - t) + round_off * np.eye(q)
        bounds[part] = GUARD * (np.abs(L @ T) + size @ np.abs(T) @ more)
    bounds[~known] = 0.0
    return bounds, known


def _inverse(matrices: Array) -> Array:
    """The inverses of matrices in floats, or zeros when one of them has none: then no bound follows."""
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        return np.zeros_like(matrices)


def departures(beyond: Array, reach: Array, through: Array, change: Array) -> tuple[Array, np.ndarray]:
    """Return d (k, q) with d >= change max(0, beyond + reach + through d), and in which rows this is confirmed.

    beyond (k, q): of either sign; reach (k, q) >= 0, through (q, q) >= 0, change (q,) >= 0. Iterated from 0 with a
    millionth added each time: a feedforward net is done after as many rounds as it has layers, others when they contract.

    >>> d, confirmed = departures(np.array([[0.0, -1.0]]), np.full((1, 2), 0.5), np.array([[0, 0], [0.5, 0]]), np.ones(2))
    >>> d.round(5).tolist(), confirmed.tolist()
    ([[0.5, 0.0]], [True])
    """
    d, confirmed = np.zeros_like(beyond), np.zeros(len(beyond), dtype=bool)
    first, rows = np.full(len(beyond), np.inf), np.arange(len(beyond))
    for _ in range(ROUNDS):
        # All that is not negative is summed first, so that one rounding decides on the sign.
        need = change * np.maximum(beyond[rows] + GUARD * (reach[rows] + d[rows] @ through.T), 0.0)
        confirmed[rows] = np.all(CONFIRMED * need <= d[rows], axis=1)
        most = need.max(axis=1, initial=0.0)
        left = ~confirmed[rows] & (most <= GROWTH * first[rows])
        first[rows] = np.minimum(first[rows], most)
        rows = rows[left]
        d[rows] = GUARD * need[left]
        if not rows.size:
            break
    return d, confirmed


def next_errors(loop: PiecewiseLoop, test: WellPosedness, slopes_: Slopes, law: np.ndarray, E: Array, beyond: Array,
                r: float) -> tuple[Array, Array]:
    """Return bounds on the errors of the next state (k, n) and of the input (k, m) for cells under laws (k,).

    E (k, n): what the state of a cell is off by; beyond (k, q): how far its z, by its law, lie beyond their pieces at most,
    negative within; r: what rounding adds to z, u or the next state.

    Let x^ be the walked and x the true state, |x - x^| <= E, and write the true law as eta = phi(z) = D z + o + delta with
    D, o of the cell's pattern. Subtracting what the pattern's law says at x^,

        z - z^ = Z (x - x^) + W R delta,   u - u^ = G (x - x^) + V R delta,   x+ - x^+ = (A + B G)(x - x^) + B V R delta,

    up to r, with R = (I - D W)^{-1}, which exists because the controller is well posed. delta_i vanishes while z_i is in its
    piece, and beyond it |delta_i| <= change_i times how far, which is at most beyond_i + |z_i - z^_i|. Suppose

        d >= change max(0, beyond + |Z| E + r + |W R| d).

    Then delta -> phi(z) - D z - o, z = z^ + Z (x - x^) + W R delta, takes the box |delta| <= d into itself, continuously, so
    it has a fixed point there (Brouwer). Its z solves the controller's equation at x, and the solution is unique: so it
    is the true one, and |delta| <= d. No unit is assumed to stay in its piece; those with d_i = 0 are proved to.

    Cells for which no such d is found take `_by_slopes`.
    """
    after, inputs = np.empty_like(E), np.empty((len(E), loop.plant.m))
    unsettled = np.zeros(len(E), dtype=bool)
    order = np.argsort(law, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(law[order])) + 1):
        if not rows.size:
            continue
        p = law[rows[0]]
        d, confirmed = departures(beyond[rows], GUARD * (E[rows] @ slopes_.z[p].T + r), slopes_.kink_z[p], slopes_.change[p])
        unsettled[rows] = ~(confirmed & slopes_.known[p])
        inputs[rows] = GUARD * (E[rows] @ slopes_.u[p].T + d @ slopes_.kink_u[p].T + r)
        after[rows] = GUARD * (E[rows] @ slopes_.x[p].T + d @ slopes_.kink_x[p].T + r)
    if unsettled.any():
        farthest = float(np.max(beyond[unsettled], initial=0.0))
        after[unsettled], inputs[unsettled] = _by_slopes(loop, test, E[unsettled].max(axis=0), farthest, r)
    return after, inputs


def _by_slopes(loop: PiecewiseLoop, test: WellPosedness, E: Array, beyond: float, r: float) -> tuple[Array, Array]:
    """Bounds (n,), (m,) from the largest slopes S alone, whatever the pattern (`enclosure.enclose`)."""
    plant, inc = loop.plant, loop.inc
    S, ends, y = lipschitz(inc.activations), slopes(inc.activations), np.abs(plant.C) @ E
    e = (error_from_residual(test, inc.W, ends, GUARD * S * (np.abs(inc.U) @ y), GUARD)
         + error_from_residual(test, inc.W, ends, 2 * S * (beyond + r), GUARD))
    if not np.all(np.isfinite(e)):
        return np.full(plant.n, np.inf), np.full(plant.m, np.inf)
    error = GUARD * (np.abs(inc.K) @ y + np.abs(inc.V) @ e + r)
    return GUARD * (np.abs(plant.A) @ E + np.abs(plant.B) @ error + r), error
