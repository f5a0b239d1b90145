"""The plants of the paper's examples, each with its specification and the place where it is printed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inc_casadi import INC, Box, LeakyReLU, Plant, Spec


class Case(NamedTuple):
    """A control problem: plant, specification, and where it is stated: a label of the paper, or a publication."""

    plant: Plant
    spec: Spec
    source: str


def implicit_example() -> Case:
    """Return the scalar plant of sec:numerics_implicit: x+ = 1.2 x + u, stage cost x^2 + 0.05 u^2, discount 0.98.

    x_0 is uniform on [-1, 1]; there are no input limits.

    >>> implicit_example().plant.A.tolist()
    [[1.2]]
    """
    spec = Spec(Q=1.0, R=0.05, discount=0.98, initial=Box(-1, 1))
    return Case(Plant(1.2, 1.0), spec, "sec:numerics_implicit")


def implicit_controller(W: float = 1.0) -> INC:
    """Return the controller of eq:implicit_example_controller; W = 0 is the comparison without hidden interconnection.

    W: factor on the printed matrix W.

    >>> implicit_controller()([1.0]).round(4).tolist()
    [-1.2174]
    """
    matrix = W * np.array([[0.3, 0.2], [0.2, 0.3]])
    return INC(matrix, [[1.0], [-1.0]], [[-0.7, 0.7]], [[0.0]], activation=LeakyReLU(0.5))


def scalar(discount: float = 1.0, r: float = 0.0) -> Case:
    """Return the plant of eq:scalar_plant: x+ = 1.5 x + u, |u| <= 1, x_0 uniform on [-1, 1], cost x^2 + r u^2.

    >>> scalar(0.9).spec.discount
    0.9
    """
    spec = Spec(Q=1.0, R=r, discount=discount, initial=Box(-1, 1), inputs=Box(-1, 1))
    return Case(Plant(1.5, 1.0), spec, "eq:scalar_plant")


def two_state() -> Case:
    """Return the plant of eq:two_state_plant with |u| <= 1, x_0 uniform on [-0.8, 0.8]^2, cost x'x + 0.05 u^2.

    >>> two_state().plant.m
    1
    """
    spec = Spec(Q=np.eye(2), R=0.05, discount=0.98, initial=Box([-0.8, -0.8], [0.8, 0.8]), inputs=Box(-1, 1))
    return Case(Plant([[1.10, 1.00], [0.0, 1.02]], [[0.20], [0.50]]), spec, "eq:two_state_plant")


def output_feedback(alpha: float = 0.5, discount: float = 0.9, weight: float = 0.0) -> Case:
    """Return the embedding of cor:genuine_of: diag(1.5, alpha), the input and the measurement on the first state only.

    alpha: in (-1, 1), the mode that is neither steered nor seen; weight: its cost, which no controller can change and
    which adds weight / (3 (1 - discount alpha^2)). Each state is uniform on [-1, 1].

    >>> output_feedback().plant.full_state
    False
    """
    plant = Plant(np.diag([1.5, alpha]), [[1.0], [0.0]], [[1.0, 0.0]])
    spec = Spec(Q=np.diag([1.0, weight]), R=0.0, discount=discount, initial=Box([-1, -1], [1, 1]), inputs=Box(-1, 1))
    return Case(plant, spec, "cor:genuine_of")
