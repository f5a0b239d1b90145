"""Imitation: lessons along a motion, the weighted error by hand, teachers that a student can equal, refusals."""

from dataclasses import replace

import draws
import numpy as np
import pytest

from inc_casadi import INC, Box, Empirical, Plant, Polytope, ReLU, Saturation, Spec
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.linear.regulator import discounted_lqr
from synthesis.starts.imitation import Lessons, imitate, lessons
from synthesis.starts.random_start import linear_start, random_start


@pytest.fixture
def problem():
    plant = draws.plant(np.random.default_rng(5), n=3, m=2, p=4)
    spec = Spec(np.diag([1.0, 2.0, 0.5]), np.diag([0.3, 0.1]), 0.8, Box([-2, -1, -3], [2, 1, 3]),
                Box([-0.6, -0.2], [0.4, 0.3]))
    return plant, spec


def clipped(law, spec):
    return lambda y: np.clip(law(y), spec.inputs.lower[:, None], spec.inputs.upper[:, None])


def test_lessons_follow_a_motion_with_discounted_weights(problem):
    plant, spec = problem
    spec = replace(spec, initial=Empirical(np.array([[1.0, 0.0], [0.5, 2.0], [-1.0, 0.0]]), [3, 1]))
    K = np.random.default_rng(0).normal(size=(2, 4)) / 9
    taught = lessons(plant, spec, lambda y: K @ y, along=lambda y: -K @ y, points=30)
    x = np.array([[1.0, 0.0], [0.5, 2.0], [-1.0, 0.0]])
    after = plant.A @ x - plant.B @ K @ plant.C @ x
    assert taught.y[:, :4] == pytest.approx(plant.C @ np.hstack([x, after])) and taught.u == pytest.approx(K @ taught.y)
    assert taught.weights[1:4] / taught.weights[0] == pytest.approx([1 / 3, 0.8, 0.8 / 3])
    assert taught.weights.sum() == pytest.approx(1.0)


def test_the_error_is_weighed_by_what_a_wrong_input_costs(problem):
    plant, spec = problem
    rng = np.random.default_rng(1)
    taught = Lessons(rng.normal(size=(4, 7)), rng.uniform(-0.2, 0.2, (2, 7)), rng.dirichlet(np.ones(7)))
    start = random_start(plant, spec, 3, seed=2)
    found = imitate(plant, spec, taught, start, iterations=15)
    _, P = discounted_lqr(plant, spec)
    M = spec.R + 0.8 * plant.B.T @ P @ plant.B

    def error(law):
        off = clipped(law, spec)(taught.y) - taught.u
        return np.einsum("in,ij,jn,n->", off, M, off, taught.weights)
    size = np.einsum("in,ij,jn,n->", taught.u, M, taught.u, taught.weights)
    assert found.start_error == pytest.approx(error(start) / size, rel=1e-9)
    assert found.error == pytest.approx(error(found.inner) / size, rel=1e-9) and found.error < 0.5 * found.start_error


def test_without_limits_the_error_along_a_motion_is_what_it_costs():
    # J(law) - x'P x = sum beta^k (u - K x)'M (u - K x) along the motion of the law.
    plant = draws.plant(np.random.default_rng(6), n=3, m=2, p=3, radius=0.9)
    spec = Spec(np.diag([1.0, 2.0, 0.5]), np.diag([0.3, 0.1]), 0.8, Box([-2, -1, -3], [2, 1, 3]))
    K, P = discounted_lqr(plant, spec)
    M = spec.R + 0.8 * plant.B.T @ P @ plant.B
    x, cost, error = np.array([1.0, -0.5, 2.0]), 0.0, 0.0
    first = x @ P @ x
    for k in range(300):
        u = np.tanh(0.7 * K @ x)
        cost += 0.8**k * (x @ spec.Q @ x + u @ spec.R @ u)
        error += 0.8**k * (u - K @ x) @ M @ (u - K @ x)
        x = plant.A @ x + plant.B @ u
    assert cost - first == pytest.approx(error, rel=1e-9)


@pytest.mark.parametrize("unit", [ReLU(), Saturation()])
def test_a_teacher_of_the_same_kind_is_found(unit):
    plant = Plant([[0.9, 0.3], [0.0, 0.8]], [[0.5], [1.0]])
    spec = Spec(np.eye(2), 0.1, 0.9, Box([-3, -1], [3, 1]), Box(-2, 2))
    teacher = INC([[0.0]], [[1.0, 0.5]], [[-0.8]], [[-0.2, -0.3]], activation=unit)
    start = INC([[0.2]], [[0.7, 0.9]], [[-0.4]], [[-0.4, -0.1]], activation=unit)
    found = imitate(plant, spec, lessons(plant, spec, clipped(teacher, spec), points=600), start, iterations=150)
    assert found.error < 1e-4 * found.start_error and np.abs(found.inner.W).sum() <= 0.95


def test_a_student_rests_where_zero_is_admissible(problem):
    plant, spec = problem
    taught = lessons(plant, spec, lambda y: 0.05 * np.ones((2, y.shape[1])), points=100)
    found = imitate(plant, spec, taught, random_start(plant, spec, 3, seed=2), iterations=10)
    assert found.inner(np.zeros(4)) == pytest.approx(0.0, abs=1e-12)


def test_the_start_stays_where_nothing_better_is_found(problem):
    plant, spec = problem
    start = linear_start(np.full((2, 4), 0.01), plant, spec, 2)
    taught = lessons(plant, spec, clipped(start, spec), points=100)
    found = imitate(plant, spec, taught, start, iterations=2)
    assert found.error <= found.start_error < 1e-20


def test_a_start_on_the_edge_of_the_norm_ball_is_not_made_worse():
    # The search begins inside the ball, where this start is no longer its own teacher.
    plant, spec = Plant(0.9, 1.0), Spec(1.0, 0.1, 0.9, Box(-3, 3), Box(-2, 2))
    start = INC([[0.95]], [[1.0]], [[-0.1]], [[-0.2]])
    found = imitate(plant, spec, lessons(plant, spec, clipped(start, spec), points=100), start, iterations=1)
    assert found.error == found.start_error < 1e-20


def test_what_does_not_fit_is_refused(problem):
    plant, spec = problem
    taught = lessons(plant, spec, lambda y: np.zeros((2, y.shape[1])), points=40)
    with pytest.raises(DimensionError, match="4 measurements and 2 inputs"):
        imitate(plant, spec, taught, INC.linear(np.zeros((2, 3))))
    with pytest.raises(DimensionError):
        imitate(plant, spec, Lessons(taught.y[:3], taught.u, taught.weights), random_start(plant, spec, 2))
    limits = Polytope.from_vertices(spec.inputs.vertices)
    with pytest.raises(InvalidInputError, match="Polytope"):
        imitate(plant, Spec(spec.Q, spec.R, 0.8, spec.initial, limits), taught, random_start(plant, spec, 2))
    with pytest.raises(InvalidInputError, match="kappa"):
        imitate(plant, spec, taught, random_start(plant, spec, 2), kappa=1.0)
    with pytest.raises(InvalidInputError, match="loses the state"):
        lessons(Plant(plant.A + 2 * np.eye(3), plant.B, plant.C), spec, lambda y: np.zeros((2, y.shape[1])))
