"""A plant is what it says: its sizes, its conversions, its sampling, and the modes that no controller reaches."""

import subprocess
import sys

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from inc_casadi.errors import DimensionError, InvalidInputError, SolverError
from inc_casadi.plant import Plant, as_plant

A = np.array([[0.5, 1.0, 0.0], [0.0, -0.3, 0.2], [0.1, 0.0, 1.1]])
B = np.array([[0.0, 1.0], [1.0, 0.0], [0.5, -0.2]])
C = np.array([[1.0, 0.0, 2.0]])
T = np.array([[1.0, 2.0, 0.5], [0.3, -1.0, 0.7], [0.2, 0.4, 1.5]])


def in_other_coordinates(modes, inputs):
    return T @ modes @ np.linalg.inv(T), T @ np.asarray(inputs, dtype=float)


def test_sizes_are_read_from_the_matrices():
    plant = Plant(A, B, C, dt=0.2)
    assert (plant.n, plant.m, plant.p, plant.dt, plant.discrete, plant.full_state) == (3, 2, 1, 0.2, True, False)


def test_the_output_is_the_state_by_default():
    plant = Plant(A, B, dt=0)
    assert plant.full_state and not plant.discrete
    np.testing.assert_array_equal(plant.C, np.eye(3))
    assert not Plant(A, B, np.eye(3)[[1, 0, 2]]).full_state


def test_a_plant_cannot_be_changed():
    entries = A.copy()
    plant = Plant(entries, B)
    entries[0, 0] = 9.0
    assert plant.A[0, 0] == 0.5
    with pytest.raises(ValueError, match="read-only"):
        plant.A[0, 0] = 9.0
    with pytest.raises(AttributeError):
        plant.dt = 2.0


@pytest.mark.parametrize(("arguments", "error", "message"), [
    ((A[:2], B), DimensionError, r"A has shape \(2, 3\)"),
    ((np.zeros((0, 0)), np.zeros((0, 1))), DimensionError, "at least one state"),
    ((A, B[:2]), DimensionError, "B has shape"),
    ((A, B[:, 0]), DimensionError, "B has shape"),
    ((A, np.zeros((3, 0))), DimensionError, "at least one input"),
    ((A, B, np.ones((2, 2))), DimensionError, "C has shape"),
    ((A, B, np.zeros((0, 3))), DimensionError, "at least one output"),
    ((A * np.nan, B), InvalidInputError, "A holds a NaN"),
    ((A, np.full((3, 2), np.inf)), InvalidInputError, "B holds a NaN or an infinity"),
    ((A, B, C * np.nan), InvalidInputError, "C holds"),
    ((A, B, C, -0.1), InvalidInputError, "dt = -0.1"),
    ((A, B, C, np.inf), InvalidInputError, "dt holds"),
    ((A, B, C, None), InvalidInputError, "give dt=0 for continuous time"),
    (("A", B), InvalidInputError, "A is not an array"),
])
def test_a_bad_plant_is_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        Plant(*arguments)


def test_conversion_to_python_control_and_back_keeps_every_number():
    plant = Plant(A, B, C, dt=0.2)
    back = as_plant(plant.to_control())
    for name in "ABC":
        np.testing.assert_array_equal(getattr(back, name), getattr(plant, name))
    assert back.dt == 0.2
    assert plant.to_control().poles() == pytest.approx(np.linalg.eigvals(A))


def test_python_control_period_conventions():
    def system(dt):
        return control.StateSpace(A, B, C, np.zeros((1, 2)), dt)

    assert Plant.from_control(system(True)).dt == 1.0
    assert Plant.from_control(system(0)).dt == 0.0
    with pytest.raises(InvalidInputError, match="dt is None"):
        Plant.from_control(system(None))


def test_direct_feedthrough_is_refused():
    with pytest.raises(InvalidInputError, match=r"magnitude 0\.25.*strictly proper"):
        Plant.from_control(control.StateSpace(A, B, C, [[0.0, -0.25]], 1.0))


@pytest.mark.parametrize(("value", "message"), [
    (A, "not ndarray"), (None, "not NoneType"), (control.tf([1.0], [1.0, 2.0]), r"TransferFunction.*control\.ss"),
])
def test_something_else_is_no_plant(value, message):
    with pytest.raises(InvalidInputError, match=message):
        as_plant(value)


def test_a_missing_python_control_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(SolverError, match="pip install control"):
        Plant(A, B).to_control()


def test_the_module_loads_numpy_only():
    code = ("import sys, inc_casadi.plant as p, inc_casadi.sets, inc_casadi.spec; p.as_plant(p.Plant(1., 1.));"
            "print([m for m in ('scipy', 'control', 'cvxpy', 'casadi', 'matplotlib') if m in sys.modules])")
    outcome = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert outcome.stdout.strip() == "[]"


