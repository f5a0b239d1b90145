"""Exact moments, draws and quadrature of each distribution tell the same story, and hand cases fix which."""

import numpy as np
import pytest

from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.sets import Box, Distribution, Ellipsoid, Empirical, Gaussian, Polytope, Set, Uniform, as_distribution

H = np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 2.0, 0.5], [0.3, -1.0, 1.0], [1.0, 0.0, 0.0]])
h = np.array([0.0, 1.0, 2.0, 3.0, 1.5, 1.2])
P = np.array([[2.0, 0.5, 0.1], [0.5, 1.0, -0.2], [0.1, -0.2, 3.0]])
COVARIANCE = np.array([[2.0, 0.3, -0.5], [0.3, 0.5, 0.1], [-0.5, 0.1, 1.0]])
DIRECTION = np.array([[1.0], [-2.0], [0.5]])
DISTRIBUTIONS = {
    "box": Uniform(Box([-1.0, 0.5, 2.0], [0.3, 1.5, 7.0])),
    "polytope": Uniform(Polytope(H, h)),
    "ellipsoid": Uniform(Ellipsoid(P, [1.0, -2.0, 0.5], level=2.5)),
    "gaussian": Gaussian([1.0, -1.0, 0.5], COVARIANCE),
    "flat gaussian": Gaussian([1.0, -1.0, 0.5], DIRECTION @ DIRECTION.T),
    "empirical": Empirical([[1.0, 2.0, 4.0, 0.0], [0.0, -1.0, 1.0, 2.0], [3.0, 3.0, 5.0, 1.0]], [1.0, 2.0, 0.0, 4.0]),
}
EVERY = pytest.mark.parametrize("distribution", DISTRIBUTIONS.values(), ids=DISTRIBUTIONS)
N = 200_000


def assert_within_standard_errors(values, expected, count=4.5):
    """The mean of N draws (..., N) is within `count` standard errors of the expected value."""
    error = values.std(axis=-1) / np.sqrt(values.shape[-1])
    assert np.all(np.abs(values.mean(axis=-1) - expected) <= count * error + 1e-12)


@EVERY
def test_draws_have_the_exact_moments(distribution):
    x = distribution.sample(N, np.random.default_rng(2024))
    assert x.shape == (3, N)
    assert_within_standard_errors(x, distribution.mean)
    assert_within_standard_errors(x[:, None] * x[None], distribution.second_moment)
    shifted = x - distribution.mean[:, None]
    assert_within_standard_errors(shifted[:, None] * shifted[None], distribution.covariance)


@EVERY
def test_quadrature_has_the_exact_moments(distribution):
    nodes, weights = distribution.quadrature(2)
    assert weights.sum() == pytest.approx(1.0) and np.all(weights > 0)
    np.testing.assert_allclose(nodes @ weights, distribution.mean, atol=1e-12)
    np.testing.assert_allclose((nodes * weights) @ nodes.T, distribution.second_moment, rtol=1e-11, atol=1e-12)


@EVERY
def test_quadrature_agrees_with_draws_on_a_polynomial_of_degree_five(distribution):
    def f(x):
        return x[0] ** 2 * x[1] * x[2] ** 2 - x[0] * x[1] ** 3 + x[2] - x[0] ** 4

    nodes, weights = distribution.quadrature(3)
    assert_within_standard_errors(f(distribution.sample(N, np.random.default_rng(7))), weights @ f(nodes))
    finer, finer_weights = distribution.quadrature(5)
    assert weights @ f(nodes) == pytest.approx(finer_weights @ f(finer), rel=1e-10)


