"""The sampled problem: its step cost against an integrator, the identity of costs, and what stands in for one."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_continuous_are, solve_continuous_lyapunov, solve_discrete_lyapunov

from inc_casadi import INC, Box, Gaussian, Plant, Spec
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.linear.regulator import discounted_lqr
from inc_casadi.sampled import sample, sampled_problem, step_cost


def problem(n=3, m=1, discount=0.8, seed=0, R=0.1):
    rng = np.random.default_rng(seed)
    plant = Plant(rng.normal(size=(n, n)), rng.normal(size=(n, m)), dt=0)
    root = rng.normal(size=(n, n))
    moment = rng.normal(size=(n, n))
    initial = Gaussian(rng.normal(size=n), moment @ moment.T)
    return plant, Spec(root @ root.T + 0.1 * np.eye(n), R * np.eye(m), discount, initial)


def paid(plant, spec, x, u, duration):
    """The discounted cost of a held input and the state it leads to, by an integrator."""
    def velocity(t, state):
        z = state[:-1]
        return np.append(plant.A @ z + plant.B @ u, spec.discount**t * (z @ spec.Q @ z + u @ spec.R @ u))

    run = solve_ivp(velocity, (0.0, duration), np.append(x, 0.0), rtol=1e-11, atol=1e-13)
    return run.y[-1, -1], run.y[:-1, -1]


@pytest.mark.parametrize(("discount", "period"), [(1.0, 0.3), (0.5, 0.3), (0.8, 3.0)])
def test_the_cost_of_a_step_is_that_of_an_integrator(discount, period):
    plant, spec = problem(m=2, discount=discount)
    M, rng = step_cost(plant, spec, period), np.random.default_rng(1)
    for _ in range(3):
        x, u = rng.normal(size=3), rng.normal(size=2)
        xu = np.append(x, u)
        assert xu @ M @ xu == pytest.approx(paid(plant, spec, x, u, period)[0], rel=1e-8)


def test_the_step_cost_of_a_stiff_plant_is_not_lost_in_cancellation():
    # One mode decays by exp(-2000) in a period: Van Loan's exponential alone would overflow.
    plant = Plant([[-2000.0, 0.0], [0.0, 0.1]], [[1.0], [1.0]], dt=0)
    M = step_cost(plant, Spec(np.eye(2), 0.0, 1.0, Box([-1, -1], [1, 1])), 1.0)
    assert M[0, 0] == pytest.approx(1 / 4000, rel=1e-9)
    assert M[1, 1] == pytest.approx(np.expm1(0.2) / 0.2, rel=1e-9)


def test_costs_of_any_input_sequence_differ_by_the_offset_alone():
    plant, spec = problem()
    found = sample(plant, spec, 0.1)
    assert found.exact
    rng, x = np.random.default_rng(2), np.array([1.0, -2.0, 0.5])
    start, total, discrete, b = x, 0.0, 0.0, found.spec.discount
    K = discounted_lqr(found.plant, found.spec)[0]
    for k in range(120):
        u = K @ x + rng.normal(size=1) * 0.8**k
        cost, after = paid(plant, spec, x, u, 0.1)
        total += b**k * cost
        discrete += b**k * (x @ found.spec.Q @ x + u @ found.spec.R @ u)
        x = after
    last = b**120 * (x @ found.S @ x)
    assert total == pytest.approx(discrete + start @ found.S @ start - last, rel=1e-8)
    assert abs(discrete / total - 1) > 1e-3  # the offset matters


@pytest.mark.parametrize("seed", range(4))
def test_one_input_and_a_short_period_give_an_identity(seed):
    found = sample(*problem(seed=seed), 0.05)
    assert found.exact and found.error < 1e-9
    assert np.linalg.eigvalsh(found.spec.Q)[0] >= 0 and np.linalg.eigvalsh(found.spec.R)[0] >= 0


def test_the_error_is_that_of_the_exact_cost_by_another_lyapunov_equation():
    plant, spec = problem(n=4, m=2, discount=0.9)
    found = sample(plant, spec, 0.2)
    assert not found.exact
    K, P = discounted_lqr(found.plant, found.spec)
    F = expm(np.block([[plant.A, plant.B], [np.zeros((2, 6))]]) * 0.2)
    rows = np.vstack([np.eye(4), K])
    closed = (F[:4, :4] + F[:4, 4:] @ K) * np.sqrt(0.9**0.2)
    S0 = spec.initial.second_moment
    exact = np.trace(solve_discrete_lyapunov(closed.T, rows.T @ step_cost(plant, spec, 0.2) @ rows) @ S0)
    assert found.cost(K) == pytest.approx(exact, rel=1e-9)
    assert found.error == pytest.approx(abs(np.trace((P + found.S) @ S0) - exact) / exact, rel=1e-6)


def test_without_an_identity_the_error_falls_with_the_square_of_the_period():
    for seed in range(3):
        errors = [sample(*problem(n=4, m=2, seed=seed), h).error for h in (0.04, 0.01)]
        assert errors[0] < 0.01 and errors[0] > 8 * errors[1]


def test_the_sampled_regulator_comes_near_the_continuous_one():
    plant, spec = problem(discount=0.7)
    shifted = plant.A + np.log(0.7) / 2 * np.eye(3)
    P = solve_continuous_are(shifted, plant.B, spec.Q, spec.R)
    best = np.trace(P @ spec.initial.second_moment)
    costs = []
    for h in (0.05, 0.025):
        found = sample(plant, spec, h)
        costs.append(np.trace(discounted_lqr(found.plant, found.spec)[1] @ spec.initial.second_moment) + found.offset)
    assert best < costs[1] < costs[0] < 1.05 * best  # a hold can only cost more
    assert (costs[0] - best) / (costs[1] - best) == pytest.approx(4.0, rel=0.2)


def test_a_free_input_and_a_held_one_agree_where_nothing_is_fed_back():
    plant, spec = problem()
    stable = Plant(plant.A - 4 * np.eye(3), plant.B, dt=0)
    closed = stable.A + np.log(spec.discount) / 2 * np.eye(3)
    expected = np.trace(solve_continuous_lyapunov(closed.T, -spec.Q) @ spec.initial.second_moment)
    assert sample(stable, spec, 0.3).cost(np.zeros((1, 3))) == pytest.approx(expected, rel=1e-9)
    assert sample(Plant([[0.5]], [[1.0]], dt=0), Spec(1.0, 1.0, 1.0, Box(-1, 1)), 0.1).cost([[0.0]]) == np.inf


def test_plant_limits_and_initial_states_are_passed_on():
    spec = Spec(np.eye(2), 0.1, 0.81, Box([-1, -1], [1, 1]), Box(-2, 1))
    plant, per_step = sampled_problem(Plant([[0, 1], [0, 0]], [[0], [1]], [[1.0, 0.0]], dt=0), spec, 0.5)
    np.testing.assert_allclose(plant.A, [[1, 0.5], [0, 1]], atol=1e-15)
    assert plant.dt == 0.5 and plant.p == 1
    assert per_step.inputs is spec.inputs and per_step.initial is spec.initial
    assert per_step.discount == pytest.approx(0.9)


def test_for_a_short_period_the_weights_are_those_of_the_rectangle_rule():
    plant, spec = problem()
    for h in (1e-2, 1e-3):
        per_step = sampled_problem(plant, spec, h)[1]
        np.testing.assert_allclose(per_step.Q / h, spec.Q, atol=30 * h**2 + 1e-9)
        np.testing.assert_allclose(per_step.R / h, spec.R, atol=30 * h)


def test_what_it_refuses():
    spec = Spec(1.0, 1.0, 0.9, Box(-1, 1))
    with pytest.raises(InvalidInputError, match="sampled already"):
        sampled_problem(Plant(0.5, 1.0), spec, 0.1)
    with pytest.raises(InvalidInputError, match="period = 0"):
        sampled_problem(Plant(0.5, 1.0, dt=0), spec, 0.0)
    with pytest.raises(DimensionError):
        sampled_problem(Plant(np.eye(2), np.ones((2, 1)), dt=0), spec, 0.1)
    with pytest.raises(InvalidInputError, match="a plant must be"):
        sampled_problem(INC.linear([[1.0]]), spec, 0.1)
