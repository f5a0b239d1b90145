"""Polytopes with an affine law each, collected from what describes them, in coordinates of size one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, matrix, vector
from ..brief import Brief
from ..errors import DimensionError, EmptySetError, InvalidInputError
from ..pieces.regions import Regions
from ..sets import Box, Polytope

Piece = tuple[Box | Polytope, ArrayLike, ArrayLike]

FLAT = 1e-9  # a region of `Regions` narrower than this share of the whole is rounding


@dataclass(frozen=True, eq=False)
class AffinePieces(Brief):
    """k polytopes in R^p and the affine law u = gain y + offset on each; shapes are kept over z = (y - origin) / widths.

    gain (k, m, p), offset (k, m): as given; number (k,): what each piece was called.
    corners (N, p + 1, p), owner (N,): simplices that fill the pieces, and whose each is; facets (F, p, p), facet_of (F,):
    simplices that fill their boundaries; planes (H, p + 1), plane_of (H,): (a, b) with a z <= b, |a| = 1, one per facet.
    """

    gain: Array
    offset: Array
    number: np.ndarray
    corners: Array
    owner: np.ndarray
    facets: Array
    facet_of: np.ndarray
    planes: Array
    plane_of: np.ndarray
    origin: Array
    widths: Array

    def __len__(self) -> int:
        return len(self.gain)

    @property
    def p(self) -> int:
        """The dimension of y."""
        return self.gain.shape[2]

    @property
    def m(self) -> int:
        """The number of outputs."""
        return self.gain.shape[1]

    @property
    def laws(self) -> Array:
        """The laws (k, m, p + 1) over (z, 1)."""
        return np.concatenate([self.gain * self.widths, (self.offset + self.gain @ self.origin)[:, :, None]], axis=2)

    @property
    def points(self) -> Array:
        """All corners (M, p), each once."""
        return np.unique(self.corners.reshape(-1, self.p), axis=0)

    def values(self) -> Array:
        """Return u (N, p + 1, m) of each simplex's own law at its corners."""
        return at(self.laws[self.owner], self.corners)

    def original(self, z: Array) -> Array:
        """Return points z (..., p) in the units of y."""
        return self.origin + self.widths * z


def at(laws: Array, z: Array) -> Array:
    """Return the values (N, c, m) of laws (N, m, p + 1) at points z (N, c, p).

    >>> at(np.array([[[2.0, 1.0]]]), np.array([[[3.0]]])).tolist()
    [[[7.0]]]
    """
    return z @ np.swapaxes(laws[:, :, :-1], 1, 2) + laws[:, None, :, -1]


def collected(pieces: Sequence[Piece] | Regions) -> AffinePieces:
    """Return the pieces of a sequence of (set, gain, offset), or of what `regions` found.

    Raises InvalidInputError and DimensionError with the number of the piece that does not fit.

    >>> found = collected([(Box([-1.0], [0.0]), [[-1.0]], [0.0]), (Box([0.0], [3.0]), [[1.0]], [0.0])])
    >>> len(found), found.origin.tolist(), found.widths.tolist(), found.laws.tolist()
    (2, [1.0], [2.0], [[[-2.0, -1.0]], [[2.0, 1.0]]])
    """
    if isinstance(pieces, Regions):
        return _of_regions(pieces)
    if not isinstance(pieces, Sequence) or not pieces:
        raise InvalidInputError("pieces must be what `regions` returned or a sequence of (polytope, gain, offset), at least "
                                f"one, not {pieces!r}")
    gains, offsets = [], []
    for i, piece in enumerate(pieces):
        if not isinstance(piece, Sequence) or len(piece) != 3 or not isinstance(piece[0], Box | Polytope):
            raise InvalidInputError(f"piece {i} must be (Box or Polytope, gain, offset), not {piece!r}")
        gains.append(matrix(f"gain of piece {i}", piece[1], (None, piece[0].dimension)))
        offsets.append(vector(f"offset of piece {i}", piece[2], gains[i].shape[0]))
        if gains[i].shape != gains[0].shape:
            raise DimensionError(f"gain of piece {i} has shape {gains[i].shape}, but that of piece 0 has {gains[0].shape}")
    if 0 in gains[0].shape:
        raise DimensionError(f"gain of piece 0 has shape {gains[0].shape}, but a law needs an output and a measurement")
    simplices = [each.simplices() for each, _, _ in pieces]
    owner = np.repeat(np.arange(len(pieces)), [len(each) for each in simplices])
    return _shaped(np.array(gains), np.array(offsets), np.concatenate(simplices), owner, np.arange(len(pieces)))


def _of_regions(found: Regions) -> AffinePieces:
    if found.ended:
        raise InvalidInputError(f"the regions are not complete: {found.ended} ended the search for them")
    if not len(found):
        raise InvalidInputError("there are no regions")
    low, high = found.simplices.min(axis=(0, 1)), found.simplices.max(axis=(0, 1))
    centers = np.array([found.simplices[found.which == i].mean(axis=(0, 1)) for i in range(len(found))])
    spread = (found.simplices - centers[found.which][:, None]) / (high - low)
    narrow = np.array([np.linalg.svd(spread[found.which == i].reshape(-1, spread.shape[2]), compute_uv=False)[-1]
                       for i in range(len(found))]) <= FLAT
    kept = np.flatnonzero(~narrow)
    rows = ~narrow[found.which]
    place = np.cumsum(~narrow) - 1
    return _shaped(found.G[kept], found.g[kept], found.simplices[rows], place[found.which[rows]], kept)


def _shaped(gain: Array, offset: Array, simplices: Array, owner: np.ndarray, number: np.ndarray) -> AffinePieces:
    low, high = simplices.min(axis=(0, 1)), simplices.max(axis=(0, 1))
    origin, widths = (low + high) / 2, (high - low) / 2
    corners = (simplices - origin) / widths
    shapes = [_boundary(corners[owner == i].reshape(-1, len(origin)), int(number[i])) for i in range(len(gain))]
    facets, planes = zip(*shapes, strict=True)
    turn = np.arange(len(gain))
    return AffinePieces(gain, offset, number, corners, owner, np.concatenate(facets), np.repeat(turn, [*map(len, facets)]),
                        np.concatenate(planes), np.repeat(turn, [*map(len, planes)]), origin, widths)


def _boundary(points: Array, number: int) -> tuple[Array, Array]:
    # The facets (F, p, p) of the hull, cut into simplices, and its half-spaces (H, p + 1).
    points = np.unique(points, axis=0)
    if points.shape[1] == 1:
        return np.array([points[:1], points[-1:]]), np.array([[-1.0, -points[0, 0]], [1.0, points[-1, 0]]])
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError as error:
        raise EmptySetError(f"piece {number} is flat within the union of all pieces: Qhull finds no hull") from error
    equations = np.unique(hull.equations.round(12), axis=0)
    return points[hull.simplices], np.column_stack([equations[:, :-1], -equations[:, -1]])
