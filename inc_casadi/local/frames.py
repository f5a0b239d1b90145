"""Coordinates in which the ellipsoid to be found is about a ball, so that a solver meets numbers near 1."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from .base import Setting, input_rows, state_rows
from .lines import lines

NARROWEST = 1e-12  # share of the largest eigenvalue below which one is not told from zero


def first_frame(setting: Setting) -> Array:
    """Return a square root of P^-1 for the sum P of A'^k (limits'limits) A^k, A the loop as it is around the rest.

    {e'P e <= 1} is invariant under A and keeps every limit, so it has about the shape, if not the size, of what is looked
    for. The limits are the rooms of units, inputs and states. The identity where A is not stable.

    >>> from inc_casadi import INC, Plant, close_loop
    >>> from inc_casadi.claims.attraction import Attraction
    >>> from inc_casadi.local.rest import rest_of
    >>> loop = close_loop(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0))
    >>> first_frame(Setting(loop, Attraction(), rest_of(loop))).round(3).tolist()
    [[0.667]]
    """
    loop = setting.loop
    n = loop.n
    N = law_around_rest(setting)
    A, G, Z = (rows[:, :n] + rows[:, n:] @ N for rows in (loop.F, loop.G, loop.Z))
    modes = np.linalg.eigvals(A)
    if (np.max(np.abs(modes)) if loop.plant.discrete else 1.0 + np.max(modes.real)) >= 1.0:
        return np.eye(n)
    found, (H, h), (states, state_room) = lines(setting), input_rows(setting), state_rows(setting)
    rows = [Z[i] / float(found.room[i]) for i in found.bent]
    rows += [H[i] @ G / float(h[i]) for i in range(len(h))]
    rows += [states[i] / float(state_room[i]) for i in range(len(state_room))]
    limits = np.array(rows).reshape(-1, n)
    weight = limits.T @ limits
    weight = weight + (1e-6 * np.trace(weight) / n if weight.any() else 1.0) * np.eye(n)
    return root_of(_gramian(A, weight, loop.plant.discrete))


def root_of(P: Array) -> Array:
    """Return a square root of P^-1: the frame in which {e'P e <= 1} is the unit ball.

    >>> root_of(np.array([[4.0]])).tolist()
    [[0.5]]
    """
    values, vectors = np.linalg.eigh(P)
    return np.asarray((vectors / np.sqrt(np.maximum(values, NARROWEST * values[-1]))) @ vectors.T)


def law_around_rest(setting: Setting) -> Array:
    """Return N (q, n) with eta~ = N e near the rest, every unit on its near line."""
    loop = setting.loop
    near = np.diag(lines(setting).near.astype(float)).reshape(loop.q, loop.q)
    return np.linalg.solve(np.eye(loop.q) - near @ loop.Z[:, loop.n:], near @ loop.Z[:, : loop.n])


def _gramian(A: Array, weight: Array, discrete: bool) -> Array:
    """Return P with P - A'PA = weight, or -(A'P + PA) = weight."""
    n, eye = len(A), np.eye(len(A))
    operator = np.eye(n * n) - np.kron(A.T, A.T) if discrete else -(np.kron(A.T, eye) + np.kron(eye, A.T))
    P = np.linalg.solve(operator, weight.reshape(-1)).reshape(n, n)
    return (P + P.T) / 2
