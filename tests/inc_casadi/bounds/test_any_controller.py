"""No controller whatever undercuts the bound, and published optimal costs are reached by it."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from benchmarks.plants import suite
from inc_casadi import Box, Ellipsoid, Empirical, Gaussian, Plant, Polytope, Spec
from inc_casadi.bounds import affine_moves, any_controller
from inc_casadi.bounds.value_iteration import value_iteration
from inc_casadi.errors import DimensionError, InvalidInputError

TWO_STATE = Plant([[1.10, 1.00], [0.0, 1.02]], [[0.20], [0.50]])
TWO_STATE_SPEC = Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box(-1, 1))
LQR = np.array([[-1.37488222, -2.64897412]])
N, M = 3, 2


def draw(seed, initial=None, inputs=None, radius=1.05):
    rng = np.random.default_rng(seed)
    A, root = rng.standard_normal((N, N)), rng.standard_normal((N, N))
    A *= radius / np.max(np.abs(np.linalg.eigvals(A)))
    inputs = inputs or Polytope.from_vertices([[-0.6, 0.9, 0.2], [-0.5, -0.3, 0.8]])
    initial = initial or Box([-0.2, -0.1, -0.4], [0.3, 0.1, 0.2])
    return Plant(A, rng.standard_normal((N, M))), Spec(root @ root.T, np.diag([0.1, 0.3]), 0.9, initial, inputs)


def simulated(plant, spec, law, x, steps=400):
    """The costs of a law u = law(k, x) from the columns of x."""
    total = np.zeros(x.shape[1])
    for k in range(steps):
        u = law(k, x)
        total += spec.discount**k * (np.sum(x * (spec.Q @ x), axis=0) + np.sum(u * (spec.R @ u), axis=0))
        x = plant.A @ x + plant.B @ u
    return total


def clipped_gain(limits, K):
    """u = K x, pulled towards the middle of the limits until it is inside."""
    middle = limits.vertices.mean(axis=1)[:, None]

    def law(_, x):
        direction = K @ x - middle
        room = (limits.h[:, None] - limits.H @ middle) / np.maximum(limits.H @ direction, 1e-300)
        return middle + direction * np.clip(np.min(room, axis=0), 0, 1)

    return law


SATURATED = 1.36496190  # exact cost of the saturated regulator on the two-state plant, so no bound may exceed it


def test_the_figures_of_the_two_state_plant():
    bound = any_controller(TWO_STATE, TWO_STATE_SPEC)
    assert 1.36485 < bound.value < SATURATED
    assert bound.holds() and bound.prove() and bound.value > affine_moves(TWO_STATE, TWO_STATE_SPEC, 1).value
    close = any_controller(TWO_STATE, TWO_STATE_SPEC, cells=3000, tol=1e-8)
    assert 1.36496 < close.value < SATURATED and close.holds()


def test_finer_cells_close_in_on_what_the_saturated_regulator_costs():
    values = [any_controller(TWO_STATE, TWO_STATE_SPEC, cells=n, tol=0.0).value for n in (1, 50, 200, 800, 3200)]
    assert np.all(np.diff(values) > 0)
    gaps = SATURATED - np.array(values[2:])
    assert np.all(gaps[1:] < gaps[:-1] / 8)  # faster than the square of the cells' size, which is one fourth


def test_halving_ends_when_little_is_to_be_gained():
    coarse, fine = (any_controller(TWO_STATE, TWO_STATE_SPEC, cells=5000, tol=tol) for tol in (1e-3, 1e-5))
    assert coarse.cells.probabilities.size <= fine.cells.probabilities.size < 2500
    assert SATURATED - fine.value < 3e-5 * SATURATED


@pytest.mark.slow
@pytest.mark.parametrize("name, n, m", [("tetrahedra", 3, 2), ("box", 4, 2), ("triangles", 2, 2)])
def test_more_states_and_inputs_bounds_grow_and_stay_below_a_law(name, n, m):
    rng = np.random.default_rng(n)
    A = rng.standard_normal((n, n))
    A *= 1.02 / np.max(np.abs(np.linalg.eigvals(A)))
    initial = Box(-np.linspace(0.5, 1, n), np.linspace(0.7, 0.4, n)) if name == "box" else \
        Polytope.from_vertices(rng.standard_normal((n, n + 4)))
    spec = Spec(np.eye(n), np.diag([0.1, 0.0]), 0.9, initial, Box([-0.4, -0.3], [0.2, 0.5]))
    plant = Plant(A, rng.standard_normal((n, m)))
    bounds = [any_controller(plant, spec, cells=cells, tol=0.0) for cells in (1, 100, 400, 1600)]
    values = [bound.value for bound in bounds]
    assert np.all(np.diff(values) > 0) and bounds[1].holds() and bounds[1].prove()
    _, K = value_iteration(plant, spec, 200)
    states = spec.initial.sample(20_000, rng)
    costs = simulated(plant, spec, clipped_gain(spec.inputs, K), states, 150)
    assert values[-1] < costs.mean() + 4 * costs.std() / np.sqrt(costs.size)
    assert np.diff(values)[-1] < 0.2 * np.diff(values)[0]


@pytest.mark.parametrize("beta, r", [(1.0, 0.0), (0.6, 0.0), (0.6, 0.2)])
def test_the_optimum_of_the_scalar_plant(beta, r):
    spec = Spec(1.0, r, beta, Box(-1, 1), Box(-1, 1))
    bound = any_controller(Plant(1.5, 1.0), spec, cells=400)
    if r == 0:  # u = -sat(1.5 x) reaches the origin as fast as can be, thm:longrun_dyn
        assert 1 / 3 + beta / 36 - 1e-6 < bound.value <= 1 / 3 + beta / 36
    nodes = (np.arange(20_000) + 0.5) / 10_000 - 1
    for gain in (1.0, 1.3, 1.5):
        costs = simulated(Plant(1.5, 1.0), spec, lambda _, x, gain=gain: np.clip(-gain * x, -1, 1), nodes[None, :])
        assert costs.mean() + 1e-7 >= bound.value


@pytest.mark.parametrize("x0, true", [([1.0, 1.0], 15.739210486), ([4.0, 4.0], 341.954199031)])
def test_the_constrained_optimum_of_bemporad(x0, true):
    # Bemporad, Morari, Dua, Pistikopoulos, Automatica 38(1), 2002, example 1: saturated LQR is optimal from there.
    plant = Plant([[0.7326, -0.0861], [0.1722, 0.9909]], [[0.0609], [0.0064]])
    known = Empirical(np.array(x0)[:, None])
    bound = any_controller(plant, Spec(np.eye(2), 0.01, 1.0, known, Box(-2, 2)))
    assert true * (1 - 1e-8) < bound.value < true * (1 + 1e-10)


def test_the_constrained_optimum_of_the_double_integrator_is_below_the_saturated_regulator():
    plant, known = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]]), Empirical([[0.0], [5.0]])
    spec = Spec(np.eye(2), 1.0, 1.0, known, Box(-1, 1))
    P = solve_discrete_are(plant.A, plant.B, spec.Q, spec.R)
    K = -np.linalg.solve(1.0 + plant.B.T @ P @ plant.B, plant.B.T @ P @ plant.A)
    saturated = simulated(plant, spec, lambda _, x: np.clip(K @ x, -1, 1), known.points)[0]
    bound = any_controller(plant, spec)
    assert bound.value == pytest.approx(938.672482, rel=1e-8)  # a quadratic program over 150 moves
    assert saturated == pytest.approx(941.975375, rel=1e-8)
    assert bound.prove()
    assert bound.holds() and len(bound.trials[-1].u) > 10  # ten moves do not lead back to where limits are not met


@pytest.mark.parametrize("seed", range(4))
def test_nonlinear_laws_from_known_states_cost_more(seed):
    rng = np.random.default_rng(50 + seed)
    plant, spec = draw(seed, initial=Empirical(rng.standard_normal((N, 4)), [1, 2, 3, 4]))
    bound = any_controller(plant, spec)
    P, K = value_iteration(plant, spec, 200)
    assert bound.holds()
    for scale in (0.7, 1.0, 1.3):
        costs = simulated(plant, spec, clipped_gain(spec.inputs, scale * K), spec.initial.points)
        assert costs @ spec.initial.weights >= bound.value
    assert bound.value > np.trace(P[-1] @ spec.initial.second_moment)


@pytest.mark.parametrize("initial", [
    Polytope.from_vertices([[-0.8, 0.8, 0.8, -0.8], [-0.8, -0.8, 0.8, 0.8]]),
    Ellipsoid([[1.0, 0.2], [0.2, 2.0]], [0.1, 0.0]),
    Gaussian([0.1, -0.2], [[0.2, 0.05], [0.05, 0.1]]),
], ids=["polytope", "ellipsoid", "gaussian"])
def test_every_distribution_is_bounded_closely(initial):
    spec = replace(TWO_STATE_SPEC, initial=initial)
    states = spec.initial.sample(100_000, np.random.default_rng(0))
    costs = simulated(TWO_STATE, spec, lambda _, x: np.clip(LQR @ x, -1, 1), states, 150)
    bound = any_controller(TWO_STATE, spec)
    assert bound.holds()
    assert bound.value <= costs.mean() + 4 * costs.std() / np.sqrt(costs.size)
    assert bound.value > 0.98 * costs.mean()


def test_any_trial_inputs_prove_something_lower():
    plant, spec = draw(1)
    bound = any_controller(plant, spec, cells=64)
    (group,) = bound.trials
    rng = np.random.default_rng(0)
    for u in (group.u + 1e-2 * rng.standard_normal(group.u.shape), 3 * rng.standard_normal(group.u.shape), 0 * group.u):
        worse = replace(bound, trials=(replace(group, u=u),))
        assert worse.dual()[0] < bound.value and not worse.holds() and not worse.prove()
        lower = replace(worse, value=worse.dual()[0] - worse.dual()[1])
        assert lower.holds() and lower.prove()
    without = replace(bound, trials=())
    assert without.dual()[0] < bound.value  # then the unlimited optimum is all that is known
    assert float(without.exact_value()) == pytest.approx(without.dual()[0], rel=1e-12)


def test_altered_numbers_are_refused():
    plant, spec = draw(2, Box([-0.8, -0.4, -1.6], [1.2, 0.4, 0.8]))  # so large that limits count on most cells
    bound = any_controller(plant, spec, cells=27, horizon=10)
    (group,) = bound.trials
    scalar = any_controller(Plant(1.5, 1.0), Spec(1.0, 0.1, 1.0, Box(-1, 1), Box(-1, 1)), cells=50)
    assert bound.holds() and bound.prove() and replace(bound, value=bound.value - 1).prove()
    twice = bound.cells.record.more(np.array([0]), np.array([0]))  # the root was cut before
    for fake in (replace(bound, value=bound.value * (1 + 1e-9)),
                 replace(bound, trials=(replace(group, G=1.1 * group.G),)),
                 replace(bound, trials=(replace(group, u=np.nan * group.u),)),
                 replace(bound, trials=(replace(group, members=group.members + 1),)),
                 replace(bound, trials=(replace(group, G=group.G[:, :, :2]),)),
                 replace(bound, steps=5),
                 replace(bound, cells=replace(bound.cells, record=twice)),
                 replace(scalar, spec=replace(scalar.spec, inputs=Box(-1.2, 1.2)))):
        assert not fake.holds() and not fake.prove()
    assert not replace(bound, value=float("inf")).holds()


def test_states_in_very_different_units_cost_no_more_than_a_rounding():
    """A ball in m, held by a magnet's current in A: the weights of the states are seven orders of magnitude apart."""
    case = suite()["ball suspension"]
    bound = any_controller(case.plant, case.spec, cells=600)
    assert 63.88 < bound.value < 63.90344 and bound.holds() and bound.prove()  # the saturated regulator costs 63.90343
    P, _ = value_iteration(case.plant, case.spec, 300)
    root, spec = np.sqrt(case.spec.discount), case.spec
    true = solve_discrete_are(root * case.plant.A, root * case.plant.B, spec.Q, spec.R)
    np.testing.assert_allclose(np.diag(P[-1]), np.diag(true), rtol=1e-9)


