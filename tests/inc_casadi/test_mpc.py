"""Model predictive control: the condensed program against simulated costs, its law as an INC against a QP solver."""

import draws
import numpy as np
import pytest

from inc_casadi import INC, Box, Plant, Polytope
from inc_casadi.errors import DimensionError, InfeasibleError, InvalidInputError, NotStabilizableError
from inc_casadi.mpc import MPC


def problem(seed, N=4, **more):
    """Three states, two inputs, a box that is not centred, a discount, weights without symmetry among coordinates."""
    rng = np.random.default_rng(seed)
    plant = draws.plant(rng, n=3, m=2, p=3, radius=1.1)
    root = rng.normal(size=(3, 3))
    more = {"discount": 0.9} | more
    return MPC(Plant(plant.A, plant.B), root @ root.T, np.diag([0.5, 0.1]), N, Box([-1.0, -0.3], [0.5, 2.0]), **more)


def simulated_cost(law, x, v):
    cost = 0.0
    for k, u in enumerate(v.reshape(law.horizon, -1)):
        cost += law.discount**k * (x @ law.Q @ x + u @ law.R @ u)
        x = law.plant.A @ x + law.plant.B @ u
    return cost + law.discount**law.horizon * x @ law.terminal @ x


@pytest.mark.parametrize("seed", range(3))
def test_the_condensed_program_is_half_the_simulated_cost(seed):
    law, rng = problem(seed), np.random.default_rng(seed + 100)
    x, (v, zero) = rng.normal(size=3), (rng.normal(size=8), np.zeros(8))
    program = law.condensed
    value = v @ program.H @ v / 2 + v @ program.F @ x
    assert 2 * value == pytest.approx(simulated_cost(law, x, v) - simulated_cost(law, x, zero), rel=1e-10)


@pytest.mark.parametrize("with_final", [True, False])
def test_the_condensed_limits_are_those_of_the_simulated_states(with_final):
    states, final = Box([-1.0, -2.0, -3.0], [4.0, 5.0, 6.0]), Polytope(*_simplex()) if with_final else None
    law, rng = problem(1, N=3, states=states, terminal_set=final), np.random.default_rng(7)
    program, kept = law.condensed, 0
    for _ in range(300):
        x, v = 1.5 * rng.normal(size=3), rng.normal(size=6)
        inside, motion = law.inputs.contains(v.reshape(3, 2).T).all(), x
        for u in v.reshape(3, 2):
            inside &= states.contains(motion)
            motion = law.plant.A @ motion + law.plant.B @ u
        inside &= (final or states).contains(motion)
        found = np.all(program.G @ v <= program.w + program.E @ x) and np.all(program.S @ x <= program.s)
        assert found == inside
        kept += inside
    assert kept > 0


def _simplex():
    return np.vstack([-np.eye(3), np.ones((1, 3))]), np.array([3.0, 3.0, 3.0, 4.0])


@pytest.mark.parametrize("seed", range(3))
def test_the_inc_gives_the_first_input_of_the_solver(seed):
    law, rng = problem(seed), np.random.default_rng(seed)
    inc = law.inc()
    assert (inc.q, inc.p, inc.m) == (8, 3, 2)
    x = rng.normal(size=(3, 30)) * 10.0 ** rng.uniform(-2, 1, size=30)
    by_solver = np.column_stack([law.solve(point)[0] for point in x.T])
    np.testing.assert_allclose(inc(x), by_solver, atol=2e-6)
    free = np.abs(by_solver - law.inputs.center[:, None]) < 0.99 * (law.inputs.upper - law.inputs.center)[:, None]
    assert 5 < free.sum() < 55  # both kinds are among the points


def test_the_hidden_units_are_the_whole_sequence_scaled():
    law = problem(2)
    x = np.array([0.7, -1.2, 0.4])
    half = (law.inputs.upper - law.inputs.lower) / 2
    eta = law.inc().hidden(x).reshape(4, 2)
    np.testing.assert_allclose(law.inputs.center + half * eta, law.solve(x), atol=2e-6)


def test_the_law_is_the_regulator_where_no_limit_matters():
    plant = Plant([[1.0, 0.3], [0.1, 1.2]], [[0.2], [1.0]])
    for horizon in (1, 3, 6):
        inc = INC.from_mpc(plant, np.eye(2), [[0.5]], horizon, Box([-100.0], [100.0]))
        P = MPC(plant, np.eye(2), [[0.5]], horizon, Box([-100.0], [100.0])).terminal
        K = -np.linalg.solve(plant.B.T @ P @ plant.B + 0.5, plant.B.T @ P @ plant.A)
        np.testing.assert_allclose(inc.jacobian([0.0, 0.0]), K, rtol=1e-9)


