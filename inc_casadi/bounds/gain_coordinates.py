"""State coordinates in which bounds on gains are sharp, and by how much rounding changes the plant written in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..linear.lyapunov import discounted_sum
from ..plant import Plant
from ..spec import Spec
from .moves import UNIT

_FLOOR = 1e-6  # smallest eigenvalue of the scaled second moment that is told apart from zero


@dataclass(frozen=True, eq=False)
class Matrices:
    """A, B, C, Q and S0 in coordinates z of x = T z; slack bounds their relative errors in Frobenius norm."""

    A: Array
    B: Array
    C: Array
    Q: Array
    S0: Array
    slack: float


def written(plant: Plant, spec: Spec, T: Array | None) -> Matrices:
    """Return T^-1 A T, T^-1 B, C T, T'Q T and T^-1 S0 T^-T; T (n, n) is invertible, or None for the identity.

    T = D V with powers of two D, with which everything is scaled exactly. For A^ near V^-1 A V the error is
    V^-1 (A V - V A^), whose norm is bounded by that of the residual; so for B and S0.

    Raises
    ------
    numpy.linalg.LinAlgError : T is singular

    >>> from inc_casadi import Box, Plant, Spec
    >>> plant, spec = Plant([[0.5, 1.0], [0.0, 0.5]], [[0.0], [1.0]]), Spec(np.eye(2), 1.0, 1.0, Box([-1, -1], [1, 1]))
    >>> found = written(plant, spec, np.diag([2.0, 1.0]))
    >>> found.A.tolist(), found.C.tolist(), found.slack < 1e-13
    ([[0.5, 0.5], [0.0, 0.5]], [[2.0, 0.0], [0.0, 1.0]], True)
    """
    A, B, C, Q, S0 = plant.A, plant.B, plant.C, spec.Q, spec.initial.second_moment
    if T is None:
        return Matrices(A, B, C, Q, S0, 0.0)
    D = np.ldexp(1.0, np.round(np.log2(np.linalg.norm(T, axis=1))).astype(int))[:, None]
    V = T / D
    A, B, C, Q, S0 = A * D.T / D, B / D, C * D.T, Q * D * D.T, S0 / D / D.T
    K, n = np.linalg.inv(V), plant.n
    size, unit, tiny = np.linalg.norm, 8 * n * UNIT, np.finfo(float).tiny
    left = float(size(np.eye(n) - K @ V) + unit * size(K) * size(V))
    inverse, wide = size(K) / max(1 - left, tiny), size(V)
    A1, B1, C1, Q1, S1 = K @ A @ V, K @ B, C @ V, V.T @ Q @ V, K @ S0 @ K.T
    S1 = (S1 + S1.T) / 2
    wrong = [
        inverse * (size(A @ V - V @ A1) + unit * wide * (size(A) + size(A1))) / (size(A1) + tiny),
        np.max(inverse * (size(B - V @ B1, axis=0) + unit * (size(B, axis=0) + wide * size(B1, axis=0)))
               / (size(B1, axis=0) + tiny)),  # column by column, row by row: units of inputs and outputs do not matter
        np.max(unit * size(C, axis=1) * wide / (size(C1, axis=1) + tiny)),
        unit * wide**2 * size(Q) / (size(Q1) + tiny),
        inverse**2 * (size(S0 - V @ S1 @ V.T) + unit * (size(S0) + wide**2 * size(S1))) / (size(S1) + tiny)]
    return Matrices(A1, B1, C1, Q1, S1, 2 * float(max(wrong)))


def balanced(plant: Plant, spec: Spec, F: Array) -> Array:
    """Return T with T T' = sum_k beta^k (A + BFC)^k S0 (A + BFC)'^k, the states that the cost of F counts; regularized.

    In these coordinates that sum is the identity, so the remainders of cells near F are weighed as the cost weighs
    them. Where it diverges S0 is taken.

    >>> from inc_casadi import Box, Plant, Spec
    >>> balanced(Plant(1.5, 1.0), Spec(1.0, 0.0, 1.0, Box(-1, 1)), np.array([[-1.0]])).round(6).tolist()  # (4/9)^(1/2)
    [[0.666667]]
    """
    S0 = spec.initial.second_moment
    S = discounted_sum((plant.A + plant.B @ F @ plant.C).T, S0, spec.discount)
    S = S0 if S is None else S
    scale = np.sqrt(np.diag(S))
    scale = np.where(scale > 0, scale, np.max(scale, initial=0.0) or 1.0)
    eigenvalues, V = np.linalg.eigh(S / np.outer(scale, scale))
    return scale[:, None] * V * np.sqrt(np.maximum(eigenvalues, _FLOOR * max(float(eigenvalues[-1]), 1.0)))
