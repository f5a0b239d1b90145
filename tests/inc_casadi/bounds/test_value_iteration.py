"""Value iteration from zero: the least cost of finitely many steps, never above it, and in the limit Riccati."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from inc_casadi import Box, Ellipsoid, Empirical, Gaussian, Plant, Polytope, Spec
from inc_casadi.blocks import exact
from inc_casadi.bounds.exact_steps import second_moment, unproved_steps
from inc_casadi.bounds.value_iteration import settled_steps, step, unlimited, value_iteration

N, M = 3, 2


def draw(seed, discount=0.9):
    rng = np.random.default_rng(seed)
    root, short = rng.standard_normal((N, N)), rng.standard_normal((M, M))
    spec = Spec(root @ root.T, short @ short.T, discount, Gaussian(rng.standard_normal(N), root.T @ root))
    return Plant(rng.standard_normal((N, N)), rng.standard_normal((N, M))), spec


@pytest.mark.parametrize("seed", range(4))
def test_it_is_the_least_cost_of_the_first_steps(seed):
    plant, spec = draw(seed)
    steps, x0 = 4, np.array([1.0, -2.0, 0.5])
    rootQ, rootR = np.linalg.cholesky(spec.Q).T, np.linalg.cholesky(spec.R).T
    rows, right = [], []
    for k in range(steps):  # cost = |F u + g|^2 with blocks Q^(1/2) x_k and R^(1/2) u_k
        F = np.zeros((N, steps * M))
        for j in range(k):
            F[:, j * M:(j + 1) * M] = np.linalg.matrix_power(plant.A, k - 1 - j) @ plant.B
        weight = spec.discount ** (k / 2)
        rows += [weight * rootQ @ F, weight * rootR @ np.eye(steps * M)[k * M:(k + 1) * M]]
        right += [weight * rootQ @ np.linalg.matrix_power(plant.A, k) @ x0, np.zeros(M)]
    F, g = np.vstack(rows), np.concatenate(right)
    u = np.linalg.lstsq(F, -g, rcond=None)[0]
    P = value_iteration(plant, spec, steps)[0][-1]
    assert x0 @ P @ x0 == pytest.approx(np.sum((F @ u + g) ** 2), rel=1e-10)
    assert x0 @ P @ x0 <= np.sum((F @ u + g) ** 2)


def test_it_settles_at_the_solution_of_the_riccati_equation():
    plant, spec = draw(5, discount=1.0)
    P, K = value_iteration(plant, spec, settled_steps(plant, spec))
    true = solve_discrete_are(plant.A, plant.B, spec.Q, spec.R)
    np.testing.assert_allclose(P[-1], true, rtol=1e-10)
    gain = -np.linalg.solve(spec.R + plant.B.T @ true @ plant.B, plant.B.T @ true @ plant.A)
    np.testing.assert_allclose(K, gain, rtol=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_every_step_is_a_lower_bound_in_exact_arithmetic(seed):
    plant, spec = draw(seed, discount=0.75)
    P, _ = value_iteration(plant, spec, 30)
    A, B, Q, R, beta = exact(plant.A), exact(plant.B), exact(spec.Q), exact(spec.R), Fraction(3, 4)
    for before, after in zip(exact(P)[:-1], exact(P)[1:], strict=True):
        across = beta * A.T @ before @ B
        corner = Q + beta * A.T @ before @ A - after
        assert positive_definite(np.block([[corner, across], [across.T, R + beta * B.T @ before @ B]]))


def positive_definite(matrix):
    """Whether all pivots of exact elimination are positive."""
    matrix = matrix.copy()
    for i in range(len(matrix)):
        if matrix[i, i] <= 0:
            return False
        matrix[i + 1:] = matrix[i + 1:] - np.outer(matrix[i + 1:, i] / matrix[i, i], matrix[i])
    return True


def test_an_input_without_cost_that_reaches_the_state_cancels_it_at_once():
    spec = Spec(Q=2.0, R=0.0, discount=1.0, initial=Box(-1, 1))
    np.testing.assert_allclose(value_iteration(Plant(1.5, 1.0), spec, 7)[0][1:, 0, 0], 2.0)


def test_inputs_that_repeat_one_another_count_once():
    plant, _ = draw(1)
    b = plant.B[:, :1]
    one = Spec(np.eye(N), 0.0, 0.9, Box(-np.ones(N), np.ones(N)))
    two = Spec(np.eye(N), np.zeros((2, 2)), 0.9, one.initial)
    alone = value_iteration(Plant(plant.A, b), one, 20)[0]
    twice = value_iteration(Plant(plant.A, np.hstack([b, 2 * b])), two, 20)[0]
    np.testing.assert_allclose(twice[-1], alone[-1], rtol=1e-8)


def test_the_units_of_the_inputs_do_not_matter():
    plant, spec = draw(2)
    units = np.diag([1e-7, 1e5])
    scaled = Spec(spec.Q, units @ spec.R @ units, spec.discount, spec.initial)
    there = value_iteration(Plant(plant.A, plant.B @ units), scaled, 20)[0][-1]
    np.testing.assert_allclose(there, value_iteration(plant, spec, 20)[0][-1], rtol=1e-9)


def test_the_bound_is_the_cost_of_the_discounted_regulator_from_random_states():
    plant, spec = draw(6)
    root = np.sqrt(spec.discount)
    P = solve_discrete_are(root * plant.A, root * plant.B, spec.Q, spec.R)
    true = np.trace(P @ (spec.initial.covariance + np.outer(spec.initial.mean, spec.initial.mean)))
    bound = unlimited(plant, spec)
    assert true - 1e-9 * true < bound.value < true
    assert bound.holds() and "without input limits" in bound.statement


def test_a_plant_that_cannot_be_stabilized_ends_in_a_large_bound_and_not_in_a_loop():
    plant, spec = Plant(np.diag([2.0, 0.5]), [[0.0], [1.0]]), Spec(np.eye(2), 1.0, 1.0, Box([-1, -1], [1, 1]))
    assert unlimited(plant, spec).value > 1e11


def test_one_step_lowers_by_no_more_than_rounding():
    plant, spec = draw(8)
    after, K = step(plant, spec, np.eye(N))
    best = spec.Q + K.T @ spec.R @ K + spec.discount * (plant.A + plant.B @ K).T @ (plant.A + plant.B @ K)
    gap = np.linalg.eigvalsh(best - after)
    assert 0 < gap[0] and gap[-1] < 1e-12 * np.linalg.norm(best)


@pytest.mark.parametrize("discount", [0.9, 1.0])
def test_the_bound_is_proved_and_the_exact_value_is_a_little_higher(discount):
    plant, spec = draw(6, discount)
    bound = unlimited(plant, spec)
    exactly = bound.exact_value()
    assert isinstance(exactly, Fraction) and 0 < float(exactly) - bound.value < 1e-11 * bound.value
    assert bound.prove() and not replace(bound, value=bound.value * (1 + 1e-10)).prove()


@pytest.mark.parametrize("R", [0.0, 0.3])
def test_weights_without_rank_are_settled_too(R):
    spec = Spec(np.diag([1.0, 0.0]), R, 0.9, Box([-1, -1], [1, 1]))  # the second state costs nothing by itself
    bound = unlimited(Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]]), spec)
    assert bound.prove()
    cancelled = unlimited(Plant(1.5, 1.0), Spec(2.0, 0.0, 1.0, Box(-1, 1)))
    assert cancelled.prove() and float(cancelled.exact_value()) == pytest.approx(2 / 3)


def test_steps_that_were_raised_are_found_out():
    plant, spec = draw(1)
    P, _ = value_iteration(plant, spec, 12)
    assert unproved_steps(plant, spec, P) == ""
    for j in (1, 5, 12):
        raised = P.copy()
        raised[j] += 1e-9 * np.eye(N)
        assert unproved_steps(plant, spec, raised) == f"step {j} of value iteration is not a lower bound"
    P[0, 0, 0] = 1e-300
    assert "start from zero" in unproved_steps(plant, spec, P)


def test_a_weight_that_rounding_made_indefinite_is_not_proved():
    tilted = np.array([[1.0, 1.0], [1.0, 1.0 - 2**-52]])
    bound = unlimited(Plant(np.eye(2) / 2, [[1.0], [0.0]]), Spec(tilted, 1.0, 1.0, Box([-1, -1], [1, 1])))
    assert "Q has a negative eigenvalue" in bound.prove().reason


@pytest.mark.parametrize("initial", [
    Box([-1, 0], [0.5, 3]), Gaussian([0.3, -1], [[2.0, 0.3], [0.3, 1.0]]), Ellipsoid([[2.0, 0.3], [0.3, 1.0]], [1, 2], 3.0),
    Empirical([[1.0, 2.0, 0.1], [0.0, -1.0, 0.7]], [0.1, 0.3, 0.6]), Polytope.from_vertices([[0, 1, 0.3], [0, 0.1, 1.7]]),
], ids=["box", "gaussian", "ellipsoid", "points", "polytope"])
def test_second_moments_are_fractions_near_the_floats(initial):
    spec = Spec(np.eye(2), 1.0, 1.0, initial)
    found = second_moment(spec.initial)
    assert all(isinstance(entry, Fraction) for entry in found.flat)
    np.testing.assert_allclose(found.astype(float), spec.initial.second_moment, rtol=1e-13)