def test_a_cell_counts_at_least_with_the_cost_without_limits():
    bound = any_controller(TWO_STATE, TWO_STATE_SPEC, cells=50)
    far = replace(bound, trials=tuple(replace(group, u=group.u + 50.0) for group in bound.trials))
    free = any_controller(TWO_STATE, replace(TWO_STATE_SPEC, inputs=None)).value
    assert far.dual()[0] == pytest.approx(free, rel=1e-9) and float(far.exact_value()) == pytest.approx(free, rel=1e-9)


def test_cells_of_another_distribution_are_refused():
    wide = any_controller(TWO_STATE, replace(TWO_STATE_SPEC, initial=Box([-1.2, -1.2], [1.2, 1.2])), cells=100)
    fake = replace(wide, spec=TWO_STATE_SPEC)
    fake = replace(fake, value=fake.dual()[0] - fake.dual()[1])
    assert fake.value > SATURATED and not fake.holds() and not fake.prove()  # more than a law that exists


@pytest.mark.parametrize("initial, inputs, discount", [
    (Empirical(np.random.default_rng(1).standard_normal((N, 6)), [1, 2, 3, 4, 0, 6]), None, 0.9),
    (Polytope.from_vertices(np.random.default_rng(2).standard_normal((N, 6))), Box([-0.3, -0.1], [0.6, 0.5]), 1.0),
    (None, Box([-0.3, -0.4], [0.6, 0.1]), 1.0), (None, None, 0.7),
], ids=["points", "simplices", "box", "polytopic limits"])
def test_it_is_proved_in_exact_arithmetic(initial, inputs, discount):
    plant, spec = draw(7, initial, inputs, 0.97)
    spec = replace(spec, discount=discount)
    for R in (spec.R, np.diag([0.0, 0.2]), np.zeros((M, M))):
        bound = any_controller(plant, replace(spec, R=R), cells=40)
        exactly = bound.exact_value()
        assert isinstance(exactly, Fraction) and 0 < float(exactly) - bound.value < 1e-9 * bound.value
        assert bound.prove() and not replace(bound, value=float(exactly) * (1 + 1e-15)).prove()


