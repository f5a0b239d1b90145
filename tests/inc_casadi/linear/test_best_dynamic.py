"""The best dynamic linear controllers: published figures, an independent program, motions, and where there is none."""

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from linear_draws import case, expected, rolled, summed

from inc_casadi import Box, Ellipsoid, Empirical, Gaussian, Plant, Polytope, Spec
from inc_casadi.bounds import affine_moves
from inc_casadi.errors import InfeasibleError, InvalidInputError, NotStabilizableError
from inc_casadi.linear import best_dynamic
from inc_casadi.linear.best_dynamic import best_dynamic_linear
from inc_casadi.linear.deadbeat import deadbeat_observer
from inc_casadi.linear.regulator import discounted_lqr
from inc_casadi.linear.static_gain import best_static_gain
from inc_casadi.linear.youla import Observed

TWO_STATE = Plant([[1.10, 1.00], [0.0, 1.02]], [[0.20], [0.50]])
TWO_STATE_SPEC = Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box(-1, 1))
ONE_OUTPUT = Plant(TWO_STATE.A, TWO_STATE.B, [[1.0, 0.0]])


def least_of_time_invariant(plant, spec, N):
    """N moves of any time-invariant controller, u_k = sum_j Q_j C A^(k-j) x_0 + c_k, modelled in CVXPY: a lower bound."""
    Q, c = [cp.Variable((plant.m, plant.p)) for _ in range(N)], [cp.Variable((plant.m, 1)) for _ in range(N)]
    free = [plant.C @ np.linalg.matrix_power(plant.A, k) for k in range(N)]
    L = np.linalg.cholesky(np.block([[spec.initial.second_moment, spec.initial.mean[:, None]],
                                     [spec.initial.mean[None, :], np.ones((1, 1))]]))
    corners = np.vstack([spec.initial.vertices, np.ones((1, spec.initial.vertices.shape[1]))])
    q, r = np.linalg.cholesky(spec.Q).T, np.linalg.cholesky(spec.R).T
    X, cost, kept = np.eye(plant.n, plant.n + 1), 0.0, []
    for k in range(N):
        U = cp.hstack([sum(Q[j] @ free[k - j] for j in range(k + 1)), c[k]])
        cost += spec.discount**k * (cp.sum_squares(q @ X @ L) + cp.sum_squares(r @ U @ L))
        kept.append(spec.inputs.H @ U @ corners <= spec.inputs.h[:, None])
        X = plant.A @ X + plant.B @ U
    problem = cp.Problem(cp.Minimize(cost + spec.discount**N * cp.sum_squares(q @ X @ L)), kept)
    return float(problem.solve(solver=cp.CLARABEL))


def test_the_two_state_plant_comes_within_a_billionth_of_the_lower_bound():
    found = best_dynamic_linear(TWO_STATE, TWO_STATE_SPEC)
    lower = affine_moves(TWO_STATE, TWO_STATE_SPEC, 20).value
    assert found.controller.order == 21 and found.prove()
    assert lower <= found.bound <= lower * (1 + 1e-8) and found.bound == pytest.approx(2.1167631, abs=1e-7)
    assert found.bound < 0.64 * best_static_gain(TWO_STATE, TWO_STATE_SPEC).cost


def test_a_controller_of_order_four_is_as_good_on_the_two_state_plant():
    found = best_dynamic_linear(TWO_STATE, TWO_STATE_SPEC, moves=3)
    assert found.controller.order == 4 and found.bound == pytest.approx(2.11676305, abs=1e-8)
    assert expected(TWO_STATE, TWO_STATE_SPEC, found.controller, 600) == pytest.approx(found.cost, rel=1e-9)


@pytest.mark.parametrize("discount", [1.0, 0.5])
def test_the_scalar_plant_attains_the_bound_of_the_paper(discount):
    spec = Spec(1.0, 0.0, discount, Box(-1, 1), Box(-1, 1))
    found = best_dynamic_linear(Plant(1.5, 1.0), spec, moves=2)
    assert found.holds() and found.bound == pytest.approx(1 / 3 + discount / 12, rel=1e-9)


def test_with_a_cost_of_inputs_the_scalar_plant_is_near_the_infimum():
    spec = Spec(1.0, 0.5, 0.9, Box(-1, 1), Box(-1, 1))
    found = best_dynamic_linear(Plant(1.5, 1.0), spec)
    lower = affine_moves(Plant(1.5, 1.0), spec, 15).value
    assert lower <= found.bound <= lower * (1 + 1e-8)


