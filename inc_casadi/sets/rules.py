"""Quadrature rules with positive weights of sum 1, exact to degree 2 order - 1: cube, Gauss measure, simplex, ball."""

from __future__ import annotations

import operator

import numpy as np

from ..arrays import Array
from ..errors import InvalidInputError

MOST_NODES = 2_000_000
Rule = tuple[Array, Array]


def whole(name: str, value: int, low: int) -> int:
    """Return an integer not below `low`.

    >>> whole("order", 3, 1)
    3
    """
    try:
        result = operator.index(value)
    except TypeError as error:
        raise InvalidInputError(f"{name} must be an integer, but is {value!r}") from error
    if result < low:
        raise InvalidInputError(f"{name} must be at least {low}, but is {result}")
    return result


def legendre(order: int) -> Rule:
    """Return the Gauss-Legendre rule of the uniform distribution on [-1, 1].

    >>> legendre(1)[0].tolist(), legendre(1)[1].tolist()
    ([0.0], [1.0])
    """
    nodes, weights = np.polynomial.legendre.leggauss(whole("order", order, 1))
    return nodes, weights / weights.sum()


def hermite(order: int) -> Rule:
    """Return the Gauss-Hermite rule of the standard normal distribution.

    >>> hermite(2)[0].round(6).tolist()
    [-1.0, 1.0]
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(whole("order", order, 1))
    return nodes, weights / weights.sum()


def jacobi(order: int, alpha: float, beta: float) -> Rule:
    """Return the Gauss-Jacobi rule on [-1, 1] for the density proportional to (1 - t)^alpha (1 + t)^beta.

    >>> jacobi(1, 1, 0)[0].round(6).tolist()
    [-0.333333]
    """
    from scipy.special import roots_jacobi

    nodes, weights = roots_jacobi(whole("order", order, 1), alpha, beta)
    return nodes, weights / weights.sum()


def tensor(rules: list[Rule]) -> Rule:
    """Return the product rule: nodes (len(rules), N) and weights (N,).

    >>> tensor([legendre(2), legendre(3)])[0].shape
    (2, 6)
    """
    refuse_many([len(weights) for _, weights in rules])
    nodes = np.meshgrid(*[nodes for nodes, _ in rules], indexing="ij")
    weights = np.ones(1)
    for _, factor in rules:
        weights = np.multiply.outer(weights, factor).ravel()
    return np.stack([grid.ravel() for grid in nodes]), weights


def simplex(n: int, order: int) -> Rule:
    """Return a rule for the uniform distribution on the n-simplex: barycentric nodes (n + 1, N) and weights (N,).

    Conical product: lambda_1 = t_1, lambda_2 = (1 - t_1) t_2, ... collapses the cube to the simplex, and the Jacobian
    prod_k (1 - t_k)^(n - k) is the weight of a Gauss-Jacobi rule (Stroud, Approximate Calculation of Multiple
    Integrals, 1971).

    >>> simplex(2, 1)[0].round(6).ravel().tolist()
    [0.333333, 0.333333, 0.333333]
    """
    cube, weights = tensor([jacobi(order, n - k, 0.0) for k in range(1, n + 1)])
    t = (1 + cube) / 2
    left = np.vstack([np.ones(t.shape[1]), np.cumprod(1 - t, axis=0)])
    return np.vstack([left[:-1] * t, left[-1]]), weights


def ball(n: int, order: int) -> Rule:
    """Return a rule for the uniform distribution on the unit ball: nodes (n, N) and weights (N,), symmetric about 0.

    Product of a rule on the sphere and a Gauss-Jacobi rule in the squared radius: odd polynomials cancel by symmetry,
    and even ones are polynomials of degree order - 1 in it.

    >>> ball(2, 2)[1].round(6).tolist()
    [0.25, 0.25, 0.25, 0.25]
    """
    directions, sphere_weights = sphere(n, order)
    t, radial_weights = jacobi((order + 1) // 2, 0.0, (n - 2) / 2)
    radius = np.sqrt((1 + t) / 2)
    refuse_many([len(sphere_weights), len(radius)])
    nodes = (directions[:, :, None] * radius).reshape(n, -1)
    return nodes, np.multiply.outer(sphere_weights, radial_weights).ravel()


def sphere(n: int, order: int) -> Rule:
    """Return a symmetric rule for the uniform distribution on the unit sphere of R^n: nodes (n, N), weights (N,).

    From the circle, 2 order equal angles, each further dimension sets x = (t, sqrt(1 - t^2) omega) with a
    Gauss-Gegenbauer rule in t.

    >>> sphere(3, 2)[0].shape
    (3, 8)
    """
    whole("order", order, 1)
    if n == 1:
        return np.array([[-1.0, 1.0]]), np.array([0.5, 0.5])
    refuse_many([2 * order] + [order] * (n - 2))
    angles = np.pi * (np.arange(2 * order) + 0.5) / order
    nodes, weights = np.vstack([np.cos(angles), np.sin(angles)]), np.full(2 * order, 0.5 / order)
    for k in range(3, n + 1):
        t, t_weights = jacobi(order, (k - 3) / 2, (k - 3) / 2)
        rest = np.sqrt(1 - t**2)[:, None] * nodes[:, None, :]
        first = np.repeat(t, nodes.shape[1])
        nodes = np.vstack([first, rest.reshape(k - 1, -1)])
        weights = np.multiply.outer(t_weights, weights).ravel()
    return nodes, weights


def refuse_many(counts: list[int]) -> None:
    """Raise InvalidInputError when a product rule would have more than two million nodes.

    >>> refuse_many([10, 10])
    """
    total = 1
    for count in counts:
        total *= count
    if total > MOST_NODES:
        raise InvalidInputError(
            f"a product quadrature of {total} nodes is too large (at most {MOST_NODES}): lower the order, or use "
            "sample(N, rng) in this dimension"
        )
