"""Which laws lie above and which below the one that holds, piece by piece: all that a max-min expression must know."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import InvalidInputError
from ..pieces.simplices import begin, cut_along
from .pieces import AffinePieces

ROUNDING = 1e-12  # a coefficient that moves u by less than this share of the largest |u| is rounding
ROOM = 1e-11  # a law that passes another by less than this share counts as on both its sides, if that will do
CELLS = 200_000  # how many simplices cutting may make


@dataclass(frozen=True, eq=False)
class Order:
    """The distinct laws l_j of one output, and on cells that fill the pieces the laws above and below the valid one.

    gain (L, p), offset (L,): l_j(y) = gain[j] y + offset[j]; above (N, L), below (N, L): on cell c, whose law is f,
    above[c, j] says that l_j >= f there and below[c, j] that l_j <= f; error: how far beyond, at most, a law so counted lies
    on the wrong side.

    An expression of maxima and minima of the laws is >= f wherever a set of laws is that makes it true, read as "or" and
    "and", and <= f wherever a set of laws is without which it is false. So one that is true with above[c] true and all
    others false, and false with below[c] false and all others true, equals f on cell c up to `error`; when this is so for
    all cells, it equals f on all pieces: sufficient, and necessary on cells where no l_j - f changes sign.
    """

    gain: Array
    offset: Array
    above: np.ndarray
    below: np.ndarray
    error: float

    def __len__(self) -> int:
        return len(self.offset)


def order(pieces: AffinePieces, output: int, tol: float) -> Order:
    """Return the distinct laws of an output and their order on cells, cut until an expression exists.

    Laws that differ by at most tol on the hull of the pieces are one; a law that passes f by at most tol counts as on both
    sides. An expression exists if and only if above[c] and below[d] have a law in common for all cells c, d: then
    max over c of min over above[c] is one. For f continuous on a convex union this holds when no l_j - f changes sign on
    c or d: on the segment from x in c to y in d some law of a piece has l_j(x) >= f(x) and l_j(y) <= f(y), so l_j >= f on
    all of c and l_j <= f on all of d. Pieces as they come need not be such cells, and in two dimensions or more their own
    max-min form may then be wrong; but most do, so only cells that contradict one another are cut, along all l_j = f.

    Raises InvalidInputError when more than 200 000 cells would be needed, or the laws contradict each other.

    Notes
    -----
    The lattice form on convex domains: J. M. Tarela, M. V. Martinez, Math. Comput. Modelling 30, 1999, for regions in each
    of which the order of all laws is one, as are S. Ovchinnikov's (2002); here only the order relative to f need be.
    """
    gain, offset, _ = distinct_laws(pieces, output, tol)
    laws = np.column_stack([gain * pieces.widths, offset + gain @ pieces.origin])
    size = float(np.abs(pieces.values()[:, :, output]).max())
    # Rounding alone asks for far less room than tol, and what room is used is error.
    found = _sides(pieces, output, laws, min(tol, ROOM * size)) or _sides(pieces, output, laws, tol)
    if found is None:
        raise InvalidInputError(f"output {output} is no continuous function on a convex set: the laws of some pieces "
                                f"contradict each other by more than tol = {tol:.3g}")
    return Order(gain, offset, *found)


def distinct_laws(pieces: AffinePieces, output: int, tol: float) -> tuple[Array, Array, np.ndarray]:
    """Return the laws (L, p), (L,) of an output that differ by more than tol on the hull, and which each piece has (k,)."""
    gain, offset = pieces.gain[:, output], pieces.offset[:, output]
    size = float(np.abs(pieces.values()[:, :, output]).max())
    far = np.abs(pieces.origin) + pieces.widths
    gain = np.where(np.abs(gain) * far <= ROUNDING * size, 0.0, gain)
    values = (gain * pieces.widths) @ pieces.points.T + (offset + gain @ pieces.origin)[:, None]
    first: list[int] = []
    which = np.empty(len(gain), dtype=int)
    for i, row in enumerate(values):
        found = np.flatnonzero(np.abs(values[first] - row).max(axis=1, initial=0.0) <= tol)
        if not found.size:
            first.append(i)
        which[i] = found[0] if found.size else len(first) - 1
    return gain[first], offset[first], which


def contradictory(above: np.ndarray, below: np.ndarray) -> np.ndarray:
    """Return the cells (N,) for which above or below has no law in common with below or above of some cell.

    >>> contradictory(np.array([[True, False], [True, True]]), np.array([[True, True], [False, True]])).tolist()
    [True, True]
    """
    tops, top = np.unique(above, axis=0, return_inverse=True)
    lows, low = np.unique(below, axis=0, return_inverse=True)
    apart = tops.astype(np.float32) @ lows.T.astype(np.float32) == 0
    return np.asarray(apart.any(axis=1)[top.reshape(-1)] | apart.any(axis=0)[low.reshape(-1)])


def _sides(pieces: AffinePieces, output: int, laws: Array, room: float) -> tuple[np.ndarray, np.ndarray, float] | None:
    """The laws above and below f on cells, and by how much at most they are not; None when they contradict."""
    own = pieces.laws[pieces.owner, output]
    gap = _gaps(pieces.corners, laws, own)
    clash = contradictory(gap.min(axis=1) >= -room, gap.max(axis=1) <= room)
    if clash.any():
        gap = np.concatenate([gap[~clash], _cut_gaps(pieces.corners[clash], laws, own[clash], room)])
    low, high = gap.min(axis=1), gap.max(axis=1)
    above, below = low >= -room, high <= room
    if contradictory(above, below).any():
        return None
    beyond = max(float(np.where(above, -low, 0.0).max()), float(np.where(below, high, 0.0).max()), 0.0)
    return above, below, beyond


def _cut_gaps(corners: Array, laws: Array, own: Array, room: float) -> Array:
    # Simplices cut along l_j = f for all j: l_j - f at the vertices of the parts.
    cells = begin(corners, np.ones(len(corners)))
    for law in laws:
        height = _gaps(cells.now, law[None], own)[:, :, 0]
        cells, origin, _ = cut_along(cells, np.where(np.abs(height) <= room, 0.0, height))
        own = own[origin]
        if len(own) > CELLS:
            raise InvalidInputError(f"more than {CELLS} cells are needed to order {len(laws)} laws")
    return _gaps(cells.now, laws, own)


def _gaps(points: Array, laws: Array, own: Array) -> Array:
    # l_j - f at the vertices: (N, p + 1, L).
    away = laws[None] - own[:, None]
    return points @ np.swapaxes(away[:, :, :-1], 1, 2) + away[:, None, :, -1]