def test_output_feedback_attains_the_best_of_all_time_invariant_controllers():
    found = best_dynamic_linear(ONE_OUTPUT, TWO_STATE_SPEC)
    varying = affine_moves(ONE_OUTPUT, TWO_STATE_SPEC, 20, time_varying=True).value
    invariant = least_of_time_invariant(ONE_OUTPUT, TWO_STATE_SPEC, 20)
    assert found.holds() and found.bound == pytest.approx(5.9170702, abs=1e-6)
    assert found.bound == pytest.approx(invariant, rel=1e-6)
    assert 0 <= found.bound - affine_moves(ONE_OUTPUT, TWO_STATE_SPEC, 20).value <= 1e-7
    assert varying == pytest.approx(4.7063, abs=1e-3)  # moves that may change with time are given a quarter more


def test_the_genuine_output_feedback_example():
    plant = Plant(np.diag([1.5, 0.5]), [[1.0], [0.0]], [[1.0, 0.0]])  # the second state is neither steered nor seen
    spec = Spec(np.diag([1.0, 2.0]), 0.0, 0.9, Box([-1, -1], [1, 1]), Box(-1, 1))
    found = best_dynamic_linear(plant, spec, moves=3)
    assert found.holds() and found.bound == pytest.approx(1 / 3 + 0.9 / 12 + 2 / (3 * (1 - 0.9 * 0.25)), rel=1e-8)


@pytest.mark.parametrize("seed", range(8))
def test_random_plants_against_motions_and_lower_bounds(seed):
    plant, spec = case(seed, n=3, m=2, p=(None, 2)[seed % 2], size=0.2)
    found = best_dynamic_linear(plant, spec, moves=10)
    assert found.holds() and found.prove() and found.controller.order == 3 + 9 * 2
    _, inputs = rolled(plant, found.controller, spec.initial.vertices, 300)
    assert np.max(spec.inputs.H @ inputs - spec.inputs.h[:, None]) <= 0
    cost = expected(plant, spec, found.controller, 600)
    assert cost * (1 - 1e-12) <= found.bound <= cost * (1 + 1e-8)
    assert np.max(summed(plant, spec, found.controller, spec.initial.vertices, 600)) <= found.worst * (1 + 1e-12)
    lower = affine_moves(plant, spec, 10).value
    assert lower <= found.bound
    if plant.full_state:
        assert found.bound <= lower * 1.01


@pytest.mark.parametrize("initial", [
    Ellipsoid([[2.0, 0.3], [0.3, 2.0]], [0.1, 0.0]), Polytope([[-1, 0], [0, -1], [1, 1]], [0.5, 0.4, 0.3]),
    Empirical([[0.4, 0.1, -0.3], [0.1, 0.5, 0.2]], [1, 2, 1]), Empirical([[0.5, -0.5], [0.4, -0.4]])])
def test_every_kind_of_set_meets_its_lower_bound(initial):
    spec = replace(TWO_STATE_SPEC, initial=Spec(np.eye(2), 0.05, 0.98, initial).initial, inputs=Box(-1.0, 0.9))
    found = best_dynamic_linear(TWO_STATE, spec, moves=16)
    lower = affine_moves(TWO_STATE, spec, 16).value
    assert found.holds() and lower * (1 - 1e-9) <= found.bound <= lower * (1 + 1e-6)


def test_more_moves_cost_no_more_and_none_beats_the_lower_bound():
    spec = replace(TWO_STATE_SPEC, R=np.array([[2.0]]))
    costs = [best_dynamic_linear(ONE_OUTPUT, spec, N).bound for N in (5, 7, 12)]
    assert costs == sorted(costs, reverse=True) and costs[-1] < costs[0] * (1 - 1e-7)
    assert affine_moves(ONE_OUTPUT, spec, 12).value < costs[-1]


@pytest.mark.parametrize("initial", [Gaussian([1.0, -0.5], np.diag([1.0, 2.0])), Box([-1, -1], [1, 2])])
def test_without_limits_the_regulator_is_found(initial):
    spec = Spec(np.eye(2), 0.05, 0.98, initial)
    found = best_dynamic_linear(TWO_STATE, spec, moves=3)
    P = discounted_lqr(TWO_STATE, spec)[1]
    assert found.holds() and found.bound == pytest.approx(np.sum(P * spec.initial.second_moment), rel=1e-9)


def test_a_regulator_that_is_stable_only_with_the_discount_is_replaced():
    plant, spec = Plant(1.1, 1.0), Spec(1e-3, 5.0, 0.5, Box(-1, 1), Box(-1, 1))
    assert abs(1.1 + discounted_lqr(plant, spec)[0][0, 0]) > 1
    found = best_dynamic_linear(plant, spec, moves=12)
    lower = affine_moves(plant, spec, 12).value
    assert found.holds() and lower <= found.bound


