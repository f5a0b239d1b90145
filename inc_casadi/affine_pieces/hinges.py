"""Hinging hyperplanes: an affine law and one kink for each hyperplane that runs through all pieces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from .order import ROUNDING
from .pieces import AffinePieces, at

SAME = 1e-7  # hyperplanes (a, b), |a| = 1, closer than this are one; what is made of them is checked
WHOLE = 1e-12  # a weight this near to a whole number is one


@dataclass(frozen=True, eq=False)
class Hinges:
    """One output as f(y) = gain y + offset + sum_h weight_h relu(slope_h y + shift_h), and how far it is off at most.

    gain (p,), offset; planes (H,): which rows of the table of hyperplanes; weight (H,).
    """

    gain: Array
    offset: float
    planes: np.ndarray
    weight: Array
    error: float


@dataclass(frozen=True, eq=False)
class Hyperplanes:
    """All hyperplanes across which an output has a kink, s(y) = slope y + shift, and on which side of each the pieces are.

    slope (H, p), shift (H,); side (k, H): 1 where s >= 0 on the piece and 0 where s <= 0; crossed (H,): some piece has both
    signs by more than tol; excess (k, H): by how much at most |relu(s) - side s| is not 0 on the piece.
    """

    slope: Array
    shift: Array
    side: np.ndarray
    crossed: np.ndarray
    excess: Array


def hyperplanes(pieces: AffinePieces, pairs: np.ndarray, tol: float) -> Hyperplanes:
    """Return the hyperplanes on which laws of pieces that share a face are equal; pairs (P, 2).

    s is the difference of the two laws in the output where it is largest, so that its weight there is 1 or -1. Of several
    pairs on one hyperplane that with the largest difference is taken.
    """
    laws = pieces.laws
    jump = laws[pairs[:, 1]] - laws[pairs[:, 0]]
    change = np.linalg.norm(jump[:, :, :-1], axis=2)
    output = change.argmax(axis=1)
    rows = np.arange(len(pairs))
    kept = np.flatnonzero(change[rows, output] > ROUNDING * np.abs(pieces.values()).max())
    kept = kept[np.argsort(-change[kept, output[kept]], kind="stable")]
    unit = jump[kept, output[kept]] / change[kept, output[kept], None]
    first: list[int] = []
    for i, row in enumerate(unit):
        known = unit[first]
        apart = np.minimum(np.abs(known - row).max(axis=1), np.abs(known + row).max(axis=1))
        if not (apart <= SAME).any():
            first.append(i)
    chosen = kept[first]
    low, high, picked = pairs[chosen, 0], pairs[chosen, 1], output[chosen]
    slope = pieces.gain[high, picked] - pieces.gain[low, picked]
    shift = pieces.offset[high, picked] - pieces.offset[low, picked]
    return _with_sides(pieces, slope, shift, tol)


def hinged(pieces: AffinePieces, table: Hyperplanes, output: int, tol: float) -> Hinges | None:
    """Return an output as hinging hyperplanes, or None when it is none to within tol.

    On a piece that no hyperplane crosses each relu(s_h) is 0 or s_h. So f = c + sum_h w_h relu(s_h) on all pieces if and
    only if law_i = c + sum_h side_ih w_h s_h for each of them: linear equations in c and w, solved by least squares. The
    affine part is then read off one piece, so that nothing is lost where few kinks act, and all pieces are compared at
    their vertices, which is complete. Hyperplanes that cross a piece take no part: f, affine there, has no kink on them.

    Source of the form: L. Breiman, Hinging hyperplanes, IEEE Trans. Inf. Theory 39(3), 1993.
    """
    free = np.flatnonzero(~table.crossed)
    kinks = _scaled(pieces, table)[free]
    size = np.linalg.norm(kinks, axis=1)
    k, width = len(pieces), pieces.p + 1
    acting = np.swapaxes(table.side[:, free, None] * (kinks / size[:, None]), 1, 2).reshape(k * width, len(free))
    system = np.hstack([acting, np.tile(np.eye(width), (k, 1))])
    weight = np.linalg.lstsq(system, pieces.laws[:, output].reshape(-1), rcond=None)[0][: len(free)] / size
    weight = np.where(np.abs(weight - weight.round()) <= WHOLE, weight.round(), weight)
    used = np.abs(weight) * size > tol
    return _with_affine_part(pieces, table, free[used], weight[used], output, tol)


def _with_affine_part(pieces: AffinePieces, table: Hyperplanes, used: np.ndarray, weight: Array, output: int,
                      tol: float) -> Hinges | None:
    side = table.side[:, used]
    start = int(side.sum(axis=1).argmin())
    gain = pieces.gain[start, output] - (side[start] * weight) @ table.slope[used]
    offset = float(pieces.offset[start, output] - (side[start] * weight) @ table.shift[used])
    mine = np.column_stack([gain + (side * weight) @ table.slope[used], offset + (side * weight) @ table.shift[used]])
    z = np.column_stack([mine[:, :-1] * pieces.widths, mine[:, -1] + mine[:, :-1] @ pieces.origin])
    away = np.abs(at((z - pieces.laws[:, output])[pieces.owner, None], pieces.corners)[:, :, 0]).max()
    error = float(away + (table.excess[:, used] @ np.abs(weight)).max(initial=0.0))
    return Hinges(gain, offset, used, weight, error) if error <= tol else None


def _with_sides(pieces: AffinePieces, slope: Array, shift: Array, tol: float) -> Hyperplanes:
    bare = Hyperplanes(slope, shift, np.zeros((0, 0)), np.zeros(0, bool), np.zeros((0, 0)))
    kinks = _scaled(pieces, bare)
    height = pieces.corners @ kinks[:, :-1].T + kinks[:, -1]
    low, high = np.full((len(pieces), len(shift)), np.inf), np.full((len(pieces), len(shift)), -np.inf)
    np.minimum.at(low, pieces.owner, height.min(axis=1))
    np.maximum.at(high, pieces.owner, height.max(axis=1))
    side = high >= -low
    excess = np.maximum(np.where(side, -low, high), 0.0)
    return Hyperplanes(slope, shift, side.astype(int), np.asarray((excess > tol).any(axis=0)), excess)


def _scaled(pieces: AffinePieces, table: Hyperplanes) -> Array:
    # s over (z, 1): (H, p + 1).
    return np.column_stack([table.slope * pieces.widths, table.shift + table.slope @ pieces.origin])
