"""Random and linear starts: what they promise about norm, origin and kinks."""

import draws
import numpy as np
import pytest

from inc_casadi import Box, Empirical, Gaussian, Plant, Polytope, Saturation, Spec, Tanh
from inc_casadi.errors import DimensionError, InvalidInputError
from synthesis.starts.random_start import input_range, linear_start, measurement_range, random_start


def problem(seed=0, initial=None, inputs=None):
    plant = draws.plant(np.random.default_rng(seed))
    initial = initial or Box([-1.0, -2.0, 0.0], [1.0, 2.0, 5.0])
    return plant, Spec(np.eye(3), np.eye(2), 0.95, initial, inputs or Box([-1.0, -3.0], [1.0, 5.0]))


@pytest.mark.parametrize("activation", [None, Tanh(), Saturation()])
def test_random_start_rests_at_the_origin_within_the_norm(activation):
    plant, spec = problem()
    law = random_start(plant, spec, 6, activation, kappa=0.8, seed=3)
    assert law.q == 6 and law.W.any() and law.V.any() and not law.K.any()
    assert np.abs(law.W).sum(axis=1) == pytest.approx(np.full(6, 0.4))
    assert np.max(np.abs(law(np.zeros(4)))) < 1e-12


def test_kinks_lie_among_the_initial_measurements():
    plant, spec = problem()
    law = random_start(plant, spec, 40, seed=1)
    z = law.U @ plant.C @ spec.initial.sample(2000, np.random.default_rng(0)) + law.b[:, None]
    assert np.all((z > 0).any(axis=1) & (z < 0).any(axis=1))
    assert np.min(np.abs(law.b)) > 0


def test_the_start_follows_the_units_of_the_measurements():
    plant, spec = problem()
    scaled = Plant(plant.A, plant.B, np.diag([1e3, 1.0, 1e-3, 10.0]) @ plant.C)
    law, other = random_start(plant, spec, 5, seed=2), random_start(scaled, spec, 5, seed=2)
    x = spec.initial.sample(20, np.random.default_rng(4))
    np.testing.assert_allclose(other(scaled.C @ x), law(plant.C @ x), atol=1e-9)


def test_linear_start_is_the_linear_law_with_live_units():
    plant, spec = problem()
    K = np.random.default_rng(5).normal(size=(2, 4))
    law = linear_start(K, plant, spec, 7, seed=4)
    y = 10 * np.random.default_rng(6).normal(size=(4, 30))
    np.testing.assert_allclose(law(y), K @ y, atol=1e-12)
    assert not law.V.any() and law.W.any() and law.U.any() and law.b.any()
    assert linear_start(K, plant, spec, 0).q == 0


def test_seeds_decide():
    plant, spec = problem()
    first, again, other = (random_start(plant, spec, 3, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(first.U, again.U) and not np.array_equal(first.U, other.U)


@pytest.mark.parametrize("initial", [Gaussian([1.0, 0.0, 0.0], np.eye(3)), Empirical(np.eye(3)),
                                     Polytope.from_vertices(np.hstack([np.zeros((3, 1)), np.eye(3)]))])
def test_every_distribution_will_do(initial):
    plant, spec = problem(initial=initial)
    assert random_start(plant, spec, 4).q == 4


def test_ranges_are_root_mean_square_and_half_width():
    plant = Plant(np.diag([0.5, 0.5]), np.eye(2), [[1.0, 0.0], [0.0, 2.0], [1.0, 1.0]])
    spec = Spec(np.eye(2), np.eye(2), 1.0, Box([-3.0, 0.0], [3.0, 1.0]), Polytope([[1, 1], [-1, 0], [0, -1]], [2, 0, 0]))
    assert measurement_range(plant, spec)[:2] == pytest.approx([np.sqrt(3.0), 2 / np.sqrt(3.0)])
    assert input_range(spec) == pytest.approx([1.0, 1.0])


def test_refusals():
    plant, spec = problem()
    with pytest.raises(InvalidInputError, match="hidden"):
        random_start(plant, spec, -1)
    with pytest.raises(InvalidInputError, match="kappa"):
        random_start(plant, spec, 2, kappa=1.0)
    with pytest.raises(DimensionError, match="K has shape"):
        linear_start(np.zeros((4, 2)), plant, spec, 2)
    with pytest.raises(DimensionError):
        random_start(Plant(0.5, 1.0), spec, 2)
