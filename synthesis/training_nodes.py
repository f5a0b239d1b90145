"""Where training starts its rollouts, and how long they are."""

from __future__ import annotations

import numpy as np

from inc_casadi.arrays import Array
from inc_casadi.errors import InvalidInputError
from inc_casadi.plant import Plant
from inc_casadi.sets import Distribution, Empirical
from inc_casadi.spec import Spec

COARSE, FINE, JUDGE = 130, 400, 900  # most nodes of the first phase, the last phase, and the judge
LIFTED_COARSE, LIFTED_FINE = 25, 50  # the same for the lifted form, whose NLP grows with them
_MOST_VERTICES = 64
_MOST_JUDGED = 20_000  # nodes of a quadrature that is finer than the one trained on


def default_horizon(plant: Plant, spec: Spec, K: Array) -> int:
    """Return the steps in which sqrt(beta) (A + B K) contracts to a hundredth, within 15 and 50.

    >>> from inc_casadi import Box
    >>> default_horizon(Plant(0.9, 1.0), Spec(Q=1.0, R=1.0, discount=1.0, initial=Box(-1, 1)), np.zeros((1, 1)))
    44
    """
    radius = np.sqrt(spec.discount) * float(np.max(np.abs(np.linalg.eigvals(plant.A + plant.B @ K))))
    return int(np.clip(np.ceil(np.log(0.01) / np.log(radius)), 15, 50)) if 0 < radius < 1 else 15


def nodes_of(initial: Distribution, budget: int, seed: int, order: int | None = None) -> tuple[Array, Array]:
    """Return nodes (n, N) and weights (N,): the quadrature of this order, or the finest that a budget allows.

    Where a budget allows less than three points per axis, `budget` random nodes serve better.

    >>> from inc_casadi import Box, Uniform
    >>> nodes_of(Uniform(Box([0, 0], [1, 1])), 30, seed=0)[1].size
    25
    """
    if order is not None:
        return initial.quadrature(order)
    if isinstance(initial, Empirical) and initial.weights.size <= budget:
        return initial.quadrature(1)
    for points in range(int(min(round(budget ** (1 / initial.dimension)), 40)), 2, -1):
        try:
            nodes, weights = initial.quadrature(points)
        except InvalidInputError:
            continue  # too many nodes
        if weights.size <= budget:
            return nodes, weights
    return initial.sample(budget, np.random.default_rng(seed)), np.full(budget, 1 / budget)


def finer(initial: Distribution, order: int | None) -> int | None:
    """Return the order of a quadrature that shares no more than the middle with one of this order, for who judges by it.

    None, for a budget of nodes, where it would have too many: they grow with the power of the axes along which x_0 varies.

    >>> from inc_casadi import Box, Uniform
    >>> finer(Uniform(Box([0, 0], [1, 1])), 3), finer(Uniform(Box(np.zeros(7), np.ones(7))), 3)
    (7, None)
    """
    if order is None:
        return None
    axes = int(np.linalg.matrix_rank(initial.covariance))
    return 2 * order + 1 if (2 * order + 1) ** axes <= _MOST_JUDGED else None


def with_corners(initial: Distribution, nodes: Array, weights: Array) -> tuple[Array, Array]:
    """Return nodes (n, N) and weights (N,) with the vertices of the initial set behind them, without weight.

    >>> from inc_casadi import Box, Uniform
    >>> with_corners(Uniform(Box([0], [1])), np.array([[0.5]]), np.ones(1))[1].tolist()
    [1.0, 0.0, 0.0]
    """
    corners = _corners(initial)
    return np.hstack([nodes, corners]), np.concatenate([weights, np.zeros(corners.shape[1])])


def _corners(initial: Distribution) -> Array:
    try:
        vertices = initial.vertices
    except InvalidInputError:
        return np.zeros((initial.dimension, 0))
    return vertices if vertices.shape[1] <= _MOST_VERTICES else np.zeros((initial.dimension, 0))
