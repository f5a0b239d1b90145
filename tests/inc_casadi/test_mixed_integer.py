"""Mixed-integer programs over the graph of a controller: by hand, with limits of time, and what they refuse."""

import numpy as np
import pytest

from inc_casadi import INC, Box, Plant, Polytope, ReLU, Saturation, Tanh
from inc_casadi.claims import Invariance
from inc_casadi.errors import InvalidInputError
from inc_casadi.mixed_integer import program, slacks_by_programs

PLANT = Plant([[1.0]], [[1.0]])


def test_an_implicit_relu_by_hand():
    """eta = max(x - 3 eta, 0) is max(x, 0) / 4, so u = -2 eta reaches -1 and x+ = x - max(x, 0) / 2 is in [-2, 1]."""
    inc = INC([[-3.0]], [[1.0]], [[-2.0]], [[0.0]])
    found = slacks_by_programs(PLANT, inc, Invariance(Box([-2.0], [2.0]), Box([-1.5], [0.5])))
    assert found.least == pytest.approx([0.5, 0.5, 1.0, 0.0], abs=1e-6)
    assert found.reached == pytest.approx(found.least, abs=1e-6) and found.ended == ""
    assert found.points[1] == pytest.approx([2.0]) and found.points[3] == pytest.approx([-2.0])


def test_only_kinks_that_can_be_met_take_a_binary():
    inc = INC(np.zeros((3, 3)), [[1.0], [1.0], [4.0]], np.ones((1, 3)), [[0.0]], [5.0, 0.0, 0.0], None,
              (Saturation(), Saturation(), Saturation()))
    # z is in [4, 6], in [-1, 1] with kinks at its ends only (and a hair beyond), and in [-4, 4].
    integral = program(PLANT, inc, Invariance(Box([-0.9], [0.9]))).integral
    assert integral.sum() == 2


def test_points_of_the_program_satisfy_the_equations():
    rng = np.random.default_rng(0)
    inc = INC([[0.2, -0.4], [0.3, 0.1]], rng.normal(size=(2, 2)), rng.normal(size=(1, 2)), np.zeros((1, 2)), [0.1, -0.2],
              [0.3], (ReLU(), Saturation()))
    plant = Plant([[0.5, 0.2], [0.1, 0.4]], [[1.0], [0.5]])
    region = Polytope([[1.0, 1.0], [-1.0, 0.3], [0.2, -1.0]], [1.0, 1.0, 1.0])
    found = slacks_by_programs(plant, inc, Invariance(region))
    x = found.points.T
    after = plant.A @ x + plant.B @ inc(x)
    assert np.diag(region.h[:, None] - region.H @ after) == pytest.approx(found.least, abs=1e-5)
    assert np.all(region.contains(x, tol=1e-6))


def test_no_time_gives_no_bounds():
    found = slacks_by_programs(PLANT, INC.saturated([[1.0]], 0.5), Invariance(Box([-1.0], [1.0])), seconds=0.0)
    assert np.all(found.least == -np.inf) and "time limit of 0 s" in found.ended and np.all(found.reached == np.inf)


def test_curved_units_are_refused():
    with pytest.raises(InvalidInputError, match=r"unit 0 has activation Tanh\(\), which is not piecewise affine"):
        program(PLANT, INC([[0.0]], [[1.0]], [[1.0]], [[0.0]], activation=Tanh()), Invariance(Box([-1.0], [1.0])))