def test_the_given_terminal_cost_counts():
    plant = Plant([[1.5]], [[1.0]])
    # N = 1, by hand: minimize u^2 + 5 (1.5 x + u)^2, so u = -7.5 x / 6.
    assert INC.from_mpc(plant, [[3.0]], [[1.0]], 1, Box([-9.0], [9.0]), [[5.0]])([0.8]) == pytest.approx(-1.0, rel=1e-12)
    # A discount of 1/2 halves what comes one step later: minimize u^2 + 2.5 (1.5 x + u)^2.
    found = INC.from_mpc(plant, [[3.0]], [[1.0]], 1, Box([-9.0], [9.0]), [[5.0]], 0.5)([0.8])
    assert found == pytest.approx(-2.5 * 1.5 * 0.8 / 3.5, rel=1e-12)


def test_the_output_stays_within_the_box_in_exact_arithmetic():
    law = MPC(Plant([[2.0]], [[1.0]]), [[1.0]], [[0.1]], 3, Box([0.1], [0.7]))
    u = law.inc()(np.array([[-1e3, 1e3]]))[0]
    assert u.min() >= 0.1 and u.max() <= 0.7 and np.ptp(u) == pytest.approx(0.6, rel=1e-12)


def test_solve_is_optimal_among_feasible_sequences():
    states = Box([-2.0, -2.0, -2.0], [2.0, 2.0, 2.0])
    law, rng = problem(3, states=states), np.random.default_rng(11)
    x = np.array([1.2, -0.8, 0.9])
    best, program = law.solve(x).ravel(), law.condensed
    bound = program.w + program.E @ x
    assert np.all(program.G @ best <= bound + 1e-7)
    assert np.any(program.G @ best > bound - 1e-6)  # a limit is active, or nothing is tested
    tried = 0
    for _ in range(2000):
        v = best + 0.1 * rng.normal(size=best.size)
        if np.all(program.G @ v <= bound):
            tried += 1
            assert simulated_cost(law, x, v) >= simulated_cost(law, x, best) - 1e-6
    assert tried > 5


def test_solve_refuses_states_without_a_solution():
    law = MPC(Plant([[2.0]], [[1.0]]), [[1.0]], [[1.0]], 3, Box([-1.0], [1.0]), states=Box([-2.0], [2.0]))
    with pytest.raises(InfeasibleError, match="no sequence of 3 inputs"):
        law.solve([1.8])
    with pytest.raises(InfeasibleError, match="no input can change"):
        law.solve([2.1])
    assert law.solve([0.9]).shape == (3, 1)


def test_what_the_door_refuses():
    plant = Plant([[1.2]], [[1.0]])
    with pytest.raises(InvalidInputError, match="R must be positive definite"):
        MPC(plant, [[1.0]], [[0.0]], 2, Box([-1.0], [1.0]))
    with pytest.raises(InvalidInputError, match="horizon"):
        MPC(plant, [[1.0]], [[1.0]], 0, Box([-1.0], [1.0]))
    with pytest.raises(DimensionError, match="inputs is a set in R"):
        MPC(plant, [[1.0]], [[1.0]], 2, Box([-1.0, -1.0], [1.0, 1.0]))
    with pytest.raises(DimensionError, match="terminal_set is a set in R"):
        MPC(plant, [[1.0]], [[1.0]], 2, Box([-1.0], [1.0]), terminal_set=Box([-1.0, -1.0], [1.0, 1.0]))
    with pytest.raises(InvalidInputError, match="discrete time"):
        MPC(Plant([[1.2]], [[1.0]], dt=0.0), [[1.0]], [[1.0]], 2, Box([-1.0], [1.0]))
    with pytest.raises(InvalidInputError, match="must be a Box"):
        MPC(plant, [[1.0]], [[1.0]], 2, Polytope([[1.0], [-1.0]], [1.0, 1.0]))
    with pytest.raises(NotStabilizableError, match="Riccati"):
        MPC(Plant([[2.0]], [[0.0]]), [[1.0]], [[1.0]], 2, Box([-1.0], [1.0]))


def test_an_inc_is_refused_where_it_would_be_another_law():
    with pytest.raises(InvalidInputError, match="state limits"):
        problem(0, states=Box([-1.0] * 3, [1.0] * 3)).inc()
    with pytest.raises(InvalidInputError, match="not the identity"):
        INC.from_mpc(Plant(np.eye(2), [[1.0], [0.5]], [[0.0, 1.0], [1.0, 0.0]]), np.eye(2), [[1.0]], 2, Box([-1.0], [1.0]))
