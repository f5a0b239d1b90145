"""The order in which a law is evaluated: layers that read earlier units only, and loops that must be solved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...activations.stack import groups
from ...inc import INC


@dataclass(frozen=True)
class Stage:
    """The units first, ..., last - 1, which read the units low, ..., high - 1 before them and, in a loop, each other."""

    first: int
    last: int
    low: int
    high: int
    loop: bool

    @property
    def size(self) -> int:
        """Number of units."""
        return self.last - self.first

    @property
    def own(self) -> slice:
        """Its units."""
        return slice(self.first, self.last)

    @property
    def read(self) -> slice:
        """The earlier units that it reads."""
        return slice(self.low, self.high)


def arranged(inc: INC) -> tuple[INC, tuple[Stage, ...]]:
    """Return the same law with its hidden units in the order of evaluation, and the stages of that order.

    Units that no output depends on are left out. The strongly connected components of the graph of W (unit i reads j
    where W_ij != 0) are the smallest sets that must be solved together. A component is ready when all it reads is done;
    all ready components of a single unit that does not read itself make one layer, any other component makes a loop.
    Within a stage units of one activation stand side by side.

    >>> inc = INC([[0.0, 0.5, 0.0], [0.5, 0.0, 0.0], [1.0, 0.0, 0.0]], [[1.0]] * 3, [[0.0, 0.0, 1.0]], [[0.0]])
    >>> [(stage.size, stage.loop, stage.low, stage.high) for stage in arranged(inc)[1]]
    [(2, True, 0, 0), (1, False, 0, 1)]
    """
    inc = inc.without_idle_units()
    sets = _ordered(inc.W)
    group = np.zeros(inc.q, dtype=int)
    for number, (_, rows) in enumerate(groups(inc.activations)):
        group[rows] = number
    sets = [(rows[np.argsort(group[rows], kind="stable")], loop) for rows, loop in sets]
    order = np.concatenate([rows for rows, _ in sets]) if sets else np.zeros(0, dtype=int)
    W = inc.W[np.ix_(order, order)]
    law = INC(W, inc.U[order], inc.V[:, order], inc.K, inc.b[order], inc.d, tuple(inc.activations[i] for i in order))
    ends = np.concatenate([[0], np.cumsum([rows.size for rows, _ in sets])]).astype(int)
    return law, tuple(_stage(W, int(ends[k]), int(ends[k + 1]), loop) for k, (_, loop) in enumerate(sets))


def _ordered(W: np.ndarray) -> list[tuple[np.ndarray, bool]]:
    """Layers and loops in an order in which each reads only earlier ones and, in a loop, itself."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    reads = W != 0
    if W.size == 0:
        return []
    count, label = connected_components(csr_array(reads), directed=True, connection="strong")
    member = label[:, None] == np.arange(count)
    between = (member.T.astype(int) @ reads @ member) > 0
    loops = np.diag(between).copy()  # a component of several units reads itself, a single unit only where W_ii != 0
    np.fill_diagonal(between, False)
    done, sets = np.zeros(count, dtype=bool), []
    while not done.all():
        ready = ~done & ~np.any(between & ~done[None, :], axis=1)
        single = ready & ~loops
        if single.any():
            sets.append((np.flatnonzero(single[label]), False))
        else:
            sets += [(np.flatnonzero(label == k), True) for k in np.flatnonzero(ready)]
        done |= single if single.any() else ready
    return sets


def _stage(W: np.ndarray, first: int, last: int, loop: bool) -> Stage:
    used = np.flatnonzero(np.any(W[first:last, :first] != 0, axis=0))
    low, high = (int(used[0]), int(used[-1]) + 1) if used.size else (0, 0)
    return Stage(first, last, low, high, loop)