@EVERY
def test_draws_repeat_with_the_seed(distribution):
    first, again, other = (distribution.sample(5, np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.any(first != other)
    assert distribution.sample(0, np.random.default_rng(1)).shape == (3, 0)
    for count in (-1, 2.5, None):
        with pytest.raises(InvalidInputError, match="N must be"):
            distribution.sample(count, np.random.default_rng(1))
    with pytest.raises(InvalidInputError, match="order must be at least 1"):
        distribution.quadrature(0)


@EVERY
def test_moments_are_read_only_and_of_the_right_shape(distribution):
    assert distribution.dimension == 3 and distribution.mean.shape == (3,)
    for array in (distribution.mean, distribution.covariance, distribution.second_moment):
        assert not array.flags.writeable
    np.testing.assert_array_equal(distribution.covariance, distribution.covariance.T)


@pytest.mark.parametrize("name", ["box", "polytope", "ellipsoid"])
def test_draws_and_nodes_stay_in_the_set(name):
    uniform = DISTRIBUTIONS[name]
    assert np.all(uniform.support.contains(uniform.sample(2000, np.random.default_rng(3)), tol=1e-12))
    assert np.all(uniform.support.contains(uniform.quadrature(4)[0], tol=1e-12))


@pytest.mark.parametrize("name", ["box", "polytope", "ellipsoid"])
def test_moments_and_volume_agree_with_rejection_from_a_bounding_box(name):
    region = DISTRIBUTIONS[name].support
    upper, lower = region.support(np.eye(3)) + 0.1, -region.support(-np.eye(3)) - 0.2
    points = np.random.default_rng(11).uniform(lower[:, None], upper[:, None], (N, 3, 1))[:, :, 0].T
    inside = region.contains(points)
    assert_within_standard_errors(np.prod(upper - lower) * inside, region.volume)
    x = points[:, inside]
    assert_within_standard_errors(x, DISTRIBUTIONS[name].mean)
    assert_within_standard_errors(x[:, None] * x[None], DISTRIBUTIONS[name].second_moment)


def test_uniform_by_hand():
    box = Uniform(Box([-1.0, 0.0], [1.0, 3.0]))
    np.testing.assert_allclose(box.second_moment, [[1 / 3, 0.0], [0.0, 3.0]], rtol=1e-14)
    disc = Uniform(Ellipsoid(np.eye(2), level=4.0))
    np.testing.assert_allclose(disc.second_moment, np.eye(2), rtol=1e-14)
    # The diamond |x| + |y| <= 0.8 of the paper's example has S0 = 0.8^2 / 6 I; the square has 0.8^2 / 3 I.
    diamond = Uniform(Polytope([[1, 1], [1, -1], [-1, 1], [-1, -1]], [0.8] * 4))
    np.testing.assert_allclose(diamond.second_moment, 0.64 / 6 * np.eye(2), atol=1e-15)
    np.testing.assert_allclose(Uniform(Box([-0.8] * 2, [0.8] * 2)).second_moment, 0.64 / 3 * np.eye(2), atol=1e-15)


def test_a_box_written_as_polytope_has_the_same_moments():
    box = Box([-1.0, 0.5, 2.0], [0.3, 1.5, 7.0])
    polytope = Polytope(box.H, box.h)
    np.testing.assert_allclose(polytope.center, box.center, rtol=1e-12)
    np.testing.assert_allclose(polytope.covariance, box.covariance, atol=1e-12)
    assert polytope.volume == pytest.approx(box.volume, rel=1e-12)


@pytest.mark.parametrize("name", ["box", "polytope"])
def test_the_triangulation_carries_the_probability(name):
    uniform = DISTRIBUTIONS[name]
    simplices, weights = uniform.simplices()
    assert len(simplices) == len(weights) and weights.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(weights @ simplices.mean(axis=1), uniform.mean, rtol=1e-12)


def test_the_vertices_carry_the_distribution():
    assert DISTRIBUTIONS["box"].vertices.shape == (3, 8)
    np.testing.assert_array_equal(DISTRIBUTIONS["polytope"].vertices, DISTRIBUTIONS["polytope"].support.vertices)
    assert DISTRIBUTIONS["empirical"].vertices.tolist() == [[1.0, 2.0, 0.0], [0.0, -1.0, 2.0], [3.0, 3.0, 1.0]]
    for name in ("ellipsoid", "gaussian"):
        with pytest.raises(InvalidInputError, match="no vertices"):
            DISTRIBUTIONS[name].vertices  # noqa: B018
    with pytest.raises(InvalidInputError, match="Ellipsoid has no triangulation"):
        DISTRIBUTIONS["ellipsoid"].simplices()


def test_the_support_of_points_is_their_hull_or_nothing():
    spread = Empirical([[0.0, 1.0, 0.0, 0.2, 9.0], [0.0, 0.0, 1.0, 0.2, 9.0]], [1, 1, 1, 1, 0])
    assert spread.support.volume == pytest.approx(0.5)
    assert Empirical([[0.0, 1.0, 2.0], [0.0, 1.0, 2.0]]).support is None
    assert Empirical([[1.0], [2.0]]).support is None
    assert DISTRIBUTIONS["gaussian"].support is None


def test_empirical_by_hand():
    two = Empirical([[1.0, 3.0], [0.0, 4.0]], [3.0, 1.0])
    np.testing.assert_allclose(two.second_moment, [[3.0, 3.0], [3.0, 4.0]])
    np.testing.assert_array_equal(two.weights, [0.75, 0.25])
    np.testing.assert_array_equal(Empirical([[1.0, 2.0, 3.0, 4.0]]).weights, [0.25] * 4)
    assert Empirical([[1.0, 2.0]], [1e308, 1e308]).mean[0] == 1.5
    nodes, weights = Empirical([[1.0, 2.0, 3.0]], [1, 0, 1]).quadrature(1)
    assert nodes.tolist() == [[1.0, 3.0]] and weights.tolist() == [0.5, 0.5]


def test_a_gaussian_without_variance_is_its_mean():
    known = Gaussian([1.0, 2.0], np.zeros((2, 2)))
    assert known.quadrature(3)[0].tolist() == [[1.0], [2.0]]
    assert known.sample(2, np.random.default_rng(0)).tolist() == [[1.0, 1.0], [2.0, 2.0]]
    assert DISTRIBUTIONS["flat gaussian"].quadrature(4)[0].shape == (3, 4)


@pytest.mark.parametrize(("make", "error", "message"), [
    (lambda: Uniform(np.ones((2, 3))), InvalidInputError, "Uniform needs .* not ndarray"),
    (lambda: Uniform(DISTRIBUTIONS["gaussian"]), InvalidInputError, "not Gaussian"),
    (lambda: Gaussian([0.0, 0.0], np.eye(3)), DimensionError, "covariance has shape"),
    (lambda: Gaussian([[0.0, 0.0]], np.eye(2)), DimensionError, "mean has shape"),
    (lambda: Gaussian([], np.zeros((0, 0))), DimensionError, "mean has shape"),
    (lambda: Gaussian([0.0, 0.0], [[1.0, 2.0], [2.0, 1.0]]), InvalidInputError, "covariance must be positive semi"),
    (lambda: Gaussian([0.0, 0.0], [[1.0, 0.5], [0.0, 1.0]]), InvalidInputError, "covariance is not symmetric"),
    (lambda: Gaussian([0.0, np.nan], np.eye(2)), InvalidInputError, "mean holds a NaN"),
    (lambda: Empirical([1.0, 2.0]), DimensionError, "points has shape"),
    (lambda: Empirical(np.zeros((2, 0))), DimensionError, "at least one point"),
    (lambda: Empirical(np.ones((2, 3)), [1.0, 1.0]), DimensionError, "weights has shape"),
    (lambda: Empirical(np.ones((2, 2)), [1.0, -0.5]), InvalidInputError, r"weights\[1\] = -0.5 is negative"),
    (lambda: Empirical(np.ones((2, 2)), [0.0, 0.0]), InvalidInputError, "every weight is zero"),
    (lambda: Empirical(np.ones((2, 2)), [np.inf, 0.0]), InvalidInputError, "weights holds"),
    (lambda: Empirical([[np.nan]]), InvalidInputError, "points holds a NaN"),
    (lambda: as_distribution(np.ones((2, 3))), InvalidInputError, r"points as columns are Empirical\(points\)"),
])
def test_a_bad_distribution_is_refused(make, error, message):
    with pytest.raises(error, match=message):
        make()


def test_a_set_stands_for_its_uniform_distribution():
    box = Box(0, 1)
    assert as_distribution(box).support is box
    assert as_distribution(DISTRIBUTIONS["gaussian"]) is DISTRIBUTIONS["gaussian"]
    assert isinstance(box, Set) and not isinstance(box, Distribution)


def test_weights_that_were_normalized_once_are_kept_bit_for_bit():
    rng = np.random.default_rng(0)
    for _ in range(100):
        once = Empirical(rng.standard_normal((2, 7)), rng.random(7))
        assert np.array_equal(Empirical(once.points, once.weights).weights, once.weights)
        assert once.weights.sum() == pytest.approx(1.0, abs=1e-14)
