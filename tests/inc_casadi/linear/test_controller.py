"""The noun: its motions, its shapes, and the loop as a static law on a larger plant."""

import control
import numpy as np
import pytest
from linear_draws import case, controller, rolled

from inc_casadi import INC, Box, Empirical, Gaussian, Plant, Uniform, close_loop, simulate
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.linear.controller import LinearController
from inc_casadi.linear.dynamic_loop import dynamic_loop, started, static_form


@pytest.mark.parametrize("p", [None, 4])
def test_the_law_on_the_larger_plant_makes_the_same_motions(p):
    plant, spec = case(1, p=p, radius=0.9)
    law = controller(2, p=plant.p)
    x0 = spec.initial.vertices
    z0 = np.vstack([x0, np.tile(law.xi_0[:, None], (1, x0.shape[1]))])
    states, inputs = rolled(plant, law, x0, 30)
    run = simulate(dynamic_loop(plant, law), INC.linear(np.hstack([law.D_c, law.C_c])), z0, steps=29)
    np.testing.assert_allclose(run.x[: plant.n].transpose(2, 0, 1), states, atol=1e-12)
    np.testing.assert_allclose(run.u.transpose(2, 0, 1), inputs, atol=1e-12)


def test_the_static_form_rounds_nothing_and_closes_the_same_loop():
    plant, _ = case(3, p=4)
    law = controller(4)
    larger, gain = static_form(plant, law)
    np.testing.assert_array_equal(gain, np.block([[law.D_c, law.C_c], [law.B_c, law.A_c]]))
    assert set(larger.A.ravel()) == {0.0, *plant.A.ravel()} and set(larger.B.ravel()) == {0.0, 1.0, *plant.B.ravel()}
    loop = dynamic_loop(plant, law)
    np.testing.assert_allclose(close_loop(larger, INC.linear(gain)).F,
                               loop.A + loop.B @ np.hstack([law.D_c, law.C_c]) @ loop.C, atol=1e-14)


def test_steps_are_those_of_the_definition_for_one_point_and_for_many():
    plant, spec = case(5, p=4)
    law = controller(6)
    states, inputs = rolled(plant, law, spec.initial.vertices, 3)
    xi = np.tile(law.xi_0[:, None], (1, 8))
    for k in range(3):
        xi, u = law.step(xi, plant.C @ states[k])
        np.testing.assert_allclose(u, inputs[k], atol=1e-14)
    single = law.step(law.xi_0, plant.C @ states[0][:, 2])[1]
    np.testing.assert_allclose(single, inputs[0][:, 2], atol=1e-14)
    assert law.scaled(0.5).step(law.xi_0, plant.C @ states[0][:, 2])[1] == pytest.approx(0.5 * single)


def test_the_response_agrees_with_python_control():
    law = controller(7, m=1, p=1)
    system = control.ss(law.A_c, law.B_c, law.C_c, law.D_c, 1.0)
    read = LinearController.from_control(system, law.xi_0)
    y = np.sin(np.arange(12.0))
    expected = control.forced_response(system, np.arange(12.0), y, law.xi_0).outputs
    xi, found = read.xi_0, []
    for value in y:
        xi, u = read.step(xi, [value])
        found.append(u[0])
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_what_is_no_controller_in_discrete_time_is_refused():
    with pytest.raises(InvalidInputError, match="discrete time"):
        LinearController.from_control(control.ss([[0.0]], [[1.0]], [[1.0]], [[0.0]]))
    with pytest.raises(InvalidInputError, match="StateSpace"):
        LinearController.from_control(3.0)


@pytest.mark.parametrize("name, part", [("A_c", np.zeros((2, 3))), ("B_c", np.zeros((2, 3))), ("C_c", np.zeros((2, 3))),
                                        ("xi_0", np.zeros(3)), ("D_c", np.zeros((0, 4)))])
def test_shapes_that_do_not_fit_are_named(name, part):
    parts = {"A_c": np.zeros((2, 2)), "B_c": np.zeros((2, 4)), "C_c": np.zeros((3, 2)), "D_c": np.zeros((3, 4)),
             "xi_0": np.zeros(2)}
    assert LinearController(**parts).order == 2
    with pytest.raises(DimensionError, match=name):
        LinearController(**(parts | {name: part}))


def test_numbers_are_frozen_and_finite():
    with pytest.raises(InvalidInputError, match="C_c"):
        LinearController([[0.0]], [[1.0]], [[np.nan]], [[0.0]])
    law = LinearController.static([[1.0, 2.0]])
    assert (law.order, law.m, law.p) == (0, 1, 2)
    with pytest.raises(ValueError, match="read-only"):
        law.D_c[0, 0] = 3.0


def test_a_controller_for_another_plant_is_refused():
    with pytest.raises(DimensionError, match="1 measurements"):
        dynamic_loop(Plant(1.0, 1.0), controller(8))


@pytest.mark.parametrize("initial", [Uniform(Box([-1.0, 0.0], [1.0, 3.0])), Gaussian([1.0, 2.0], [[2.0, 0.3], [0.3, 1.0]]),
                                     Empirical([[1.0, 2.0, 4.0], [0.0, 1.0, 1.0]], [1, 2, 3])])
def test_the_moments_beside_a_fixed_state(initial):
    law = controller(9, order=2)
    pair = started(initial, law)
    draws = pair.sample(5, np.random.default_rng(0))
    np.testing.assert_array_equal(draws[2:], np.tile(law.xi_0[:, None], (1, 5)))
    nodes, weights = pair.quadrature(2)
    np.testing.assert_allclose((nodes * weights) @ nodes.T, pair.second_moment, atol=1e-12)
    np.testing.assert_allclose(nodes @ weights, pair.mean, atol=1e-12)
    assert pair.dimension == 4 and pair.support is None and np.linalg.matrix_rank(pair.covariance) == 2
