"""What ties the moves of a time-invariant linear controller to each other, and how a lower bound makes use of it."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..pieces.linear import identity
from ..plant import Plant
from .exact_anchors import Span, pivoted
from .frame import Frame
from .measured import Rows


def hidden_states(plant: Plant) -> np.ndarray:
    """Return a basis Z (n, q) of Fractions of the states that one measurement does not show: C Z = 0, q = n - rank C.

    The moves of a time-invariant controller are u_k = Y_k x_0 + d_k with Y_k = sum_{j<=k} T_j C A^{k-j}, the same T_j for
    all k (`affine_moves`). So, with Y_{-1} = 0,

        Y_k - Y_{k-1} A = T_k C   for some T_k,   or   (Y_k - Y_{k-1} A) Z = 0,   k = 0, 1, ...

    and these linear equations in the moves say the same as the sums: T_k is what is left to choose at step k.

    >>> hidden_states(Plant([[1.1, 1.0], [0.0, 0.9]], [[0.2], [0.5]], C=[[2.0, 1.0]])).astype(float).tolist()
    [[-0.5], [1.0]]
    """
    C = exact(plant.C)
    shown = Span(C, pivoted(plant.C))
    others = [j for j in range(plant.n) if j not in shown.basis]
    Z, shares = identity(plant.n, C)[:, others], shown.coefficients(C[:, others])
    assert shares is not None  # every column of C is a combination of those in the basis
    Z[shown.basis] = -shares
    return Z


def tying_forces(ties: np.ndarray, Z: np.ndarray, A: np.ndarray) -> np.ndarray:
    """Return F (N, m, n) with sum_k <F_k, Y_k> = sum_k <L_k, (Y_k - Y_{k-1} A) Z> for all Y, L = ties (N, m, q).

    F_k = L_k Z' - L_{k+1} Z'A', L_N = 0. For tied moves the sum is zero, so that F may be added to any linear function
    of them; multipliers L of either sign are allowed. Floats or Fractions.

    >>> tying_forces(np.array([[[1.0]], [[2.0]]]), np.array([[0.0], [1.0]]), np.array([[1.1, 1.0], [0.0, 0.9]])).tolist()
    [[[-2.0, -0.8]], [[0.0, 2.0]]]
    """
    forces = ties @ Z.T
    return forces - np.concatenate([forces[1:], 0 * forces[:1]]) @ A.T


def spans_everything(anchors: Array) -> bool:
    """Return whether anchors (n, a) span the whole space and not a hyperplane, well beyond rounding.

    Then values at the anchors fix all of Y_k, hidden states included, which is what makes ties count.

    >>> spans_everything(np.eye(2)), spans_everything(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    (False, True)
    """
    n = len(anchors)
    return Frame(Rows(np.eye(n), 0.0), anchors).rank == n + 1


def ties_count(plant: Plant, anchors: Array, moves: int) -> bool:
    """Return whether ties restrict these moves beyond the rows they may use, and can be used.

    >>> square = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
    >>> seen = [Plant(np.eye(2), np.ones((2, 1)), C=C) for C in (None, [[1.0, 2.0]])]
    >>> [ties_count(plant, square, N) for plant in seen for N in (1, 2)]
    [False, False, False, True]
    """
    return moves > 1 and not plant.full_state and hidden_states(plant).shape[1] > 0 and spans_everything(anchors)