def test_where_there_is_none_the_reason_is_said():
    with pytest.raises(InfeasibleError, match="1 moves .* try more"):
        best_dynamic_linear(TWO_STATE, TWO_STATE_SPEC, moves=1)
    with pytest.raises(InfeasibleError, match="eigenvalue 1.5"):
        best_dynamic_linear(Plant(1.5, 1.0), Spec(1.0, 0.0, 1.0, Box(-2.5, 2.5), Box(-1, 1)))
    with pytest.raises(InfeasibleError, match="u = 0"):
        best_dynamic_linear(Plant(1.5, 1.0), Spec(1.0, 0.0, 1.0, Box(-1, 1), Box(0, 1)))
    with pytest.raises(InfeasibleError, match="does not show"):
        best_dynamic_linear(Plant(np.diag([1.5, 1.2]), np.ones((2, 1)), [[1.0, 0.0]]), replace(TWO_STATE_SPEC, inputs=None))
    with pytest.raises(NotStabilizableError):
        best_dynamic_linear(Plant(np.diag([1.5, 1.2]), [[1.0], [0.0]]), TWO_STATE_SPEC)


def test_what_the_program_finds_is_returned_only_when_certified(monkeypatch):
    monkeypatch.setattr(best_dynamic, "_ROOMS", (-0.01,))
    with pytest.raises(InfeasibleError, match="not certified: at k = 0 an input exceeds a limit by 1 %"):
        best_dynamic_linear(TWO_STATE, TWO_STATE_SPEC)


def test_bad_input_is_refused():
    with pytest.raises(InvalidInputError, match="unbounded"):
        best_dynamic_linear(TWO_STATE, replace(TWO_STATE_SPEC, initial=Gaussian([0.0, 0.0], np.eye(2))))
    with pytest.raises(InvalidInputError, match="moves"):
        best_dynamic_linear(TWO_STATE, TWO_STATE_SPEC, moves=0)
    with pytest.raises(InvalidInputError, match="continuous"):
        best_dynamic_linear(Plant(-1.0, 1.0, dt=0.0), Spec(1.0, 1.0, 1.0, Box(-1, 1)))


@pytest.mark.parametrize("seed", range(6))
def test_the_observer_forgets_the_start_as_soon_as_it_can(seed):
    rng = np.random.default_rng(seed)
    n, p = 5, 1 + seed % 3
    A, C = rng.standard_normal((n, n)), rng.standard_normal((p, n))
    if seed % 2:
        A[:, 3:], C[:, 3:] = 0.0, 0.0  # two modes that are not seen
        A[3:, 3:] = [[0.5, 1.0], [0.0, 0.4]]
    closed = A - deadbeat_observer(A, C) @ C
    index = -(-(3 if seed % 2 else 5) // p)
    assert np.max(np.abs(C @ np.linalg.matrix_power(closed, index))) < 1e-10
    assert np.max(np.abs(C @ np.linalg.matrix_power(closed, index - 1))) > 1e-3 or index == 1
    np.testing.assert_allclose(deadbeat_observer(A, np.eye(n)), A, atol=1e-12)
    stretch = np.diag(10.0 ** np.arange(p))
    np.testing.assert_allclose(deadbeat_observer(A, stretch @ C) @ stretch, deadbeat_observer(A, C), atol=1e-9)


@pytest.mark.parametrize("moves", [1, 4])
def test_the_motions_are_affine_in_the_unknowns_and_those_of_the_controller(moves):
    plant, spec = case(31, n=3, m=2, p=2)
    K, L = discounted_lqr(plant, spec)[0], deadbeat_observer(plant.A, plant.C)
    observed = Observed(plant, K, L + 0.01, np.array([0.1, -0.2, 0.3]), moves)  # an observer that is not deadbeat
    motions = observed.motions(12)
    unknowns = 0.3 * np.random.default_rng(1).standard_normal(motions.input_response.shape[-1])
    assert unknowns.size == moves * 2 * 3 - 2
    x0 = spec.initial.vertices
    states, inputs = rolled(plant, observed.controller(unknowns), x0, 12)
    over = np.vstack([x0, np.ones((1, 8))])
    estimate = motions.estimate + motions.estimate_response @ unknowns
    np.testing.assert_allclose((motions.inputs + motions.input_response @ unknowns) @ over, inputs, atol=1e-10)
    np.testing.assert_allclose((estimate + motions.errors)[:12] @ over, states, atol=1e-10)