@pytest.mark.parametrize("initial, word", [(Gaussian([0.1, -0.2], np.eye(2)), "Gaussian"),
                                           (Ellipsoid(np.eye(2)), "Ellipsoid")])
def test_what_cannot_be_settled_exactly_says_why(initial, word):
    bound = any_controller(TWO_STATE, replace(TWO_STATE_SPEC, initial=initial), cells=20)
    assert bound.holds() and not bound.prove() and word in bound.prove().reason


def test_a_weight_that_rounding_made_indefinite_is_not_proved():
    tilted = np.array([[1.0, 1.0], [1.0, 1.0 - 2**-52]])
    bound = any_controller(TWO_STATE, replace(TWO_STATE_SPEC, Q=tilted), cells=20)
    assert bound.holds() and "Q has a negative eigenvalue" in bound.prove().reason


def test_the_horizon_is_what_is_asked_and_a_longer_one_proves_more():
    known = Empirical([[0.0], [5.0]])
    spec = Spec(np.eye(2), 1.0, 1.0, known, Box(-1, 1))
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]])
    bounds = [any_controller(plant, spec, horizon=T) for T in (1, 5, 10, 20, 40)]
    assert [len(bound.trials[0].u) for bound in bounds] == [1, 5, 10, 20, 40]
    values = [bound.value for bound in bounds]
    assert np.all(np.diff(values) > -1e-8 * values[-1]) and values[0] < 0.5 * values[-1]
    assert any_controller(plant, spec).value == pytest.approx(values[-1], rel=1e-8)


