"""Cells of a distribution: right mass, right means, so that Jensen's inequality holds for every convex function."""

import numpy as np
import pytest

from inc_casadi import Box, Ellipsoid, Empirical, Gaussian, Polytope, Uniform
from inc_casadi.bounds.partition import Cells, intervals, partition
from inc_casadi.sets import Distribution

CORNERS = np.random.default_rng(4).standard_normal((3, 7))
SHAPE = np.array([[2.0, 0.3, 0.0], [0.3, 1.0, -0.2], [0.0, -0.2, 0.5]])
CENTER = np.array([0.4, -1.0, 0.2])
CASES = {
    "box": Uniform(Box([-1, 0, 2], [0.5, 3, 2.2])),
    "polytope": Uniform(Polytope.from_vertices(CORNERS)),
    "ellipsoid": Uniform(Ellipsoid(SHAPE, CENTER, 2.0)),
    "gaussian": Gaussian(CENTER, SHAPE),
    "points": Empirical(CORNERS, np.arange(7.0)),
}


def convex(x):
    """A convex function with kinks and growth in every direction."""
    kinked = np.abs(x[0] - 0.3 * x[1]) + np.maximum(x[2] - x[0] - 0.2, 0)
    return kinked + np.sum((x - 0.3) ** 4, axis=0) / 5


@pytest.mark.parametrize("name", CASES)
def test_mass_and_mean_are_kept_and_no_covariance_inside_is_negative(name):
    initial = CASES[name]
    for number in (1, 9, 700):
        cells = partition(initial, number)
        assert np.all(cells.probabilities > 0) and cells.probabilities.sum() == pytest.approx(1, rel=1e-12)
        np.testing.assert_allclose(cells.centroids @ cells.probabilities, initial.mean, atol=1e-12)
        assert np.linalg.eigvalsh(cells.within(initial.second_moment))[0] > -1e-12
        assert cells.divide(initial)
        assert cells.probabilities.size <= max(number, 7)


@pytest.mark.parametrize("name", CASES)
def test_the_mean_over_the_cells_is_below_the_mean_and_closes_in_on_it(name):
    initial = CASES[name]
    draws = convex(initial.sample(400_000, np.random.default_rng(0)))
    true, error = draws.mean(), 4 * draws.std() / np.sqrt(draws.size)
    values = []
    for number in (1, 60, 4000):
        cells = partition(initial, number)
        values.append(float(cells.probabilities @ convex(cells.centroids)))
    assert values[0] <= values[1] + 1e-12 and values[1] <= values[2] + 1e-12
    assert values[2] <= true + error
    if name != "points":
        assert true - values[2] < 0.15 * (true - values[0])


def test_the_cells_of_a_gaussian_have_the_means_of_its_draws():
    gaussian = Gaussian([1.0, -1.0], np.diag([4.0, 0.25]))
    cells = partition(gaussian, 9)
    draws = gaussian.sample(400_000, np.random.default_rng(1))
    split = np.sqrt(3) * 0.430727299295457  # the normal quantile at 2/3
    z = (draws - gaussian.mean[:, None]) / np.array([[2.0], [0.5]])
    corner = np.all(z > split, axis=0)
    nearest = int(np.argmax(np.sum((cells.centroids - gaussian.mean[:, None]) / np.array([[2.0], [0.5]]), axis=0)))
    assert cells.probabilities[nearest] == pytest.approx(corner.mean(), abs=2e-3)
    np.testing.assert_allclose(cells.centroids[:, nearest], draws[:, corner].mean(axis=1), atol=2e-2)


def test_the_rest_of_an_ellipsoid_has_the_mean_that_is_left():
    disc = Uniform(Ellipsoid(np.eye(2)))
    cells = partition(disc, 8)  # one triangle in each quarter, and what is beyond its chord
    triangle, rest = cells.probabilities[:2] * np.pi
    assert triangle == pytest.approx(1 / 2) and rest == pytest.approx(np.pi / 4 - 1 / 2)
    along = np.linalg.norm(cells.centroids, axis=0)
    assert sorted(set(along.round(9))) == pytest.approx([np.sqrt(2) / 3, np.sqrt(2) / 6 / (np.pi / 4 - 0.5)])


def test_an_interval_given_as_an_ellipsoid_is_a_grid():
    np.testing.assert_allclose(partition(Uniform(Ellipsoid(0.25, [1.0])), 4).centroids, [[-0.5, 0.5, 1.5, 2.5]])


def test_a_grid_cuts_what_has_width():
    assert intervals(np.array([2.0, 2.0]), 1600) == [40, 40]
    assert intervals(np.array([1.0, 0.0, 3.0]), 12) == [3, 1, 4]
    assert intervals(np.ones(12), 1600) == [2] * 10 + [1, 1]
    assert intervals(np.zeros(2), 50) == [1, 1]


def test_a_gaussian_without_variance_is_one_point():
    cells = partition(Gaussian([1.0, 2.0], np.zeros((2, 2))), 100)
    assert cells.centroids.tolist() == [[1.0], [2.0]]


def test_an_unknown_distribution_is_one_cell():
    class Other(Distribution):
        dimension, mean, covariance, support, vertices = 1, np.array([2.0]), np.eye(1), None, np.zeros((1, 0))

        def sample(self, N, rng):
            return np.zeros((1, N))

        def quadrature(self, order):
            return np.zeros((1, 1)), np.ones(1)

    assert partition(Other(), 100).centroids.tolist() == [[2.0]]


def test_moved_cells_are_found_out():
    initial = CASES["box"]
    cells = partition(initial, 27)
    assert not Cells(cells.probabilities, 1.01 * cells.centroids).divide(initial)
    assert not Cells(1.01 * cells.probabilities, cells.centroids / 1.01).divide(initial)
    assert not Cells(np.ones(1), np.zeros((3, 1))).divide(initial)  # not the mean, though nothing inside is negative
    spread = initial.mean[:, None] + 1.6 * (cells.centroids - initial.mean[:, None])
    assert not Cells(cells.probabilities, spread).divide(initial)
