"""Compression: costs fall from start to imitation to training, few units do what many did, and it can be certified."""

import numpy as np
import pytest

from inc_casadi import INC, Box, Plant, ReLU, Saturation, Spec, bounds
from inc_casadi.errors import InvalidInputError
from inc_casadi.output_range import within_limits
from synthesis.compression import compress
from synthesis.gate import gate
from synthesis.starts.random_start import random_start


@pytest.fixture(scope="module")
def problem():
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]])
    spec = Spec(np.eye(2), 0.1, 0.95, Box([-3, -1.5], [3, 1.5]), Box(-0.5, 0.5))
    return plant, spec, INC.from_mpc(plant, spec.Q, spec.R, 20, spec.inputs, discount=0.95)


UNITS = {str(unit): unit for unit in (ReLU(), Saturation())}


@pytest.fixture(scope="module")
def compressed(problem):
    """Three units of one kind in the teacher's place; computed when first asked for."""
    found = {}

    def of(unit):
        if unit not in found:
            found[unit] = compress(*problem, 3, activation=UNITS[unit], points=1500, iterations=40, training_iterations=20)
        return found[unit]
    return of


def mean_cost(law, plant, spec, x, steps=300):
    total, weight = 0.0, 1.0
    for _ in range(steps):
        u = law(plant.C @ x)
        total = total + weight * (np.sum(x * (spec.Q @ x), axis=0) + np.sum(u * (spec.R @ u), axis=0))
        x, weight = plant.A @ x + plant.B @ u, weight * spec.discount
    return float(total.mean())


@pytest.mark.slow
@pytest.mark.parametrize("unit", UNITS)
def test_few_units_do_what_twenty_did(problem, compressed, unit):
    (plant, spec, teacher), small = problem, compressed(unit)
    assert (small.teacher_units, small.inner.q, small.inc.q) == (20, 3, 4)
    assert small.cost < 1.00001 * small.fitted_cost and small.fitted_cost < small.start_cost and small.closed > 0.8
    x = spec.initial.sample(1500, np.random.default_rng(9))
    clipped = INC.linear(small.yardstick.K).with_saturated_output(spec.inputs)
    costs = [mean_cost(law, plant, spec, x) for law in (teacher, small.inc, clipped)]
    assert costs[0] * (1 - 1e-9) < costs[1] < costs[2] - 0.8 * (costs[2] - costs[0])


def test_compression_improves_a_random_start(problem):
    plant, spec, teacher = problem
    start = random_start(plant, spec, 4, seed=3)
    small = compress(plant, spec, teacher, start=start, rounds=1, points=600, iterations=40, training_iterations=0)
    assert small.training is None and small.inner.q == 4 and small.cost < 0.3 * small.start_cost
    assert small.cost == pytest.approx(small.fitted_cost, rel=1e-6) and small.fits[0].error < 0.1 * small.fits[0].start_error


def test_a_compressed_law_is_certified_within_a_thousandth_of_every_controller(problem, compressed):
    (plant, spec, _), small = problem, compressed(str(Saturation()))
    verdict = gate(plant, spec, small.inc)
    least = bounds.any_controller(plant, spec, cells=1500)
    assert verdict.accepted and verdict.certificate.prove() and least.holds()
    assert float(least) <= verdict.cost < 1.001 * float(least)


def test_the_law_keeps_its_limits_and_rests_at_the_origin(problem):
    small = compress(*problem, 2, rounds=1, points=300, iterations=10, training_iterations=0)
    assert within_limits(small.inc, problem[1].inputs) and np.all(small.inc(np.zeros(2)) == 0.0)
    assert np.abs(small.inner.W).sum(axis=1).max() <= 0.95


def test_training_goes_on_from_the_imitation(problem):
    plant, spec, teacher = problem
    start = random_start(plant, spec, 4, seed=3)
    small = compress(plant, spec, teacher, start=start, rounds=1, points=300, iterations=4, training_iterations=40)
    assert small.cost < 0.9998 * small.fitted_cost and small.training.improved


def test_the_second_round_is_taught_where_the_student_goes(problem):
    plant, spec, teacher = problem
    asked = []

    def watched(y):
        asked.append(y)
        return teacher(y)
    compress(plant, spec, watched, 2, rounds=2, points=300, iterations=4, training_iterations=0, samples=7)
    steps = [y for y in asked if y.shape[1] != 7]
    first, second = steps[: len(steps) // 2], steps[len(steps) // 2:]
    assert np.array_equal(first[0], second[0]) and not np.allclose(first[3], second[3], atol=1e-3)


@pytest.mark.slow
def test_without_discount_the_compressed_law_is_proved(problem):
    plant, spec, _ = problem
    spec = Spec(spec.Q, spec.R, 1.0, spec.initial, spec.inputs)
    teacher = INC.from_mpc(plant, spec.Q, spec.R, 10, spec.inputs)
    small = compress(plant, spec, teacher, 3, points=600, iterations=20, training_iterations=5, seed=2)
    assert small.inner.b.any() and gate(plant, spec, small.inc).certificate.prove()


def test_output_feedback_is_taught_too():
    plant = Plant([[0.7326, -0.0861], [0.1722, 0.9909]], [[0.0609], [0.0064]], [[0.0, 1.4142]])
    spec = Spec(np.eye(2), 0.01, 0.98, Box([-1.5, -1.5], [1.5, 1.5]), Box(-2, 2))
    small = compress(plant, spec, lambda y: np.clip(-1.3 * y, -2, 2), 2, points=600, iterations=30, training_iterations=0)
    assert small.teacher_units is None and small.cost == pytest.approx(small.teacher_cost, rel=0.02)
    assert "A teacher costs" in small.sentence


@pytest.mark.slow
def test_the_same_seed_gives_the_same_law(problem):
    same = [compress(*problem, 2, rounds=2, points=200, iterations=4, training_iterations=2, seed=5).inc for _ in range(2)]
    assert np.array_equal(same[0].V, same[1].V) and np.array_equal(same[0].W, same[1].W)


def test_refusals(problem):
    plant, spec, teacher = problem
    with pytest.raises(InvalidInputError, match="the teacher loses the state"):
        compress(Plant([[2.0, 0.0], [0.3, 1.5]], plant.B), spec, INC.linear([[0.0, 0.0]]), samples=5)
    with pytest.raises(InvalidInputError, match="needs a Box"):
        compress(plant, Spec(spec.Q, spec.R, 0.95, spec.initial), teacher)
    with pytest.raises(InvalidInputError, match="kappa"):
        compress(plant, spec, teacher, kappa=1.5)
    with pytest.raises(InvalidInputError, match="rounds"):
        compress(plant, spec, teacher, rounds=0)
