"""Controllers as python-control systems: their simulations against ours, and gains with the sign that they have there."""

import control
import numpy as np
import pytest

from inc_casadi import INC, Box, Plant, Tanh, simulate
from inc_casadi.errors import InvalidInputError, NotWellPosedError
from inc_casadi.interchange import from_lqr, to_control

A, B, C = np.array([[1.1, 1.0], [0.0, 1.02]]), np.array([[0.2], [0.5]]), np.eye(2)
IMPLICIT = INC(
    [[0.2, -0.3], [0.1, 0.0]], [[1.0, 0.5], [-0.4, -1.0]], [[-0.5, 0.6]], [[-0.3, -0.6]], b=[0.0, 0.05], activation=Tanh()
)


def loop(law, dt, A=A, B=B):
    plant = control.ss(A, B, C, np.zeros((2, 1)), dt, inputs=["u[0]"], outputs=["y[0]", "y[1]"], name="plant")
    return control.interconnect([plant, to_control(law, dt)], inputs=[], outputs=["y[0]", "y[1]", "u[0]"])


@pytest.mark.parametrize("law", [INC.saturated([[-1.1, -2.0]], 1.0), IMPLICIT], ids=["saturated", "implicit"])
@pytest.mark.parametrize("dt", [1.0, True])
def test_a_discrete_loop_moves_as_ours_does(law, dt):
    found = control.input_output_response(loop(law, dt), np.arange(20.0), 0, [0.5, -0.2])
    ours = simulate(Plant(A, B), law, [0.5, -0.2], steps=19)
    np.testing.assert_allclose(found.outputs, np.vstack([ours.x, ours.u]), rtol=1e-12, atol=1e-12)


def test_a_continuous_loop_moves_as_ours_does():
    A, B = np.array([[0.0, 1.0], [1.0, -0.5]]), np.array([[0.0], [1.0]])
    law, times = INC.saturated([[-3.0, -2.0]], 1.0), np.linspace(0.0, 5.0, 51)
    found = control.input_output_response(loop(law, 0, A, B), times, 0, [0.4, -0.1],
                                          solve_ivp_kwargs={"rtol": 1e-9, "atol": 1e-12})
    ours = simulate(Plant(A, B, dt=0.0), law, [0.4, -0.1], times=times)
    np.testing.assert_allclose(found.outputs, np.vstack([ours.x, ours.u]), atol=1e-6)


def test_dt_left_open_fits_every_plant_and_names_are_given():
    system = IMPLICIT.to_control(name="law", inputs=["position", "speed"], outputs=["force"])
    assert system.dt is None and (system.input_labels, system.output_labels) == (["position", "speed"], ["force"])
    assert system.name == "law" and system.nstates == 0
    with pytest.raises(InvalidInputError, match="inputs names 1 signals, but the controller has 2"):
        to_control(IMPLICIT, inputs=["one"])
    with pytest.raises(InvalidInputError, match="list"):
        to_control([1.0])
    with pytest.raises(NotWellPosedError):
        to_control(INC([[2.0]], [[1.0]], [[1.0]], [[0.0]]))


@pytest.mark.parametrize("design", [control.dlqr, lambda A, B, Q, R: control.dlqr(control.ss(A, B, C, 0, 1.0), Q, R)])
def test_a_regulator_of_theirs_stabilizes_here(design):
    gain = design(A, B, np.eye(2), [[0.1]])
    for given in (gain, gain[0]):
        law = INC.from_lqr(given)
        np.testing.assert_array_equal(law.K, -gain[0])
        assert np.max(np.abs(np.linalg.eigvals(A + B @ law.K))) < 1
    clipped = from_lqr(gain, Box([-1.0], [0.5]))
    assert clipped([9.0, 9.0]).tolist() == [-1.0] and clipped([-9.0, -9.0]).tolist() == [0.5]


def test_a_continuous_regulator_of_theirs_stabilizes_here():
    A, B = [[0.0, 1.0], [1.0, 0.0]], [[0.0], [1.0]]
    law = from_lqr(control.lqr(A, B, np.eye(2), [[1.0]]))
    assert np.max(np.linalg.eigvals(np.array(A) + np.array(B) @ law.K).real) < 0


def test_what_is_no_gain():
    with pytest.raises(InvalidInputError):
        from_lqr("K")
    with pytest.raises(InvalidInputError):
        from_lqr(np.full((1, 2), np.nan))
