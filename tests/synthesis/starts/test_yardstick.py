"""The yardstick: published costs, a hand case, an oracle for sequences, and unstable plants."""

import draws
import numpy as np
import oracles
import pytest

from inc_casadi import INC, Box, Plant, Polytope, Spec
from inc_casadi.errors import InvalidInputError
from synthesis.starts.yardstick import yardstick


@pytest.fixture
def problem():
    rng = np.random.default_rng(3)
    plant = draws.plant(rng, n=3, m=2, p=3, radius=1.05)
    spec = Spec(np.diag([1.0, 2.0, 0.5]), np.diag([0.3, 0.1]), 0.9, Box([-2, -1, -3], [2, 1, 3]),
                Box([-0.6, -0.2], [0.6, 0.2]))
    return plant, spec


def test_the_optimum_is_that_of_a_general_method(problem):
    plant, spec = problem
    x0 = np.array([[1.5, -0.4], [0.7, 0.9], [-2.0, 1.0]])
    ends = yardstick(plant, spec, x0, steps=7)
    assert ends.optimum == pytest.approx([oracles.least_sequence(plant, spec, ends.P, x, 7).fun for x in x0.T], rel=1e-6)


def test_the_regulator_by_hand():
    # x+ = x + u, |u| <= 1, Q = R = 1, one step: K = -1/golden ratio clips x = 3 to u = -1, then P = golden ratio.
    golden = (1 + np.sqrt(5)) / 2
    spec = Spec(1.0, 1.0, 1.0, Box(-3, 3), Box(-1, 1))
    ends = yardstick(Plant(1.0, 1.0), spec, [3.0], steps=1)
    assert ends.regulator == pytest.approx([9 + 1 + golden * 4]) and ends.closed(INC.linear([[0.0]])) == 1.0


def test_the_share_that_a_law_closes(problem):
    plant, spec = problem
    ends = yardstick(plant, spec, samples=20, seed=1)
    state = np.linalg.inv(plant.C)
    clipped = INC.linear(ends.K @ state).with_saturated_output(spec.inputs)
    assert ends.costs(clipped) == pytest.approx(ends.regulator) and ends.closed(clipped) == pytest.approx(0.0, abs=1e-9)
    assert np.all(ends.optimum <= ends.regulator * (1 + 1e-9)) and ends.optimum.mean() < 0.995 * ends.regulator.mean()
    assert ends.closed(INC.linear(np.zeros((2, 3)))) < 0


def test_long_sequences_of_an_unstable_plant_are_shortened():
    plant = Plant([[1.9, 1.0, 0.0], [0.0, 1.6, 0.3], [0.0, 0.0, 0.5]], [[0.0], [1.0], [0.4]])
    spec = Spec(np.eye(3), 1.0, 1.0, Box([-0.4] * 3, [0.4] * 3), Box(-1, 1))
    ends, short = (yardstick(plant, spec, samples=30, steps=steps) for steps in (200, 4))
    assert np.all(ends.optimum <= ends.regulator * (1 + 1e-9))
    assert np.all(ends.optimum >= short.optimum * (1 - 1e-9))  # more moves cost more
    free = np.sum(ends.x0 * (ends.P @ ends.x0), axis=0)
    assert np.max(ends.optimum / free) > 1.15 and np.max(ends.regulator / free) > 1.3


def test_states_that_the_regulator_loses_are_left_out_of_the_share():
    # x+ = 2 x + u, |u| <= 1: the regulator keeps |x| < 1 and loses the rest, which no law could bring back.
    spec = Spec(1.0, 1.0, 1.0, Box(-2, 2), Box(-1, 1))
    ends = yardstick(Plant(2.0, 1.0), spec, [[0.9, -0.7, 1.5]])
    assert np.isinf(ends.regulator).tolist() == [False, False, True]
    assert ends.closed(INC.saturated(ends.K, 1.0)) == pytest.approx(yardstick(Plant(2.0, 1.0), spec, [[0.9, -0.7]]).closed(
        INC.saturated(ends.K, 1.0)))


def test_a_lost_motion_costs_infinitely_much():
    spec = Spec(1.0, 1.0, 1.0, Box(-9, 9), Box(-1, 1))
    assert yardstick(Plant(2.0, 1.0), spec, [5.0], steps=2000).costs(INC.linear([[0.0]])).tolist() == [np.inf]


def test_the_same_seed_draws_the_same_states(problem):
    one, same, other = (yardstick(*problem, samples=4, seed=seed).x0 for seed in (1, 1, 2))
    assert np.array_equal(one, same) and not np.array_equal(one, other)


@pytest.mark.parametrize("inputs", [None, Polytope([[1], [-1]], [1, 1])])
def test_inputs_other_than_a_box_are_refused(inputs):
    with pytest.raises(InvalidInputError, match="needs a Box"):
        yardstick(Plant(1.1, 1.0), Spec(1.0, 1.0, 1.0, Box(-1, 1), inputs))


def test_continuous_time_is_refused():
    with pytest.raises(InvalidInputError, match="sampled"):
        yardstick(Plant(1.1, 1.0, dt=0.0), Spec(1.0, 1.0, 1.0, Box(-1, 1), Box(-1, 1)))
