"""What an ellipsoid is made as large as possible in, as data for a solver: its volume, or its reach along directions."""

from __future__ import annotations

from math import ceil, log2

import numpy as np
from numpy.typing import NDArray

from .affine import Affine
from .arrays import Array
from .claims.attraction import Attraction
from .lmi_problem import Block
from .multipliers.base import Unknown

Places = dict[str, NDArray[np.intp]]


def diagonal(places: NDArray[np.intp]) -> Affine:
    """Return the diagonal matrix of the unknowns at places (k,).

    >>> diagonal(np.array([1, 0])).at(np.array([2.0, 3.0])).tolist()
    [[3.0, 0.0], [0.0, 2.0]]
    """
    square = np.full((places.size,) * 2, -1)
    np.fill_diagonal(square, places)
    return Affine.unknown(square)


def corner(block: Affine, size: int, row: int, column: int) -> Affine:
    """Return a matrix of zeros of the size but for a block with its first entry at (row, column).

    >>> corner(Affine.unknown(np.array([[0]])), 2, 0, 1).at(np.array([5.0])).tolist()
    [[0.0, 5.0], [0.0, 0.0]]
    """
    height, width = block.shape
    return np.eye(size, height, -row) @ block @ np.eye(size, width, -column).T


def goal_unknowns(claim: Attraction, n: int) -> list[Unknown]:
    """Return what `goal` needs besides X: L and the tower for a volume, tau for directions; tower[0] is the mean t.

    >>> [unknown.shape for unknown in goal_unknowns(Attraction(), 3)]
    [(3, 3), (3,)]
    """
    if claim.directions is not None:
        return [Unknown("tau", (1 if claim.shape == "reach" else claim.directions.shape[1],), "free")]
    upper = ~np.tri(n, dtype=bool)
    return [Unknown("L", (n, n), "free", zero=upper), Unknown("tower", (2 ** ceil(log2(n)) - 1 or 1,), "free")]


def goal(claim: Attraction, root: Array, places: Places, size: int) -> tuple[list[Block], Array]:
    """Return the blocks and the cost (size,) of what is maximized, for X = root X^ root' with X^ at places["X"].

    The volume is maximized through det X >= prod l_i <=> [X, L; L', diag l] >= 0 for some lower triangular L with diagonal
    l, and the geometric mean t of l by a tower of 2 x 2 matrices; the scale s along d by [tau, d'; d, X] >= 0, with tau =
    s^-2 as small as it can be.

    >>> places = {"X": np.array([[0]]), "L": np.array([[1]]), "tower": np.array([2])}
    >>> blocks, cost = goal(Attraction(), np.eye(1), places, 3)
    >>> len(blocks), cost.tolist()
    (2, [0.0, 0.0, -1.0])
    """
    cost, X = np.zeros(size), Affine.unknown(places["X"])
    if claim.directions is None:
        cost[places["tower"][0]] = -1.0
        return _volume(X, places), cost
    cost[places["tau"]] = 1.0
    aims = np.linalg.solve(root, claim.directions)
    blocks = []
    for j, aim in enumerate(aims.T):
        tau = Affine.unknown(places["tau"][[[j if claim.shape == "mean" else 0]]])
        n = len(aim)
        edge = np.zeros((n + 1, n + 1))
        edge[0, 1:] = edge[1:, 0] = aim
        blocks.append((corner(tau, n + 1, 0, 0) + corner(X, n + 1, 1, 1) + edge).block(np.eye(n + 1)))
    return blocks, cost


def _volume(X: Affine, places: Places) -> list[Block]:
    """Return [X, L; L', diag l] >= 0 and the tower t_k <= sqrt(t_2k+1 t_2k+2) on the l_i, with t_0 in free places."""
    n, L = X.shape[0], places["L"]
    whole = (corner(X, 2 * n, 0, 0) + 2.0 * corner(Affine.unknown(L), 2 * n, 0, n)
             + corner(diagonal(np.diag(L)), 2 * n, n, n))
    tower = places["tower"]
    feet = [*tower, *np.diag(L), *(tower[0],) * n]
    blocks = [whole.block(np.eye(2 * n))]
    for k in range(tower.size):
        pair = np.array([[feet[2 * k + 1], feet[k]], [feet[k], feet[2 * k + 2]]])
        blocks.append(Affine.unknown(pair).block(np.eye(2)))
    return blocks
