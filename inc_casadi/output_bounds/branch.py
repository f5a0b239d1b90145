"""Branch and bound: the largest value of functions of state and input over a region, hundreds of cells at a time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from .cells import Boxes, Cells
from .interval import Law
from .relaxation import Forms, upper_bounds

BATCH = 512
RESOLUTION = 1e-11  # an excess over the target below this share of a function's constant is not pursued
NUMBERS = 4_000_000  # about how many numbers one array of a batch may hold

Inside = Callable[[Array], np.ndarray]


@dataclass(frozen=True, eq=False)
class Found:
    """Upper bounds (k,) on the functions over the region, and the largest values (k,) met at points (k, n) of it.

    The bounds hold whatever ended the search; `ended` is "" when every cell was settled, else why some were not.
    refuted: the function that surely exceeds its target at its point, or None.
    """

    bound: Array
    reached: Array
    points: Array
    cells: int
    ended: str
    refuted: int | None = None


@dataclass
class _Best:
    """The largest values met so far, and where."""

    values: Array
    points: Array

    def look(self, values: Array, points: Array) -> None:
        """Take in values (k, M) at points (M, n)."""
        if points.size == 0:
            return
        top = values.argmax(axis=1)
        found = values[np.arange(len(top)), top]
        better = found > self.values
        self.values[better], self.points[better] = found[better], points[top[better]]


def greatest(law: Law, forms: Forms, cells: Cells, inside: Inside, *, most_cells: int = 200_000, seconds: float = 60.0,
             floor: float = 0.0, gap: Array | None = None) -> Found:
    """Return upper bounds on the functions over the region that the cells cover.

    A cell is settled when no function can exceed its target on it: `floor`, or, where a point exceeds that already, the
    value met plus `gap`; all others are halved and bounded again, the worst first. With gap None the search ends as soon
    as a point surely exceeds the floor. With floor = -inf and a gap, the bounds end up within it of the true maxima.

    inside: which points (M, n) lie in the region. The bounds rest on `upper_bounds` alone, so they are rigorous at
    every moment; budgets decide only how good they are.

    >>> from inc_casadi import INC
    >>> from inc_casadi.output_bounds.relaxation import output_forms
    >>> one = np.eye(1)
    >>> law = Law(INC(np.zeros((2, 2)), [[1.0], [-1.0]], [[1.0, -1.0]], [[-1.0]]), one)  # u = 0, written awkwardly
    >>> forms = output_forms(law, 0 * one, one, np.full(1, 0.01), 0 * one, one)
    >>> found = greatest(law, forms, Boxes(-one, one), lambda x: np.abs(x[:, 0]) <= 1.0)
    >>> bool(found.bound[0] <= 0.0), found.ended, found.reached.round(9).tolist()
    (True, '', [-0.01])
    """
    clock, best = time.monotonic(), _Best(np.full(len(forms.constant), -np.inf), np.full(forms.direct.shape, np.nan))
    search = _Search(law, forms, inside, floor, gap, best, np.full(len(forms.constant), -np.inf))
    widths = np.maximum(cells.high.max(axis=0) - cells.low.min(axis=0), 1e-300)
    known, ended, refuted = np.full((len(cells), len(forms.constant)), np.inf), "", None
    while True:
        cells, known = search.unsettled(cells, known)
        if len(cells) == 0 or ended or refuted is not None:
            break
        order = np.argsort(-(known - search.target).max(axis=1), kind="stable")
        now, later = np.split(order, [_batch(law, known.shape[1])])
        batch, weight, bound = search.bounded(cells.take(now), known[now])
        refuted = search.refuted()
        ended = _exhausted(batch, len(later), search.done, most_cells, clock, seconds)
        if len(batch) and not ended and search.is_finest(np.concatenate([bound, known[later]])):
            ended = "what is open holds or fails by less than rounding can tell"
        halves = batch.halves(weight, widths) if len(batch) else batch
        cells, known = halves.joined(cells.take(later)), np.concatenate([bound, bound, known[later]])
    bound = np.concatenate([search.settled[None], known]).max(axis=0)
    return Found(bound, best.values, best.points, search.done, ended, refuted)


@dataclass
class _Search:
    """What is asked, the largest values met so far, the largest bound over settled cells, and how many were bounded."""

    law: Law
    forms: Forms
    inside: Inside
    floor: float
    gap: Array | None
    best: _Best
    settled: Array
    done: int = 0

    @property
    def target(self) -> Array:
        return np.maximum(self.floor, self.best.values + (0.0 if self.gap is None else self.gap))

    def unsettled(self, cells: Cells, known: Array) -> tuple[Cells, Array]:
        """Take out the cells where no function can exceed its target, and keep the largest of their bounds."""
        small: np.ndarray = np.all(known <= self.target, axis=1)
        if small.any():
            self.settled = np.maximum(self.settled, known[small].max(axis=0))
        return cells.take(~small), known[~small]

    def bounded(self, batch: Cells, known: Array) -> tuple[Cells, Array, Array]:
        """Bound a batch anew and look at its points; return what stays open, what each coordinate costs, the bounds."""
        rows = np.flatnonzero(np.any(known > self.target, axis=0))
        found = upper_bounds(self.law, self.forms.take(rows), batch)
        bound = known.copy()
        bound[:, rows] = np.minimum(bound[:, rows], found.bound)
        points = batch.points().reshape(-1, self.law.C.shape[1])
        points = points[self.inside(points)]
        self.best.look(values_at(self.law, self.forms, points), points)
        self.done += len(batch)
        still = np.any(bound > self.target, axis=1)
        left, bound = self.unsettled(batch, bound)
        return left, found.weight[still] @ np.abs(self.law.drive), bound

    def refuted(self) -> int | None:
        """The function that surely exceeds the floor at its point, where that ends the search."""
        if self.gap is not None or not np.any(self.best.values > self.floor):
            return None
        return _refuted(self.law, self.forms, self.best, self.floor)

    def is_finest(self, bound: Array) -> bool:
        """Whether all bounds exceed their targets by rounding at most."""
        return bool(np.all(bound - self.target <= RESOLUTION * self.forms.constant_size))


def _exhausted(open_: Cells, waiting: int, done: int, most_cells: int, clock: float, seconds: float) -> str:
    left = len(open_) + waiting
    if left == 0:
        return ""
    if done >= most_cells:
        return f"{left} cells are open after {done}, and the budget is {most_cells}"
    if time.monotonic() - clock > seconds:
        return f"{left} cells are open after the time limit of {seconds:g} s"
    if not open_.divisible().all():
        return "a cell is too small to be halved once more"
    return ""


def _batch(law: Law, k: int) -> int:
    """How many cells at once: arrays of (cells, k, q) and (cells, q, q) numbers are kept moderate."""
    return int(np.clip(NUMBERS // max(1, law.inc.q * max(k, law.inc.q)), 16, BATCH))


def values_at(law: Law, forms: Forms, points: Array) -> Array:
    """Return the functions (k, M) at points (M, n), in floats.

    >>> from inc_casadi import INC
    >>> from inc_casadi.output_bounds.relaxation import output_forms
    >>> law, one = Law(INC.saturated([[2.0]], 1.0), np.eye(1)), np.eye(1)
    >>> values_at(law, output_forms(law, one, one, np.zeros(1), one, one), np.array([[0.25], [3.0]])).tolist()
    [[0.75, 4.0]]
    """
    eta = law.inc.solve(law.C @ points.T).eta
    return forms.direct @ points.T + forms.hidden @ eta + forms.constant[:, None]


def _refuted(law: Law, forms: Forms, best: _Best, floor: float) -> int | None:
    """The function whose value at its point exceeds the floor, with every rounding and the residual of eta allowed for."""
    worst = int(np.argmax(best.values))
    return worst if surely_at_least(law, forms.take(np.array([worst])), best.points[worst]) > floor else None


def surely_at_least(law: Law, form: Forms, point: Array) -> float:
    """Return a lower bound on one function at a point (n,): its bounds over the box that is this point.

    >>> from inc_casadi import INC
    >>> from inc_casadi.output_bounds.relaxation import output_forms
    >>> law, one = Law(INC.saturated([[2.0]], 1.0), np.eye(1)), np.eye(1)
    >>> form = output_forms(law, 0 * one, one, np.zeros(1), 0 * one, one)
    >>> 0.5 - 1e-9 < surely_at_least(law, form, np.array([0.25])) <= 0.5
    True
    """
    cell = Boxes(point[None], point[None])
    return -float(upper_bounds(law, form.negative(), cell, tightenings=0).bound[0, 0])
