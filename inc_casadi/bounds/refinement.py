"""Search for cells and trial inputs: a coarse partition, halved in batches where most is to be gained."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from ..plant import Plant
from ..spec import Spec
from .cell_bounds import Trials
from .cells import Cells
from .clock import Clock
from .grid_price import GridPrice
from .halved_cells import Boxes
from .moves import rollout
from .price import Price
from .proposals import Proposal, propose

FIRST_HORIZON = 10
_NUMBERS, _SMALL = 2**22, 2**18  # in one array of a batch: the latter where a batch must not take long
_SPENT = 0.7  # of the time left, what a round may take judging from the rounds before
_LEAST = 0.02  # of the largest gain: cells that promise less wait for the next round


@dataclass(frozen=True, eq=False)
class Search:
    """What is bounded: the plant, P_0, P_1, ... of value iteration, its last gain K, the longest and first horizon, when to
    stop, and what the first inputs cost besides (`cell_bounds`)."""

    plant: Plant
    spec: Spec
    P: Array
    K: Array
    first: int
    last: int
    clock: Clock = Clock()
    price: GridPrice | None = None

    def bounded(self, cells: Cells, which: np.ndarray) -> list[Proposal]:
        """Return trial inputs for the cells numbered `which`, some for several horizons.

        The horizon is doubled for the cells whose states have not yet come to where the limits are never met again. When
        the time is over the rest of them are left out, but for the first batch.
        """
        T, found, pending = self.first, list[Proposal](), which
        numbers = _SMALL if self.clock.is_set else _NUMBERS
        while pending.size:
            batch = max(1, numbers // (T * self.plant.n * (1 + cells.every.spans.shape[1])))
            longer = []
            for part in np.array_split(pending, -(-pending.size // batch)):
                if found and self.clock.is_over:
                    return found
                tail, shapes = self.P[len(self.P) - 1 - T], cells.every.take(part)
                found.append(propose(self.plant, self.spec, tail, part, shapes, T, self._priced(cells, part)))
                longer.append(part[~self._free(cells.every.centers[:, part], found[-1].trials.u)])
            if 2 * T > self.last:
                break
            pending, T = np.concatenate(longer), 2 * T
        return found

    def _priced(self, cells: Cells, which: np.ndarray) -> Price | None:
        return self.price.on(cells, which) if self.price is not None and isinstance(cells, Boxes) else None

    def _free(self, x0: Array, u: Array) -> np.ndarray:
        # Whether the unlimited optimum u = K x keeps the limits for another T steps from where u (T, m, c) leads.
        assert self.spec.inputs is not None
        x = rollout(self.plant.A, self.plant.B, x0, u)[-1]
        free = np.ones(x.shape[1], dtype=bool)
        for _ in range(len(u)):
            free &= self.spec.inputs.contains(self.K @ x)
            x = (self.plant.A + self.plant.B @ self.K) @ x
        return free


@dataclass(frozen=True, eq=False)
class Found:
    """Cells, the trial inputs of the partition's cells by horizon, and the bounds (c,) that they prove."""

    cells: Cells
    trials: tuple[Trials, ...]
    values: Array


def refined(search: Search, cells: Cells, budget: int, tol: float) -> Found:
    """Return trial inputs for a partition that is halved where most is to be gained.

    A cell's gain is its probability times what `propose` estimates. In every round the cells with the largest gains are
    halved, each the way that gains most, until `budget` cells in all have been bounded or all gains together are below
    `tol` times the bound. A round that the time limit cuts is not counted: halves without a bound of their own are worth
    less than the cell.
    """
    began = time.monotonic()
    proposals = search.bounded(cells, cells.leaves)
    while cells.halving and not search.clock.is_over:
        values, gains = _table(proposals, cells)
        spent = time.monotonic() - began
        room = budget if not search.clock.is_set else int(values.size * (1 + _SPENT * search.clock.left / max(spent, 1e-3)))
        chosen = _chosen(cells, values, gains, min(budget, room), tol)
        finer = cells.halved(chosen, np.argmax(gains[:, chosen], axis=0))
        new = np.arange(cells.every.probabilities.size, finer.every.probabilities.size)
        if not new.size:
            break
        more = search.bounded(finer, new)
        if search.clock.is_over:
            break
        cells, proposals = finer, proposals + more
    values, _ = _table(proposals, cells)
    return Found(cells, _best(proposals, values, cells), values[cells.leaves])


def _chosen(cells: Cells, values: Array, gains: Array, budget: int, tol: float) -> np.ndarray:
    leaves, p = cells.leaves, cells.probabilities
    worth = p * gains[:, leaves].sum(axis=0)
    if worth.sum() <= tol * abs(p @ values[leaves]):
        return leaves[:0]
    room = max(0, budget - values.size) // 2
    best = np.argsort(-worth)[:room]
    return leaves[best[worth[best] > _LEAST * worth.max()]]


def _table(proposals: list[Proposal], cells: Cells) -> tuple[Array, Array]:
    # The best bounds (size,) and what halving gains (w, size), by the numbers of the cells.
    size = cells.every.probabilities.size
    values, gains = np.full(size, -np.inf), np.zeros((len(proposals[0].gains), size))
    for each in proposals:
        which = each.trials.members
        better = each.values > values[which]
        values[which[better]], gains[:, which[better]] = each.values[better], each.gains[:, better]
    return values, gains


def _best(proposals: list[Proposal], values: Array, cells: Cells) -> tuple[Trials, ...]:
    # The trial inputs that prove most for each leaf, renumbered by the leaves and joined by horizon.
    place = np.full(values.size, -1)
    place[cells.leaves] = np.arange(cells.leaves.size)
    groups: dict[int, list[Trials]] = {}
    for each in proposals:
        which = each.trials.members
        kept = np.flatnonzero((each.values == values[which]) & (place[which] >= 0))
        some = each.trials.take(kept)
        groups.setdefault(len(some.u), []).append(replace(some, members=place[some.members]))
        place[which[kept]] = -1
    joined = {T: _joined(group) for T, group in sorted(groups.items())}
    return tuple(group for group in joined.values() if group.members.size)


def _joined(trials: list[Trials]) -> Trials:
    return Trials(np.concatenate([each.members for each in trials]), np.concatenate([each.u for each in trials], axis=2),
                  np.concatenate([each.G for each in trials], axis=3))