def test_sampling_reproduces_the_trajectory_under_a_held_input():
    plant, period, x0, u = Plant(A, B, C, dt=0), 0.7, np.array([1.0, -2.0, 0.5]), np.array([0.3, -1.0])
    sampled = plant.sampled(period)
    flow = solve_ivp(lambda t, x: A @ x + B @ u, (0, period), x0, rtol=1e-11, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(sampled.A @ x0 + sampled.B @ u, flow, rtol=1e-8)
    assert sampled.dt == period
    np.testing.assert_array_equal(sampled.C, C)


def test_sampling_by_hand():
    sampled = Plant(-2.0, 3.0, dt=0).sampled(0.5)
    assert sampled.A[0, 0] == pytest.approx(np.exp(-1.0), rel=1e-14)
    assert sampled.B[0, 0] == pytest.approx(1.5 * (1 - np.exp(-1.0)), rel=1e-14)


def test_sampling_wants_continuous_time_and_a_positive_period():
    with pytest.raises(InvalidInputError, match="sampled already, with dt = 1"):
        Plant(A, B).sampled(0.1)
    for period in (0.0, -1.0, np.nan):
        with pytest.raises(InvalidInputError, match="dt"):
            Plant(A, B, dt=0).sampled(period)


@pytest.mark.parametrize(("modes", "inputs", "expected"), [
    ([1.5, 0.9, -2.0], [0, 0, 1], [1.5]),  # an unstable mode without input; a stable one does not count
    ([1.5, 0.9, -2.0], [0, 1, 0], [-2.0, 1.5]),
    ([1.5, 0.9, -2.0], [1, 0, 1], []),
    ([1.0, 0.5, -1.0], [0, 1, 0], [-1.0, 1.0]),  # on the boundary is not stable
    ([1.0 + 1e-9, 0.5, 1.0 - 1e-9], [0, 1, 0], [1.0 + 1e-9]),
])
def test_unreached_unstable_modes_in_discrete_time(modes, inputs, expected):
    plant = Plant(*in_other_coordinates(np.diag(modes), np.array(inputs)[:, None]))
    found = sorted(value.real for value in plant.unstabilizable_modes())
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_unreached_oscillation_in_both_kinds_of_time():
    rotation = np.zeros((3, 3))
    rotation[:2, :2] = [[0.6, -0.8], [0.8, 0.6]]
    discrete = Plant(*in_other_coordinates(rotation, [[0.0], [0.0], [1.0]]))
    assert sorted(discrete.unstabilizable_modes(), key=np.imag) == pytest.approx([0.6 - 0.8j, 0.6 + 0.8j])
    swing = np.zeros((3, 3))
    swing[:2, :2] = [[0.0, -2.0], [2.0, 0.0]]
    swing[2, 2] = -1.0
    continuous = Plant(*in_other_coordinates(swing, [[0.0], [0.0], [1.0]]), dt=0)
    assert sorted(continuous.unstabilizable_modes(), key=np.imag) == pytest.approx([-2j, 2j])
    assert Plant(continuous.A - 1e-6 * np.eye(3), continuous.B, dt=0).unstabilizable_modes() == []


def test_an_unreached_mode_in_a_double_eigenvalue_is_found():
    chain = np.array([[1.2, 1.0, 0.0], [0.0, 1.2, 0.0], [0.0, 0.0, 0.3]])
    reached = Plant(*in_other_coordinates(chain, [[0.0], [1.0], [0.0]]))
    unreached = Plant(*in_other_coordinates(chain, [[1.0], [0.0], [0.0]]))
    assert reached.unstabilizable_modes() == []
    assert unreached.unstabilizable_modes() == pytest.approx([1.2, 1.2], abs=1e-6)


def test_two_equal_modes_need_two_inputs():
    twins = Plant(np.diag([2.0, 2.0]), [[1.0], [3.0]])
    assert len(twins.unstabilizable_modes()) > 0
    assert Plant(np.diag([2.0, 2.0]), [[1.0, 0.0], [3.0, 1.0]]).unstabilizable_modes() == []


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_the_unit_of_the_input_does_not_matter(unit):
    assert Plant(1.5, unit).unstabilizable_modes() == []
    assert Plant(1.5, 1.0, C=unit).undetectable_modes() == []
    assert Plant(np.diag([1.5, 2.0]), [[unit], [0.0]]).unstabilizable_modes() == [2.0]


def test_a_plant_without_dynamics_or_input():
    assert Plant(0.0, 0.0, dt=0).unstabilizable_modes() == [0.0]
    assert Plant(0.0, 1e-3, dt=0).unstabilizable_modes() == []
    assert Plant(0.0, 0.0, dt=1).unstabilizable_modes() == []


def test_modes_the_output_does_not_show():
    plant = Plant(np.diag([1.5, 0.9, -2.0]), np.ones((3, 2)), C=[[0.0, 1.0, 1.0]])
    assert plant.undetectable_modes() == [1.5]
    assert Plant(plant.A, plant.B).undetectable_modes() == []


def test_a_mode_is_shown_through_the_states_it_drives():
    chain = [[1.5, 0.0], [1.0, 1.2]]  # the first state drives the second
    assert Plant(chain, np.ones((2, 1)), C=[[0.0, 1.0]]).undetectable_modes() == []
    assert Plant(chain, np.ones((2, 1)), C=[[1.0, 0.0]]).undetectable_modes() == pytest.approx([1.2])


def test_the_margin_is_a_relative_singular_value():
    nearly = Plant(np.diag([2.0, 1.0]), [[1e-4], [1.0]])
    assert nearly.unstabilizable_modes() == []
    assert nearly.unstabilizable_modes(margin=1e-3) == [2.0]
    with pytest.raises(InvalidInputError, match="margin"):
        nearly.unstabilizable_modes(margin=-1.0)
