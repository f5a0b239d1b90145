"""Branch and bound over boxes of gains: those of the least bound are halved first, many at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from ..arrays import Array
from ..linear.static_gain import StaticGain
from .gain_box import FirstBox
from .gain_cells import CellBounds, cell_bounds, halved, placed
from .gain_limits import GainLimits
from .halvings import Halvings

_BATCH = 512  # boxes that are halved at a time
_DEEPEST = 48  # halvings of one axis; deeper boxes are not told apart by floats

Better = Callable[[CellBounds, StaticGain], StaticGain]  # the best gain known, given new bounds and the best one before
Progress = Callable[[str], None]


@dataclass(frozen=True)
class Patience:
    """When to stop: relative gap, number of boxes, wall time in seconds."""

    gap: float
    cells: int
    seconds: float


@dataclass(frozen=True, eq=False)
class Branched:
    """What branch and bound came to: all cuts, the least bound of the boxes never cut, and the best gain known."""

    record: Halvings
    value: float
    best: StaticGain


@dataclass(frozen=True, eq=False)
class _Front:
    # Boxes that may still be cut: numbers, places, bounds, and the axes along which they should be cut.
    numbers: np.ndarray
    places: np.ndarray
    values: Array
    axes: np.ndarray

    def chosen(self, which: np.ndarray) -> _Front:
        return _Front(self.numbers[which], self.places[which], self.values[which], self.axes[which])

    def joined(self, other: _Front) -> _Front:
        pairs = ((self.numbers, other.numbers), (self.places, other.places), (self.values, other.values),
                 (self.axes, other.axes))
        return _Front(*(np.concatenate(pair) for pair in pairs))


def branch(limits: GainLimits, box: FirstBox, best: StaticGain, patience: Patience, better: Better,
           say: Progress) -> Branched:
    """Return bounds over ever smaller boxes, until none is below the best cost times 1 - gap or patience is at an end.

    Parameters
    ----------
    best : a gain that is known, or any of infinite cost
    better : called with the bounds of each batch, to improve it
    say : called with a line of progress
    """
    begun, record, closed = perf_counter(), Halvings.none(1), np.inf
    places = np.zeros((1, 2, box.lower.size), dtype=np.int64)
    front, best = _measured(limits, box, (np.zeros(1, dtype=int), places), best, patience.gap, better)
    while True:
        done = (front.values >= best.cost * (1 - patience.gap)) | np.any(front.places[:, 0] >= _DEEPEST, axis=1)
        closed = min(closed, float(np.min(front.values[done], initial=np.inf)))
        front = front.chosen(~done & (front.values < closed))  # where the least bound can still rise
        least = min(closed, float(np.min(front.values, initial=np.inf)))
        cells = 1 + len(record.cut)
        say(f"{cells} boxes, {len(front.values)} of them open: at least {least:.7g}, at most {best.cost:.7g}")
        if not len(front.values) or cells >= patience.cells or perf_counter() - begun > patience.seconds:
            return Branched(record, least, best)
        order, many = np.argsort(front.values, kind="stable"), min(_BATCH, patience.cells - cells)
        cut, front = front.chosen(order[:many]), front.chosen(order[many:])
        numbers = record.size + np.arange(2 * len(cut.numbers))
        record = record.more(cut.numbers, cut.axes)
        places = np.stack(halved(cut.places, cut.axes), axis=1).reshape(-1, *cut.places.shape[1:])
        found, best = _measured(limits, box, (numbers, places), best, patience.gap, better)
        front = front.joined(found)


def _measured(limits: GainLimits, box: FirstBox, cells: tuple[np.ndarray, np.ndarray], best: StaticGain, gap: float,
              better: Better) -> tuple[_Front, StaticGain]:
    numbers, places = cells
    bounds = cell_bounds(limits, *placed(box, places), best.cost * (1 - gap))
    return _Front(numbers, places, bounds.value, np.argmax(bounds.lost, axis=1)), better(bounds, best)