def test_one_move_by_hand():
    # min over |u| <= 1 of x^2 + (2 x + u)^2 P, P = 1 + 4 (no cost of u: P = 1); from x = 3: 9 + 25
    known = Empirical([[3.0]])
    bound = any_controller(Plant(2.0, 1.0), Spec(1.0, 0.0, 1.0, known, Box(-1, 1)), horizon=1)
    assert bound.value == pytest.approx(34.0, rel=1e-8) and bound.value <= 34.0


def test_a_state_that_cannot_be_held_costs_more_the_longer_one_looks():
    spec = Spec(1.0, 0.0, 0.9, Empirical([[3.0]]), Box(-1, 1))
    values = [any_controller(Plant(2.0, 1.0), spec, horizon=T).value for T in (5, 10, 20)]
    assert values[0] < values[1] < values[2]
    true = simulated(Plant(2.0, 1.0), spec, lambda _, x: -np.ones_like(x), np.array([[3.0]]), 20)[0]
    assert values[2] >= true * (1 - 1e-9)


def test_without_input_limits_it_is_the_regulator():
    plant, spec = draw(3)
    free = any_controller(plant, replace(spec, inputs=None))
    root = np.sqrt(spec.discount)
    P = solve_discrete_are(root * plant.A, root * plant.B, spec.Q, spec.R)
    assert free.value == pytest.approx(np.trace(P @ spec.initial.second_moment), rel=1e-9) and free.holds()
    wide = any_controller(plant, replace(spec, inputs=Box([-1e3, -1e3], [1e3, 1e3])), cells=30)
    assert wide.value == pytest.approx(free.value, rel=1e-6)


