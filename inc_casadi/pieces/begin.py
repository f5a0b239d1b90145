"""Where the motions of a walk begin: in a region of the state space, or in one of fewer dimensions with the rest fixed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

import numpy as np

from ..arrays import Array
from ..sets import Box, Polytope
from .cells import Cells, whole
from .places import Places, placed


@final
@dataclass(frozen=True, eq=False)
class Begin:
    """The states (x_0, beside) with x_0 in a region of R^k, and `beside` (l,) the same for all of them; k + l = n.

    Cells are cut in the coordinates of x_0 alone, R^k, wherever their points are in R^n: they are carried as vertices and as
    the affine map from x_0, and neither asks that the map be square. So the flat set costs what a set in R^k costs.

    >>> begin = Begin(Box([-1.0], [1.0]), np.array([3.0]))
    >>> begin.cells().start.tolist(), begin.cells().now.tolist()
    ([[-1.0], [1.0]], [[-1.0, 3.0], [1.0, 3.0]])
    """

    region: Box | Polytope
    beside: Array

    def cells(self) -> Cells:
        """Return the cells at rest, `now` and `motion` with the coordinates beside."""
        cells, l = whole(self.region), self.beside.size
        fixed = np.zeros((len(cells), l, cells.motion.shape[2]))
        fixed[:, :, -1] = self.beside
        return replace(cells, now=np.hstack([cells.now, np.tile(self.beside, (len(cells.now), 1))]),
                       motion=np.concatenate([cells.motion, fixed], axis=1))

    def maps(self) -> tuple[Places, Places]:
        """Return F (n, k) and f (n,) of the first states F x_0 + f, with 256 places.

        >>> [part.shape for part in Begin(Box([-1.0], [1.0]), np.array([3.0, 4.0])).maps()]
        [(3, 1), (3,)]
        """
        k, l = self.region.dimension, self.beside.size
        return placed(np.eye(k + l, k)), placed(np.concatenate([np.zeros(k), self.beside]))


def begin_of(region: Box | Polytope) -> Begin:
    """Return the beginning where all coordinates are free.

    >>> begin_of(Box([-1.0], [1.0])).beside.size
    0
    """
    return Begin(region, np.zeros(0))
