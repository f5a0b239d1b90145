"""A named obstruction is one: where it is named no inputs help, and just inside the limit some do."""

import numpy as np
import pytest
from scipy.optimize import linprog

from inc_casadi import Box, Ellipsoid, Empirical, Gaussian, Plant, Polytope, Spec
from inc_casadi.bounds import uncontrollable_vertex
from inc_casadi.errors import DimensionError


def question(plant, initial, inputs):
    m = plant.m
    return uncontrollable_vertex(plant, Spec(np.eye(plant.n), np.eye(m), 1.0, initial, inputs))


def steered(plant, x0, inputs, steps=60):
    """Whether some inputs lead x0 to within 1e-6 of the origin, by a linear program."""
    blocks = [np.linalg.matrix_power(plant.A, steps - 1 - j) @ plant.B for j in range(steps)]
    reach, drift = np.hstack(blocks), np.linalg.matrix_power(plant.A, steps) @ x0
    scale = np.max(np.abs(reach), axis=1)
    limits = np.kron(np.eye(steps), inputs.H), np.tile(inputs.h, steps)
    found = linprog(np.zeros(reach.shape[1]), *limits, reach / scale[:, None], -drift / scale, bounds=(None, None))
    return found.status == 0


def test_the_scalar_limit_is_exact_on_both_sides():
    plant, limits = Plant(1.5, 1.0), Box(-1, 3)
    assert question(plant, Box(-5.99, 1.99), limits) is None
    assert "[2.01]" in question(plant, Box(-1, 2.01), limits)
    assert "[-6.01]" in question(plant, Box(-6.01, 1), limits)
    assert question(plant, Box(-2, 2), Box(-1, 1)) is None  # on the edge: not beyond doubt
    assert "eigenvalue 1.5" in question(plant, Box(-2.001, 2), Box(-1, 1))


@pytest.mark.parametrize("seed", range(3))
def test_limits_of_a_mode_that_changes_sign_and_of_one_that_turns(seed):
    rng = np.random.default_rng(seed)
    turn = 0.3 + rng.random()
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    for A, B, inputs in ((np.diag([-1.3, 0.5]), rng.standard_normal((2, 1)), Box(-1, 3)),
                         (1.2 * rotation, rng.standard_normal((2, 1)), Box(-1, 0.5)),
                         (1.2 * rotation, rng.standard_normal((2, 2)),
                          Polytope.from_vertices([[-0.5, 0.8, 0.1], [-0.4, -0.2, 0.9]]))):
        plant, direction = Plant(A, B), rng.standard_normal(2)
        low, high = 0.0, 1e3
        while high - low > 1e-3 * high:
            middle = (low + high) / 2
            named = question(plant, Empirical((middle * direction)[:, None]), inputs) is not None
            low, high = (low, middle) if named else (middle, high)
        assert steered(plant, 0.97 * low * direction, inputs)
        assert not steered(plant, 1.01 * high * direction, inputs)


def test_a_mode_the_input_does_not_reach_is_named():
    plant = Plant(np.diag([1.5, 0.5]), [[0.0], [1.0]])
    said = question(plant, Box([-1, -1], [1, 1]), None)
    assert "eigenvalue 1.5" in said and "at most 0" in said
    assert question(plant, Empirical([[0.0], [5.0]]), None) is None
    assert question(Plant(1.5, 1.0), Box(-1e6, 1e6), None) is None


def test_stable_plants_and_integrators_can_be_steered_from_everywhere():
    T = np.tril(np.ones((4, 4))) @ np.triu(np.ones((4, 4)))
    chain = np.round(T @ (np.eye(4) + np.eye(4, k=1)) @ np.linalg.inv(T))  # four eigenvalues 1, exactly
    assert np.max(np.abs(np.linalg.eigvals(chain))) > 1 + 1e-9  # and yet computed as if unstable
    limits = Box([-1, -1], [1, 1])
    assert question(Plant(chain, T[:, 2:]), Box(-1e12 * np.ones(4), 1e12 * np.ones(4)), limits) is None
    assert question(Plant(0.9 * np.eye(2), np.eye(2)), Box([-1e5, -1e5], [1e5, 1e5]), limits) is None
    assert question(Plant([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], dt=0.0), Box([-9, -9], [9, 9]), Box(-1, 1)) is None


def test_a_double_unstable_mode_is_found():
    plant = Plant([[1.1, 1.0], [0.0, 1.1]], [[0.0], [1.0]])
    assert question(plant, Box([-0.1, -11], [0.1, 1]), Box(-1, 1)) is not None
    assert question(plant, Box([-0.1, -0.1], [0.1, 0.1]), Box(-1, 1)) is None


def test_continuous_time():
    plant = Plant(2.0, 1.0, dt=0.0)
    assert question(plant, Box(-0.499, 1.49), Box(-3, 1)) is None
    assert "[1.51]" in question(plant, Box(-0.1, 1.51), Box(-3, 1))
    assert "[-0.51]" in question(plant, Box(-0.51, 1.4), Box(-3, 1))
    spiral = Plant([[0.5, 2.0], [-2.0, 0.5]], [[1.0], [0.0]], dt=0.0)
    assert question(spiral, Box([-3, -3], [3, 3]), Box(-1, 1)) is not None
    assert question(spiral, Box([-0.1, -0.1], [0.1, 0.1]), Box(-1, 1)) is None


def test_ellipsoids_and_gaussians():
    plant, limits = Plant(np.diag([1.5, 0.5]), [[1.0], [1.0]]), Box(-1, 1)
    assert question(plant, Ellipsoid(np.eye(2), level=1.99**2), limits) is None
    assert "[2.01, 0]" in question(plant, Ellipsoid(np.eye(2), level=2.01**2), limits).replace("-", "")
    assert "Gaussian" in question(plant, Gaussian([0, 0], np.eye(2)), limits)
    assert question(plant, Gaussian([1.9, 0], np.diag([0.0, 9.0])), limits) is None
    assert "[2.1, 0]" in question(plant, Gaussian([2.1, 0], np.diag([0.0, 9.0])), limits)


def test_a_spec_that_does_not_fit_is_refused():
    with pytest.raises(DimensionError):
        uncontrollable_vertex(Plant(np.eye(2), np.ones((2, 1))), Spec(1.0, 1.0, 1.0, Box(-1, 1)))
