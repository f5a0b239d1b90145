"""Cut the initial distribution into cells of known probability and mean."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..sets import Box, Distribution, Empirical, Polytope, Uniform
from .cells import Cells, Cloud, Points
from .halved_cells import Boxes, Simplices
from .halvings import Halvings


def partition(initial: Distribution, cells: int, weight: Array | None = None) -> Cells:
    """Return at most about `cells` cells of the distribution, at least one.

    A box is halved along its axes and a polytope, cut into simplices, along their edges, always at the longest; finitely
    many points are each their own cell; see `cloud` for all else.

    Parameters
    ----------
    cells : >= 1; finitely many points all count, and so do the simplices of a polytope, however many
    weight : W (n, n) >= 0, which makes d'W d the squared length of d; None for one that makes the distribution round

    >>> from inc_casadi import Box, Uniform
    >>> partition(Uniform(Box([0, 0], [1, 1])), 5).centroids.tolist()
    [[0.25, 0.25, 0.75, 0.75], [0.25, 0.75, 0.25, 0.75]]
    """
    found: Cells
    if isinstance(initial, Empirical):
        return Points(initial)
    if isinstance(initial, Uniform) and isinstance(initial.support, Box):
        found = Boxes(initial.support, Halvings.none(1))
    elif isinstance(initial, Uniform) and isinstance(initial.support, Polytope):
        roots = initial.support.simplices()
        found = Simplices(roots, Halvings.none(len(roots)))
    else:
        return Cloud(initial, cells)
    W = np.linalg.pinv(initial.covariance, hermitian=True) if weight is None else weight
    while 2 * found.leaves.size <= cells:
        ways = found.shapes.ways
        found = found.halved(found.leaves, np.argmax(np.einsum("iwc,ij,jwc->wc", ways, W, ways, optimize=True), axis=0))
    return found
