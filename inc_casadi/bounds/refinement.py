"""Search for cells and trial inputs: a coarse partition, halved in batches where most is to be gained."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from ..plant import Plant
from ..spec import Spec
from .cell_bounds import Trials
from .cells import Cells
from .moves import rollout
from .proposals import Proposal, propose

FIRST_HORIZON = 10
_NUMBERS = 2**22  # in one array of a batch
_LEAST = 0.02  # of the largest gain: cells that promise less wait for the next round


@dataclass(frozen=True, eq=False)
class Search:
    """What is bounded: the plant, P_0, P_1, ... of value iteration, its last gain K, and the longest and first horizon."""

    plant: Plant
    spec: Spec
    P: Array
    K: Array
    first: int
    last: int

    def bounded(self, cells: Cells, which: np.ndarray) -> list[Proposal]:
        """Return trial inputs for the cells numbered `which`, some for several horizons.

        The horizon is doubled for the cells whose states have not yet come to where the limits are never met again.
        """
        T, found, pending = self.first, [], which
        while pending.size:
            batch = max(1, _NUMBERS // (T * self.plant.n * (1 + cells.every.spans.shape[1])))
            parts = np.array_split(pending, -(-pending.size // batch))
            found += [propose(self.plant, self.spec, self.P[len(self.P) - 1 - T], part, cells.every.take(part), T)
                      for part in parts]
            if 2 * T > self.last:
                break
            pending = np.concatenate([part[~self._free(cells.every.centers[:, part], each.trials.u)]
                                      for part, each in zip(parts, found[-len(parts):], strict=True)])
            T *= 2
        return found

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
    `tol` times the bound.
    """
    proposals = search.bounded(cells, cells.leaves)
    while cells.halving:
        values, gains = _table(proposals, cells)
        chosen = _chosen(cells, values, gains, budget, tol)
        finer = cells.halved(chosen, np.argmax(gains[:, chosen], axis=0))
        new = np.arange(cells.every.probabilities.size, finer.every.probabilities.size)
        if not new.size:
            break
        cells = finer
        proposals += search.bounded(cells, new)
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
