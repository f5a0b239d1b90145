"""The invariance of a region by branch and bound, for every activation."""

from __future__ import annotations

import time

import numpy as np

from ..arrays import Array
from ..claims.invariance import Invariance, Slacks
from ..inc import INC
from ..pieces.covering import covering
from ..plant import Plant
from ..sets import Box
from .branch import greatest, surely_at_least
from .cells import Boxes, Cells, Simplices
from .interval import Law
from .relaxation import Forms, output_forms


def slacks_by_bounds(plant: Plant, inc: INC, claim: Invariance, skip: np.ndarray | None = None, *, most_cells: int = 200_000,
                     seconds: float = 60.0, accuracy: float | None = None) -> Slacks:
    """Return a lower bound on the slack of every half-space over the region; rigorous in floats, whatever ended the search.

    A box is cut into boxes, a polytope into simplices that are proved to cover it. The search ends when every row is
    shown to hold, when one surely fails at a point, or with the budget; or, with an accuracy, when every `least` is
    within that share of the row's terms of the true value.

    skip (k,): rows that need no looking at. Raises NotWellPosedError, and ConvergenceError where a contraction is too weak.

    >>> claim = Invariance(Box([-1.0], [1.0]), Box([-2.0], [2.0]))
    >>> found = slacks_by_bounds(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0), claim, accuracy=1e-6)
    >>> found.least.round(4).tolist(), found.ended
    ([1.0, 1.0, 0.5, 0.5], '')
    """
    start = time.perf_counter()
    law, forms = setting(plant, inc, claim)
    k = forms.constant.size
    rows = np.arange(k) if skip is None else np.flatnonzero(~skip)
    least, reached, points = np.full(k, -np.inf), np.full(k, np.inf), np.full((k, plant.n), np.nan)
    cells = _cells(claim)
    if cells is None:
        return Slacks(least, reached, points, "no simplices were proved to cover the region", 0, time.perf_counter() - start)
    wanted = forms.take(rows)
    gap = None if accuracy is None else accuracy * np.maximum(wanted.constant_size, np.finfo(float).tiny)
    found = greatest(law, wanted, cells, lambda x: np.atleast_1d(claim.region.contains(x.T)), most_cells=most_cells,
                     seconds=seconds, floor=0.0 if accuracy is None else -np.inf, gap=gap)
    least[rows], reached[rows], points[rows] = -found.bound, -found.reached, found.points
    return Slacks(least, reached, points, found.ended, found.cells, time.perf_counter() - start)


def setting(plant: Plant, inc: INC, claim: Invariance) -> tuple[Law, Forms]:
    """Return the controller behind C, and the rows as functions E x + G u - t with their sizes."""
    law, rows, sizes = Law(inc, plant.C), claim.rows(plant), claim.rows(plant, np.abs)
    return law, output_forms(law, rows.E, rows.G, rows.t, sizes.E, sizes.G)


def sure_excess(plant: Plant, inc: INC, claim: Invariance, row: int, point: Array) -> float:
    """Return a lower bound on E x + G u - t of one row at a point (n,), every rounding allowed for.

    >>> claim = Invariance(Box([-1.0], [1.0]))
    >>> round(sure_excess(Plant([[1.5]], [[1.0]]), INC.linear([[0.0]]), claim, 0, np.array([1.0])), 9)
    0.5
    """
    law, forms = setting(plant, inc, claim)
    return surely_at_least(law, forms.take(np.array([row])), point)


def _cells(claim: Invariance) -> Cells | None:
    region = claim.region
    if isinstance(region, Box):
        return Boxes(region.lower[None], region.upper[None])
    corners = covering(region)
    return None if corners is None else Simplices.of(corners)
