"""The regulator on a Kalman filter: the textbook gains, noise by its covariances, and the largest admissible scale."""

from dataclasses import replace

import control
import numpy as np
import pytest
from linear_draws import case, rolled

from inc_casadi import Box, Plant, Spec
from inc_casadi.errors import InfeasibleError, InvalidInputError
from inc_casadi.linear.best_dynamic import best_dynamic_linear
from inc_casadi.linear.controller import LinearController
from inc_casadi.linear.linear_cost import linear_cost
from inc_casadi.linear.lqg import lqg
from inc_casadi.linear.regulator import discounted_lqr


@pytest.mark.parametrize("seed", range(3))
def test_the_gains_are_those_of_python_control(seed):
    plant, spec = case(seed, p=2, discount=1.0)
    W, N = np.diag([0.3, 1.0, 0.2]), np.array([[0.5, 0.1], [0.1, 0.7]])
    law = lqg(plant, replace(spec, inputs=None), W, N)
    K = -control.dlqr(plant.A, plant.B, spec.Q, spec.R)[0]
    L = control.dlqe(plant.A, np.eye(3), plant.C, W, N)[0]  # of the prediction, A M
    M = np.linalg.solve(plant.A, L)
    np.testing.assert_allclose(law.D_c, K @ M, atol=1e-7)
    np.testing.assert_allclose(law.B_c, (plant.A + plant.B @ K) @ M, atol=1e-7)
    np.testing.assert_allclose(law.C_c, K @ (np.eye(3) - M @ plant.C), atol=1e-7)
    np.testing.assert_allclose(law.A_c, (plant.A + plant.B @ K) @ (np.eye(3) - M @ plant.C), atol=1e-7)


def test_no_noisy_loop_nearby_has_a_smaller_variance():
    plant, spec = case(4, p=2, discount=1.0)
    W, N = np.diag([0.3, 1.0, 0.2]), 0.5 * np.eye(2)
    law = lqg(plant, replace(spec, inputs=None), W, N)

    def variance(A_c, B_c, C_c, D_c):
        closed = np.block([[plant.A + plant.B @ D_c @ plant.C, plant.B @ C_c], [B_c @ plant.C, A_c]])
        noise = np.block([[np.eye(3), plant.B @ D_c], [np.zeros((3, 3)), B_c]])
        drive = noise @ np.block([[W, np.zeros((3, 2))], [np.zeros((2, 3)), N]]) @ noise.T
        S = control.dlyap(closed, drive)
        G = np.hstack([D_c @ plant.C, C_c])
        return np.sum(spec.Q * S[:3, :3]) + np.sum(spec.R * (G @ S @ G.T + D_c @ N @ D_c.T))

    parts, rng = (law.A_c, law.B_c, law.C_c, law.D_c), np.random.default_rng(5)
    best = variance(*parts)
    for _ in range(10):
        assert variance(*(part + 1e-3 * rng.standard_normal(part.shape) for part in parts)) > best


def test_a_measured_state_without_noise_is_the_regulator():
    plant, spec = case(6, discount=0.9)
    law = lqg(plant, replace(spec, inputs=None), measurement=1e-12 * np.eye(3))
    K = discounted_lqr(plant, spec)[0]
    np.testing.assert_allclose(law.D_c, K, atol=1e-8)
    np.testing.assert_allclose(law.C_c, np.zeros((2, 3)), atol=1e-8)


def test_the_estimate_starts_at_the_mean_and_follows_the_state():
    plant, spec = case(7, p=2)
    law = lqg(plant, replace(spec, inputs=None))
    np.testing.assert_array_equal(law.xi_0, spec.initial.mean)
    states, _ = rolled(plant, law, spec.initial.vertices, 200)
    assert np.max(np.abs(states[-1])) < 1e-6


@pytest.mark.parametrize("seed, share", [(1, 0.35), (4, 1.0), pytest.param(5, 0.5, marks=pytest.mark.slow)])
def test_the_scale_is_the_largest_that_keeps_the_limits(seed, share):
    plant, spec = case(seed, p=2, size=0.25)
    tight = replace(spec, inputs=Box([-0.6 * share, -0.7 * share], [0.65 * share, 0.75 * share]))
    law, plain = lqg(plant, tight), lqg(plant, tight, scaled=False)
    found = linear_cost(plant, tight, law)
    assert found.holds() and not linear_cost(plant, tight, plain).holds()
    t = float(np.linalg.norm(law.D_c) / np.linalg.norm(plain.D_c))
    K = discounted_lqr(plant, tight)[0]
    M = np.linalg.solve(plant.A + t * plant.B @ K, law.B_c)
    closed, seen = plant.A + 1.0001 * t * plant.B @ K, np.eye(3) - M @ plant.C
    larger = LinearController(closed @ seen, closed @ M, 1.0001 * t * K @ seen, 1.0001 * t * K @ M, spec.initial.mean)
    assert 0.1 < t < 0.95 and not linear_cost(plant, tight, larger).holds()
    assert best_dynamic_linear(plant, tight).bound <= found.bound * (1 + 1e-9)


def test_where_no_scale_is_admissible_it_is_said():
    plant = Plant([[1.10, 1.00], [0.0, 1.02]], [[0.20], [0.50]], [[1.0, 0.0]])
    spec = Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box(-0.1, 0.1))
    with pytest.raises(InfeasibleError, match="no multiple"):
        lqg(plant, spec)
    assert lqg(plant, spec, scaled=False).order == 2


def test_what_no_filter_can_do_is_refused():
    with pytest.raises(InfeasibleError, match="does not show"):
        lqg(Plant(np.diag([1.5, 1.2]), np.ones((2, 1)), [[1.0, 0.0]]), Spec(np.eye(2), 1.0, 1.0, Box([-1, -1], [1, 1])))
    with pytest.raises(InvalidInputError, match="measurement"):
        lqg(Plant(1.5, 1.0), Spec(1.0, 1.0, 1.0, Box(-1, 1)), measurement=[[0.0]])
    with pytest.raises(InvalidInputError, match="continuous"):
        lqg(Plant(1.5, 1.0, dt=0.0), Spec(1.0, 1.0, 1.0, Box(-1, 1)))
