"""The explicit start: the solution of its program on the box, within limits outside, refused where it is too large."""

import numpy as np
import pytest

from inc_casadi import Box, Plant, Spec
from inc_casadi.errors import InvalidInputError
from synthesis.gate import gate
from synthesis.starts.explicit import explicit_start
from synthesis.starts.predictive import predictive_start


@pytest.fixture
def problem():
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[2.0, 1.0], [0.5, -1.0]])
    return plant, Spec(np.eye(2), 0.1, 0.95, Box([-3, -1.5], [3, 1.5]), Box(-0.5, 0.4))


def test_the_start_is_the_solution_of_its_program(problem):
    plant, spec = problem
    start = explicit_start(plant, spec, 3)
    rng = np.random.default_rng(0)
    x = rng.uniform(start.region.lower[:, None], start.region.upper[:, None], (2, 25))
    u = np.stack([start.mpc.solve(point)[0] for point in x.T], axis=1)
    assert np.any(u > 0.4 - 1e-6) and np.any(np.abs(u) < 0.3)
    assert start.inc(plant.C @ x) == pytest.approx(u, abs=1e-6)
    assert start.inc.contraction.radius == 0.0  # W is nilpotent


def test_motions_stay_where_the_law_is_exact(problem):
    plant, spec = problem
    start, same = explicit_start(plant, spec, 3), predictive_start(plant, spec, horizon=3)
    x = spec.initial.vertices
    for _ in range(40):
        assert np.all(start.region.contains(x)) and start.inc(plant.C @ x) == pytest.approx(same.inc(plant.C @ x), abs=1e-9)
        x = plant.A @ x + plant.B @ start.inc(plant.C @ x)
    assert start.cost == pytest.approx(same.cost, rel=1e-9)


def test_limits_are_kept_outside_the_box():
    plant = Plant([[-0.97, -1.07], [-0.02, -0.33]], [[-0.93, 0.41], [1.22, -0.07]])
    limits = Box([-0.4, -0.2], [0.3, 0.4])
    spec = Spec(np.diag([1.0, 2.0]), np.diag([0.3, 0.1]), 0.9, Box([-2, -1], [2, 1]), limits)
    start = explicit_start(plant, spec, 2)
    far = 1e4 * np.random.default_rng(1).normal(size=(2, 50))
    assert np.max(np.abs(start.representation.inc(far))) > 10 and np.all(limits.contains(start.inc(far)))


def test_it_is_certified_at_the_cost_of_the_fixed_point(problem):
    costs = [gate(*problem, law.inc).cost for law in (explicit_start(*problem, 3), predictive_start(*problem, horizon=3))]
    assert costs[0] == pytest.approx(costs[1], rel=1e-9) and np.isfinite(costs[0])


def test_what_does_not_fit_is_refused(problem):
    plant, spec = problem
    with pytest.raises(InvalidInputError, match="units, but 2 are allowed: as a fixed point it takes 4"):
        explicit_start(plant, spec, 4, units=2)
    with pytest.raises(InvalidInputError, match="not all listed: the time limit"):
        explicit_start(plant, spec, 9, seconds=0.0)
    with pytest.raises(InvalidInputError, match="does not give it"):
        explicit_start(Plant(plant.A, plant.B, plant.C[:1]), spec, 2)
    with pytest.raises(InvalidInputError, match="loses some initial states"):
        explicit_start(Plant(2.0 * plant.A, plant.B), Spec(np.eye(2), 0.1, 0.95, Box([-9, -9], [9, 9]), Box(-0.5, 0.4)), 2)
