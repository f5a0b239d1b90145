"""The best static gain: the paper's figures, published output feedback, and honest refusals in bounded time."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from inc_casadi import Box, Ellipsoid, Empirical, Gaussian, Plant, Polytope, Spec
from inc_casadi.bounds import affine_moves
from inc_casadi.errors import InfeasibleError, InvalidInputError, NotStabilizableError
from inc_casadi.linear.gain_search import evaluate
from inc_casadi.linear.static_gain import best_static_gain, scaled_lqr_gain

TWO_STATE = Plant([[1.10, 1.00], [0.0, 1.02]], [[0.20], [0.50]])
TWO_STATE_SPEC = Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box(-1, 1))


def simulated(plant, spec, F, steps=4000):
    """E cost of u = F y, from columns that carry the second moment."""
    x, total = np.linalg.cholesky(spec.initial.second_moment), 0.0
    for k in range(steps):
        u = F @ plant.C @ x
        total += spec.discount**k * (np.sum(x * (spec.Q @ x)) + np.sum(u * (spec.R @ u)))
        x = plant.A @ x + plant.B @ u
    return total


def test_the_figures_of_the_two_state_plant():
    gain = best_static_gain(TWO_STATE, TWO_STATE_SPEC)
    np.testing.assert_allclose(gain.F, [[-0.3535, -0.8965]], atol=1e-4)
    edge = minimize_scalar(lambda f: simulated(TWO_STATE, TWO_STATE_SPEC, np.array([[-f, f - 1.25]]), 600),
                           bounds=(0.2, 0.5), method="bounded", options={"xatol": 1e-9})
    assert gain.cost == pytest.approx(3.347184, abs=2e-6) and gain.cost == pytest.approx(edge.fun, rel=1e-7)
    assert gain.admissible and 0.8 * np.abs(gain.F).sum() <= 1 + 1e-9
    assert gain.cost > affine_moves(TWO_STATE, TWO_STATE_SPEC, 20).value


def test_the_scaled_regulator_of_the_two_state_plant():
    gain = scaled_lqr_gain(TWO_STATE, TWO_STATE_SPEC)
    assert gain.cost == pytest.approx(3.563892, abs=1e-6)
    assert gain.admissible and 0.8 * np.abs(gain.F).sum() == pytest.approx(1)
    unscaled = scaled_lqr_gain(TWO_STATE, Spec(np.eye(2), 0.05, 0.98, TWO_STATE_SPEC.initial))
    np.testing.assert_allclose(unscaled.F, [[-1.37488222, -2.64897412]], atol=1e-8)


@pytest.mark.parametrize("name, plant, R, F, cost", [
    ("Bemporad 2002", Plant([[0.7326, -0.0861], [0.1722, 0.9909]], [[0.0609], [0.0064]], C=[[0.0, 1.4142]]), 0.01,
     [[-1.7341993]], 11.2892747951),
    ("pendulum", Plant([[1.0, 0.02], [0.4, 0.9733333333333334]], [[0.0], [0.5333333333333333]], C=[[1.0, 0.0]]), 10.0,
     [[-0.8639109]], 395.6538443703),
])
def test_output_feedback_found_by_others(name, plant, R, F, cost):
    gain = best_static_gain(plant, Spec(np.eye(2), R, 1.0, Gaussian(np.zeros(2), np.eye(2))))
    np.testing.assert_allclose(gain.F, F, rtol=1e-5)
    assert gain.cost == pytest.approx(cost, rel=1e-9)


@pytest.mark.parametrize("dt", [0.0, 1.0])
def test_the_gradient_is_the_derivative_of_the_cost(dt):
    rng = np.random.default_rng(2)
    A = rng.standard_normal((4, 4))
    A = A - 3 * np.eye(4) if dt == 0 else 0.3 * A
    plant = Plant(A, rng.standard_normal((4, 2)), C=rng.standard_normal((3, 4)), dt=dt)
    spec = Spec(np.eye(4), np.diag([0.5, 2.0]), 1.0, Gaussian(np.zeros(4), np.diag([1.0, 2.0, 3.0, 4.0])))
    F, S0 = 0.1 * rng.standard_normal((2, 3)), spec.initial.second_moment
    cost, gradient, curvature = evaluate(plant, spec, F, S0)
    if dt:
        assert cost == pytest.approx(simulated(plant, spec, F), rel=1e-9)
    for index in np.ndindex(F.shape):
        step = np.zeros(F.shape)
        step[index] = 1e-6
        ends = [evaluate(plant, spec, F + sign * step, S0)[0] for sign in (1, -1)]
        assert (ends[0] - ends[1]) / 2e-6 == pytest.approx(gradient[index], rel=1e-6, abs=1e-6)
    assert np.linalg.eigvalsh(curvature)[0] >= 0


def test_continuous_time_by_hand():
    # x' = x + u: A_F = 1 + F, P = (Q + R F^2) / (-2 A_F); the best F is -(1 + sqrt 2) for Q = R.
    gain = best_static_gain(Plant(1.0, 1.0, dt=0.0), Spec(1.0, 1.0, 1.0, Gaussian([0.0], [[1.0]])))
    assert (gain.F[0, 0], gain.cost) == pytest.approx((-1 - np.sqrt(2), 1 + np.sqrt(2)), rel=1e-6)
    held = best_static_gain(Plant(1.0, 1.0, dt=0.0), Spec(1.0, 1.0, 1.0, Box(-1, 1), Box(-2, 2)))
    assert (held.F[0, 0], held.cost) == pytest.approx((-2.0, 2.5 / 3), rel=1e-6)


@pytest.mark.parametrize("initial", [Box([-1.0, -0.5, -2.0], [1.5, 0.5, 1.0]), Ellipsoid(np.diag([1.0, 4.0, 0.3])),
                                     Polytope.from_vertices(np.random.default_rng(0).standard_normal((3, 8))),
                                     Empirical([[1.0, 0.0], [0.0, 1.0], [2.0, 1.0]])],
                         ids=["box", "ellipsoid", "polytope", "points"])
def test_found_gains_keep_the_limits_and_cost_what_trajectories_cost(initial):
    rng = np.random.default_rng(1)
    A = rng.standard_normal((3, 3))
    plant = Plant(A * 0.99 / np.max(np.abs(np.linalg.eigvals(A))), rng.standard_normal((3, 2)), C=np.eye(3)[:2])
    spec = Spec(np.diag([1.0, 2.0, 3.0]), 0.05 * np.eye(2), 0.97, initial, Box([-0.2, -0.3], [0.3, 0.25]))
    gain = best_static_gain(plant, spec)
    states = spec.initial.sample(2000, np.random.default_rng(2))
    assert gain.admissible and np.all(spec.inputs.contains(gain.F @ plant.C @ states, 1e-8))
    moments = Spec(spec.Q, spec.R, spec.discount, Gaussian(np.zeros(3), spec.initial.second_moment + 1e-12 * np.eye(3)))
    assert gain.cost == pytest.approx(simulated(plant, moments, gain.F), rel=1e-6)
    for _ in range(40):  # no admissible gain nearby is better
        other = gain.F + 1e-2 * rng.standard_normal(gain.F.shape)
        most = np.max(np.abs(np.asarray(spec.inputs.H @ other @ plant.C @ states)), initial=0.0)
        if np.all(spec.inputs.contains(other @ plant.C @ states)) and most > 0 and not isinstance(initial, Ellipsoid):
            hull = spec.initial.vertices
            if np.all(spec.inputs.contains(other @ plant.C @ hull)):
                assert simulated(plant, moments, other, 600) >= gain.cost * (1 - 1e-7)


def test_on_a_disc_the_constraint_is_on_the_length_of_the_gain():
    spec = Spec(np.eye(2), 0.05, 0.98, Ellipsoid(np.eye(2), level=0.5), Box(-1, 1))
    around = minimize_scalar(lambda a: simulated(TWO_STATE, spec, -np.sqrt(2) * np.array([[np.cos(a), np.sin(a)]]), 600),
                             bounds=(0.9, 1.4), method="bounded", options={"xatol": 1e-8})
    gain = best_static_gain(TWO_STATE, spec)
    assert gain.admissible and np.linalg.norm(gain.F) == pytest.approx(np.sqrt(2), rel=1e-7)
    assert gain.cost == pytest.approx(around.fun, rel=1e-7)
    assert gain.cost < scaled_lqr_gain(TWO_STATE, spec).cost


def test_limits_that_leave_out_zero():
    spec = Spec(1.0, 0.0, 0.9, Box(1.0, 2.0), Box(-2.0, -0.5))
    gain = best_static_gain(Plant(1.5, 1.0), spec)
    assert gain.admissible and gain.F[0, 0] == pytest.approx(-1.0, abs=1e-7)
    with pytest.raises(InfeasibleError, match="keeps the input limits"):
        best_static_gain(Plant(1.5, 1.0), Spec(1.0, 0.0, 0.9, Box(-1.0, 2.0), Box(0.5, 1.0)))


def test_refusals_name_the_reason():
    integrators = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.0], [1.0]], C=[[1.0, 0.0]])
    square = Box([-1, -1], [1, 1])
    with pytest.raises(InfeasibleError, match="evidence, not proof"):
        best_static_gain(integrators, Spec(np.eye(2), 1.0, 1.0, square))
    with pytest.raises(InfeasibleError, match="does not show the unstable mode 1.5"):
        best_static_gain(Plant(np.diag([1.5, 0.5]), np.ones((2, 1)), C=[[0.0, 1.0]]), Spec(np.eye(2), 1.0, 1.0, square))
    with pytest.raises(NotStabilizableError, match="1.5"):
        best_static_gain(Plant(np.diag([1.5, 0.5]), [[0.0], [1.0]]), Spec(np.eye(2), 1.0, 1.0, square))
    with pytest.raises(InfeasibleError, match=r"initial state \[.*4\]"):
        best_static_gain(Plant(1.5, 1.0), Spec(1.0, 1.0, 1.0, Box(-4, 4), Box(-1, 1)))
    with pytest.raises(InvalidInputError, match="Gaussian"):
        best_static_gain(TWO_STATE, Spec(np.eye(2), 1.0, 1.0, Gaussian([0, 0], np.eye(2)), Box(-1, 1)))


def test_the_seed_decides_the_starts():
    first, again = (best_static_gain(TWO_STATE, TWO_STATE_SPEC, seed=5, starts=3) for _ in range(2))
    assert first.cost == again.cost and np.array_equal(first.F, again.F)


def test_a_time_limit_ends_the_search_with_what_it_has():
    """A gain found in no time is a start as it is: no better than the one that the search ends with, or none."""
    plant = Plant([[0.9, 0.5], [0.0, 0.8]], [[0.2], [0.5]])
    spec = Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box(-1, 1))
    quick, whole = best_static_gain(plant, spec, seconds=0.0), best_static_gain(plant, spec)
    assert quick.admissible and whole.cost < quick.cost < np.inf
    assert best_static_gain(plant, spec, seconds=1e4).cost == whole.cost
    with pytest.raises(InfeasibleError, match="6 starts in 0 s"):
        best_static_gain(Plant([[1.6, 1.0], [0.0, 1.5]], [[0.2], [0.5]], [[1.0, 0.2]]), spec, seconds=0.0)
