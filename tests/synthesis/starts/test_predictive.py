"""The predictive start: pointwise the solution of its program, cheaper with the horizon, and refused with a reason."""

from dataclasses import replace

import draws
import numpy as np
import oracles
import pytest

from inc_casadi import Box, Plant, Polytope, Spec
from inc_casadi.errors import InvalidInputError
from inc_casadi.linear.regulator import discounted_lqr
from synthesis.gate import gate
from synthesis.starts.predictive import predictive_start, why_not


@pytest.fixture
def problem():
    rng = np.random.default_rng(4)
    plant = draws.plant(rng, n=3, m=2, p=3, radius=1.05)
    spec = Spec(np.diag([1.0, 2.0, 0.5]), np.diag([0.3, 0.1]), 0.9, Box([-2, -1, -3], [2, 1, 3]),
                Box([-0.6, -0.2], [0.4, 0.3]))
    return plant, spec


def two_integrators(half=(3.0, 1.5)):
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]])
    return plant, Spec(np.eye(2), 0.1, 0.95, Box(-np.array(half), np.array(half)), Box(-0.5, 0.5))


def test_the_start_is_the_solution_of_its_program(problem):
    plant, spec = problem
    start = predictive_start(plant, spec, horizon=4)
    _, P = discounted_lqr(plant, spec)
    x = spec.initial.sample(12, np.random.default_rng(0))
    u = start.inc(plant.C @ x)
    expected = np.stack([oracles.least_sequence(plant, spec, P, point, 4).x[:plant.m] for point in x.T], axis=1)
    limits = spec.inputs.lower[:, None], spec.inputs.upper[:, None]
    assert np.any(u == limits[0]) and np.any((u > limits[0]) & (u < limits[1]))
    assert start.inc.q == 8 and u == pytest.approx(expected, abs=1e-5)


def test_a_given_terminal_weight_is_used(problem):
    plant, spec = problem
    P, x = np.diag([3.0, 0.0, 1.0]), np.array([0.3, -0.2, 0.4])
    start = predictive_start(plant, spec, horizon=2, terminal=P)
    assert start.inc(plant.C @ x) == pytest.approx(oracles.least_sequence(plant, spec, P, x, 2).x[:plant.m], abs=1e-5)


def test_costs_are_ordered():
    plant, spec = two_integrators()
    start = predictive_start(plant, spec, tol=1e-6)
    ends = start.yardstick
    assert ends.optimum.mean() * (1 - 1e-9) <= start.cost < 0.998 * ends.regulator.mean()
    assert start.tried[0][2] == pytest.approx(ends.regulator.mean(), rel=1e-9)  # one input, one step: the clipped LQR
    assert [cost for _, _, cost in start.tried] == sorted((cost for _, _, cost in start.tried), reverse=True)


def test_the_shortest_horizon_that_is_as_good_is_taken():
    plant, spec = two_integrators()
    close, loose = (predictive_start(plant, spec, tol=tol) for tol in (1e-6, 0.1))
    assert (loose.horizon, close.horizon) == (1, 3) and "No input sequence is better" in close.note
    few = predictive_start(plant, spec, units=2, tol=1e-6)
    assert few.horizon == 2 and "No longer horizon fits" in few.note
    middle = predictive_start(plant, spec, tol=0.0031)  # one step is 0.302 % above two, and 0.315 % above the optimum
    assert len(middle.tried) == 2 and middle.horizon == 1


def test_no_more_units_are_tried_than_allowed(problem):
    start = predictive_start(*problem, units=5, tol=0.0)
    assert [units for _, units, _ in start.tried] == [2, 4]


@pytest.mark.slow
def test_a_predictive_start_is_certified_below_the_clipped_regulator():
    plant, spec = two_integrators()
    start = predictive_start(plant, spec, tol=1e-6)
    verdict = gate(plant, spec, start.inc)
    clipped = predictive_start(plant, spec, horizon=1).inc
    assert verdict.accepted and verdict.cost < gate(plant, spec, clipped).cost - 0.04 and verdict.certificate.prove()


def test_the_sentence_says_what_is_closed():
    assert "100 % of the gap is closed" in predictive_start(*two_integrators(), tol=1e-6).sentence


def changed(**parts):
    plant, spec = two_integrators()
    return parts.pop("plant", plant), replace(spec, **parts)


@pytest.mark.parametrize(("problem", "reason"), [
    (changed(plant=Plant(np.eye(2), np.ones((2, 1)), dt=0.0)), "continuous"),
    (changed(inputs=None), "is the LQR"),
    (changed(inputs=Polytope([[1], [-1]], [1, 1])), "Polytope"),
    (changed(plant=Plant(np.eye(2), np.ones((2, 1)), [[1.0, 0.0]])), "C .1 x 2. does not give it"),
    (changed(plant=Plant(np.eye(2), np.ones((2, 1)), [[1.0, 1.0], [1.0, 1.0]])), "C .2 x 2. does not give it"),
    (changed(R=np.zeros((1, 1))), "R is singular"),
])
def test_a_refusal_says_why(problem, reason):
    with pytest.raises(InvalidInputError, match=reason):
        predictive_start(*problem)


def test_too_few_units_are_refused(problem):
    assert why_not(*problem, 2) == "" and "takes m = 2 units, but only 1" in why_not(*problem, 1)
