"""Which laws cells went through, as a tree: cells that share their first steps share its first nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cutting import Cuts
from .scatter import distinct_rows


@dataclass(frozen=True, eq=False)
class Trails:
    """A tree of steps. Node 0 is the start; node i was reached from `parent[i]` under the law `pattern[i]`.

    patterns (P, q): the patterns in use; parent, pattern (T,): -1 for the start; cuts: for each plane that was made, the
    node its cell was at, the row of its pattern, the bound (of 2q) and the level, (C,) each.
    """

    patterns: np.ndarray
    parent: np.ndarray
    pattern: np.ndarray
    node: np.ndarray
    row: np.ndarray
    bound: np.ndarray
    level: np.ndarray

    @classmethod
    def begin(cls, q: int) -> Trails:
        """Return the tree of one node, before any step.

        >>> Trails.begin(2).parent.tolist()
        [-1]
        """
        none = np.zeros(0, dtype=int)
        return cls(np.zeros((0, q), dtype=int), np.array([-1]), np.array([-1]), none, none, none, np.zeros(0))

    @property
    def depth(self) -> np.ndarray:
        """The number of steps (T,) to each node; parents come before their children."""
        depth = np.zeros(len(self.parent), dtype=int)
        for i in range(1, len(depth)):
            depth[i] = depth[self.parent[i]] + 1
        return depth

    def numbered(self, patterns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return a table that begins with this one's patterns and holds all of (N, q), and the row of each."""
        if patterns.shape[1] == 0:
            return np.zeros((1, 0), dtype=int), np.zeros(len(patterns), dtype=int)
        together = np.concatenate([self.patterns, patterns])
        first, which = distinct_rows(together)
        order = np.argsort(first, kind="stable")
        rank = np.empty(len(order), dtype=int)
        rank[order] = np.arange(len(order))
        return together[first[order]], rank[which[len(self.patterns):]]

    def with_cuts(self, cuts: Cuts, node: np.ndarray) -> Trails:
        """Return the tree with cuts added; node (N,): where each cell was before them."""
        table, row = self.numbered(cuts.patterns)
        return Trails(table, self.parent, self.pattern, np.concatenate([self.node, node[cuts.parent]]),
                      np.concatenate([self.row, row]), np.concatenate([self.bound, cuts.bound]),
                      np.concatenate([self.level, cuts.level]))

    def stepped(self, node: np.ndarray, patterns: np.ndarray) -> tuple[Trails, np.ndarray]:
        """Return the tree after cells at nodes (N,) took a step under patterns (N, q), and their new nodes."""
        table, row = self.numbered(patterns)
        both = np.column_stack([node, row])
        first, which = distinct_rows(both)
        pairs = both[first]
        grown = Trails(table, np.concatenate([self.parent, pairs[:, 0]]), np.concatenate([self.pattern, pairs[:, 1]]),
                       self.node, self.row, self.bound, self.level)
        return grown, len(self.parent) + which
