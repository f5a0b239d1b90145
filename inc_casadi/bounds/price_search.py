"""Search for a price on foreseeing: dual ascent on a grid of the initial states. Nothing here is trusted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..plant import Plant
from ..sets import Box
from ..spec import Spec
from .clock import Clock
from .grid_price import GridPrice
from .halved_cells import Boxes
from .halvings import Halvings
from .information import first_shown, information_price, unseen
from .proposals import propose
from .sequences import factor

_ROUNDS = 12
_LONGER, _SHORTER = 1.5, 0.3  # what a step that raises the bound is followed by, and one that does not
_LEAST = 1e-3  # steps below are not worth a round


def best_price(plant: Plant, spec: Spec, P: Array, T: int, parts: int, clock: Clock) -> tuple[GridPrice, Boxes] | None:
    """Return a price on a grid of at most `parts` parts, and the grid as boxes; None where no coordinate is hidden.

    The bound is concave in the price, and what the least u_k leaves to be desired is a subgradient: the best price makes
    it, in the mean over what is hidden, a function of what is known. So offsets move along u_k less its mean over what is
    hidden, slopes along the slopes of u_k, both in units of the second derivative of the cost without limits. The sum over
    the parts with the same y_0 is a concave function of their own prices, so each such sum has a step of its own, longer
    after a step that raised it and undone otherwise.

    P : (n, n) weight of the last state after T moves
    """
    assert isinstance(spec.initial.support, Box) and spec.inputs is not None
    first = information_price(plant, spec, P)[:T]
    if not len(first):
        return None
    cells = _grid(plant, spec.initial.support, P, first, parts)
    price = _started(plant, cells, first)
    which = cells.leaves[np.argsort(price.parts(cells, cells.leaves))]
    scales, same = _scales(plant, spec, P, T, len(first)), _same_measurement(price)
    steps, best, values = np.ones(same.max() + 1), price, np.full(same.max() + 1, -np.inf)
    moves = price.offsets, price.slopes
    for _ in range(_ROUNDS):
        found = propose(plant, spec, P, which, cells.every.take(which), T, price.on(cells, which))
        sums = np.bincount(same, found.values)
        better = sums > values
        values = np.where(better, sums, values)
        here = better[same]
        best = replace(best, offsets=np.where(here, price.offsets, best.offsets),
                       slopes=np.where(here, price.slopes, best.slopes))
        u, G = found.trials.u[:len(first)], found.trials.G[:len(first)]
        offsets, slopes = _ascent(best, scales, u, G)
        moves = np.where(here, offsets, moves[0]), np.where(here, slopes, moves[1])
        steps *= np.where(better, _LONGER, _SHORTER)
        if np.all(steps < _LEAST) or clock.is_over:
            break
        price = replace(best, offsets=best.offsets + steps[same] * moves[0], slopes=best.slopes + steps[same] * moves[1])
    return best, cells


def _ascent(price: GridPrice, scales: Array, u: Array, G: Array) -> tuple[Array, Array]:
    wanted = price.centered(u)
    along = np.where(price.hidden[:, None, :, None], G, 0.0)
    return np.einsum("kij,kjc->kic", scales, wanted), np.einsum("kij,kjnc->kinc", scales, along)


def _grid(plant: Plant, box: Box, P: Array, first: Array, parts: int) -> Boxes:
    # Halved where it is longest, judging coordinates that y_0 determines by what they cost and others by their price.
    known = np.all(unseen(plant)[0] == 0, axis=1)
    hidden = first_shown(plant) > 0
    width = box.upper - box.lower
    weight = np.einsum("kmi,kmi->i", first, first)
    lengths = np.where(known, width * np.sqrt(np.maximum(np.diag(P), 0.0)), 0.0) / (np.linalg.norm(
        width[known] * np.sqrt(np.maximum(np.diag(P)[known], 0.0))) or 1.0)
    lengths += np.where(hidden, width * np.sqrt(weight) / (np.linalg.norm(width * np.sqrt(weight)) or 1.0), 0.0)
    cells = Boxes(box, Halvings.none(1))
    while 2 * cells.leaves.size <= parts and np.any(lengths > 0):
        axis = int(np.argmax(lengths))
        lengths[axis] /= 2
        cells = cells.halved(cells.leaves, np.full(cells.leaves.size, axis))
    return cells


def _started(plant: Plant, cells: Boxes, first: Array) -> GridPrice:
    # Slopes alone, the same everywhere; the offsets make up for the centers.
    G = cells.leaves.size
    counts = np.rint(1 / cells.shares[cells.leaves[0], 1]).astype(int)
    price = GridPrice(plant, cells.box, counts, np.zeros((*first.shape[:2], G)), np.repeat(first[..., None], G, axis=3))
    centers = np.stack(np.unravel_index(np.arange(G), tuple(counts)))
    away = ((centers + 0.5) / counts[:, None] - 0.5) * (cells.box.upper - cells.box.lower)[:, None]
    return replace(price, offsets=first @ away)


def _scales(plant: Plant, spec: Spec, P: Array, T: int, r: int) -> Array:
    # The second derivatives (r, m, m) of the cost to go without limits in the first inputs.
    assert spec.inputs is not None
    free = factor(plant, spec, P, spec.inputs.H, np.zeros((T, len(spec.inputs.H), 1)))
    return np.linalg.pinv(free.inverses[:r, 0], hermitian=True)


def _same_measurement(price: GridPrice) -> np.ndarray:
    # For each part the number of its part of what y_0 determines.
    known = np.all(unseen(price.plant)[0] == 0, axis=1)
    places = np.stack(np.unravel_index(np.arange(price.offsets.shape[2]), tuple(price.counts)))
    kept = tuple(np.where(known, price.counts, 1))
    return np.ravel_multi_index(tuple(np.where(known[:, None], places, 0)), kept)
