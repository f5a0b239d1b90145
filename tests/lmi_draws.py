"""Random semidefinite programs with every kind of term and all sizes different; every draw takes its generator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from inc_casadi.lmi_problem import Block, Problem, Term


def symmetric_index(n, first=0):
    """The indices of a symmetric n x n unknown, numbered from `first`, and the number that follows."""
    index = np.zeros((n, n), int)
    index[np.triu_indices(n)] = first + np.arange(n * (n + 1) // 2)
    return np.maximum(index, index.T), first + n * (n + 1) // 2


def diagonal_index(n, first=0):
    """The indices of a diagonal n x n unknown, -1 off the diagonal, and the number that follows."""
    index = np.full((n, n), -1)
    index[np.arange(n), np.arange(n)] = first + np.arange(n)
    return index, first + n


def terms(rng, N, first=0):
    """Terms of every kind in a block of size N: symmetric (left = right, -right / 2, or another), diagonal, full."""
    P, after = symmetric_index(3, first)
    D, after = diagonal_index(4, after)
    T, after = symmetric_index(2, after)
    G, after = after + np.arange(6).reshape(2, 3), after + 6
    L, R = rng.normal(size=(N, 3)), rng.normal(size=(N, 3))
    drawn = (Term(P, L, L), Term(P, -0.5 * R, R), Term(D, rng.normal(size=(N, 4)), rng.normal(size=(N, 4))),
             Term(T, rng.normal(size=(N, 2)), rng.normal(size=(N, 2))),
             Term(G, rng.normal(size=(N, 2)), rng.normal(size=(N, 3))))
    return drawn, after


def matrices(block, size):
    """The coefficient matrices A_e (size, N, N), formed explicitly."""
    return np.array([block.value(e) - block.constant for e in np.eye(size)])


def feasible(rng, *, rows=3, bounds=4, spread=0.0, depth=1.0, box=np.inf):
    """A problem with a strictly feasible y and a strictly feasible dual point, so that its optimum is attained.

    spread: decades by which the sizes of the blocks and rows differ; depth: size of the slacks at that y.
    """
    first, after = terms(rng, 7)
    second, size = terms(rng, 5, after)
    second = (*second, Term(np.array([[0]]), rng.normal(size=(5, 1)), rng.normal(size=(5, 1))))
    y, cost, blocks = rng.normal(size=size), np.zeros(size), []
    for N, drawn in ((7, first), (5, second)):
        linear, root, dual = Block(np.zeros((N, N)), drawn), rng.normal(size=(N, 2)), rng.normal(size=(N, N))
        scale = 10.0 ** rng.uniform(-spread, spread)
        C = depth * (root @ root.T + 0.1 * np.eye(N)) - linear.value(y)
        cost += np.einsum("eij,ij->e", matrices(linear, size), dual @ dual.T)
        blocks.append(Block(scale * C, tuple(replace(term, left=scale * term.left) for term in drawn)))
    G, scales = rng.normal(size=(rows, size)), 10.0 ** rng.uniform(-spread, spread, size=rows)
    cost += G.T @ rng.uniform(0, 1, rows)
    lower, upper = np.full(size, -box), np.full(size, box)
    low, high = rng.permutation(size)[:bounds], rng.permutation(size)[:bounds]
    lower[low], upper[high] = y[low] - depth * rng.uniform(0, 1, bounds), y[high] + depth * rng.uniform(0, 1, bounds)
    cost[low] += rng.uniform(0, 1, bounds)
    cost[high] -= rng.uniform(0, 1, bounds)
    offset = scales * (depth * rng.uniform(0, 1, rows) - G @ y)
    return Problem(cost, tuple(blocks), scales[:, None] * G, offset, lower, upper)


def loop(rng, n=3, q=5, radius=0.8, discount=0.95, gain=0.05):
    """The discounted cost of a random stable loop with q sector-[0, 1] units: minimize trace P over P and a diagonal l >= 0.

    P >= 0 and X'PX - discount F'PF - X'X - M(l) >= 0, M(l) = He(H' diag(l) (Z - H)).
    """
    A = rng.normal(size=(n, n))
    A *= radius / np.max(np.abs(np.linalg.eigvals(A)))
    W = rng.normal(size=(q, q))
    W *= 0.5 / np.max(np.abs(W).sum(axis=1), initial=1e-9)
    F = np.hstack([A, gain * rng.normal(size=(n, q)) / np.sqrt(max(n * q, 1))])
    Z = np.hstack([rng.normal(size=(q, n)) / np.sqrt(n), W])
    X, H = np.eye(n, n + q), np.eye(q, n + q, n)
    P, first = symmetric_index(n)
    index, size = diagonal_index(q, first)
    decay = Block(-X.T @ X, (Term(P, X.T, X.T), Term(P, -discount * F.T, F.T), Term(index, -2 * H.T, (Z - H).T)))
    cost, lower = np.zeros(size), np.full(size, -np.inf)
    cost[np.diag(P)], lower[first:] = 1.0, 0.0
    positive = Block(np.zeros((n, n)), (Term(P, np.eye(n), np.eye(n)),))
    return Problem(cost, (positive, decay), np.zeros((0, size)), np.zeros(0), lower, np.full(size, np.inf))
