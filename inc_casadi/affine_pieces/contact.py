"""How pieces lie to each other: do they fill their convex hull, and do their laws agree where they meet?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import InvalidInputError
from ..pieces.simplices import begin
from ..sets import Polytope, simplex
from .clipping import clipped, touches
from .pieces import AffinePieces, at

CRUMB = 1e-12  # a share of the hull's volume that is rounding


@dataclass(frozen=True, eq=False)
class Contacts:
    """Where pieces meet: the largest jump of u, and all pairs that share a face or overlap.

    jump: in the units of u; first, second: the two pieces; output; point (p,): where. pairs (P, 2): pieces with a face in
    common. With one piece there is no jump: 0, and both pieces are 0.
    """

    jump: float
    first: int
    second: int
    output: int
    point: Array
    pairs: np.ndarray

    def require(self, tol: float) -> None:
        """Raise InvalidInputError when the laws jump by more than tol."""
        if self.jump > tol:
            raise InvalidInputError(
                f"the law is not continuous: pieces {self.first} and {self.second} meet at y = {self.point.tolist()}, where "
                f"output {self.output} jumps by {self.jump:.6g}, more than tol = {tol:.3g}")


def contacts(pieces: AffinePieces) -> Contacts:
    """Return where pieces meet and the largest jump there.

    The facets of every piece are cut along the faces of every other one; what lies within it is a face that they share, or
    the part of one's boundary inside the other. Laws are affine, so their difference is largest at the vertices of those
    parts, and where two pieces overlap those hold all vertices of the overlap.
    """
    laws = pieces.laws
    whole = begin(pieces.facets, np.ones(len(pieces.facets)))
    worst, pairs = Contacts(0.0, 0, 0, 0, pieces.original(pieces.corners[0, 0]), np.zeros((0, 2), int)), []
    for k in range(len(pieces)):
        planes, mine = pieces.planes[pieces.plane_of == k], pieces.corners[pieces.owner == k]
        near = np.flatnonzero(touches(whole, mine.min(axis=(0, 1)), mine.max(axis=(0, 1))) & (pieces.facet_of != k))
        if not near.size:
            continue
        shared, facet, _, _ = clipped(whole.take(near), near, planes)
        other = pieces.facet_of[facet]
        pairs.append(np.unique(np.column_stack([np.minimum(other, k), np.maximum(other, k)]), axis=0))
        gap = np.abs(at(laws[other] - laws[k], shared.now))
        if gap.size and gap.max() > worst.jump:
            row, corner, output = np.unravel_index(int(gap.argmax()), gap.shape)
            low, high = sorted((int(pieces.number[k]), int(pieces.number[other[row]])))
            worst = Contacts(float(gap.max()), low, high, int(output), pieces.original(shared.now[row, corner]), worst.pairs)
    joined = np.unique(np.concatenate([worst.pairs, *pairs]), axis=0)
    return Contacts(worst.jump, worst.first, worst.second, worst.output, worst.point, joined)


def require_convex(pieces: AffinePieces) -> None:
    """Raise InvalidInputError, with a point, when the pieces leave out a part of their convex hull.

    The hull is cut along the faces of each piece in turn and what lies within is taken away; what is left in the end is in
    no piece. Gaps narrower than 1e-7 of the whole are taken for rounding. The pieces may overlap.
    """
    hull = Polytope.from_vertices(pieces.points.T).simplices()
    sizes = simplex.volumes(hull)
    left = begin(hull, sizes / sizes.sum())
    for k in range(len(pieces)):
        mine = pieces.corners[pieces.owner == k]
        near = touches(left, mine.min(axis=(0, 1)), mine.max(axis=(0, 1)))
        outside = clipped(left.take(near), np.flatnonzero(near), pieces.planes[pieces.plane_of == k])[2]
        left = left.take(~near).joined(outside)
    if np.any(left.weight > CRUMB):
        point = pieces.original(left.centroids()[int(left.weight.argmax())])
        raise InvalidInputError(
            f"the pieces must fill a convex set, but y = {point.tolist()} lies between them, in none; "
            f"{left.weight.sum():.3g} of the volume of their hull is left out: there is a gap, or their union is not convex")