def test_limits_that_leave_out_zero():
    spec = Spec(1.0, 1.0, 0.9, Box(-1, 1), Box(0.5, 1.0))
    bound = any_controller(Plant(0.5, 1.0), spec)
    nodes = (np.arange(4000) + 0.5) / 2000 - 1
    cost = simulated(Plant(0.5, 1.0), spec, lambda _, x: np.full_like(x, 0.5), nodes[None, :]).mean()
    assert bound.holds() and 0.95 * cost < bound.value <= cost


def test_it_does_not_depend_on_coordinates_or_units():
    plant, spec = draw(4, initial=Empirical(np.random.default_rng(1).standard_normal((N, 5))))
    T, units = np.random.default_rng(3).standard_normal((N, N)), np.array([1e-3, 50.0])
    back = np.linalg.inv(T)
    there = Plant(T @ plant.A @ back, T @ plant.B * units)
    inputs = Polytope.from_vertices(spec.inputs.vertices / units[:, None])
    moved = Spec(1e4 * back.T @ spec.Q @ back, 1e4 * spec.R * np.outer(units, units), 0.9,
                 Empirical(T @ spec.initial.points), inputs)
    assert any_controller(there, moved).value == pytest.approx(1e4 * any_controller(plant, spec).value, rel=1e-6)


def test_refusals_name_the_reason():
    plant, spec = draw(0)
    with pytest.raises(InvalidInputError, match="continuous"):
        any_controller(Plant(plant.A, plant.B, dt=0.0), spec)
    with pytest.raises(InvalidInputError, match="cells must be at least 1"):
        any_controller(plant, spec, cells=0)
    with pytest.raises(InvalidInputError, match="horizon must be at least 1"):
        any_controller(plant, spec, horizon=0)
    with pytest.raises(InvalidInputError, match="tol"):
        any_controller(plant, spec, tol=-1e-3)
    with pytest.raises(DimensionError):
        any_controller(TWO_STATE, spec)


def test_the_statement_rounds_down():
    bound = any_controller(TWO_STATE, TWO_STATE_SPEC, cells=100)
    figure = float(bound.statement.split("at least ")[1].split(" ")[0])
    assert bound.value - 1e-6 < figure <= bound.value and str(bound) == bound.statement
