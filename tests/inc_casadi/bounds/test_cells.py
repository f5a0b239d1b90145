"""Cells of a distribution: right mass, means and covariances, however they were halved, in floats and in fractions."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import Box, Ellipsoid, Empirical, Gaussian, Polytope, Uniform
from inc_casadi.bounds.cells import Cloud, Points
from inc_casadi.bounds.clouds import intervals
from inc_casadi.bounds.halved_cells import Boxes, Simplices
from inc_casadi.bounds.halvings import Halvings
from inc_casadi.bounds.partition import partition
from inc_casadi.errors import InvalidInputError
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


def halved_at_random(cells, rng, rounds=6):
    """Halve a third of the cells again and again, each along any of its ways."""
    for _ in range(rounds):
        chosen = rng.choice(cells.leaves, 1 + cells.leaves.size // 3, replace=False)
        cells = cells.halved(chosen, rng.integers(0, cells.shapes.ways.shape[1], chosen.size))
    return cells


@pytest.mark.parametrize("name", CASES)
def test_mass_and_mean_are_kept_and_no_covariance_inside_is_negative(name):
    initial = CASES[name]
    for number in (1, 9, 700):
        cells = partition(initial, number)
        assert np.all(cells.probabilities > 0) and cells.probabilities.sum() == pytest.approx(1, rel=1e-12)
        np.testing.assert_allclose(cells.centroids @ cells.probabilities, initial.mean, atol=1e-12)
        within = initial.second_moment - cells.shapes.moment()
        assert np.linalg.eigvalsh(within)[0] > -1e-12 and (np.max(np.abs(within)) < 1e-12) == cells.complete
        assert cells.divide(initial)
        assert cells.probabilities.size <= max(number, 12)


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


@pytest.mark.parametrize("name", ["box", "polytope"])
def test_every_draw_is_in_one_cell_however_they_were_halved(name):
    rng = np.random.default_rng(1)
    cells = halved_at_random(partition(CASES[name], 5), rng)
    shapes, draws = cells.shapes, CASES[name].sample(20_000, rng)
    count = np.zeros(cells.probabilities.size)
    hits = np.zeros(draws.shape[1], dtype=int)
    for i in range(count.size):
        span, away = shapes.spans[:, :, i], draws - shapes.centers[:, i:i + 1]
        if shapes.symmetric:
            inside = np.all(np.abs(np.linalg.solve(span, away)) <= 1, axis=0)
        else:
            inside = np.all(np.linalg.solve(np.vstack([span, np.ones(4)]), np.vstack([away, 0 * away[:1]])) >= -0.25, axis=0)
        count[i], hits = inside.mean(), hits + inside
    assert np.mean(hits == 1) > 0.999
    np.testing.assert_allclose(count, cells.probabilities, atol=4 * np.sqrt(count.max() / draws.shape[1]))


@pytest.mark.parametrize("name", ["box", "polytope", "points"])
def test_fractions_add_up_exactly_and_agree_with_the_floats(name):
    cells = partition(CASES[name], 4)
    if cells.halving:
        cells = halved_at_random(cells, np.random.default_rng(2), 3)
    exact = cells.exact()
    assert sum(exact.probabilities) == 1 and all(isinstance(p, Fraction) for p in exact.probabilities)
    assert not np.any(exact.spans.sum(axis=1)) or exact.symmetric  # vertices less their mean
    for ours, theirs in ((exact.probabilities, cells.probabilities), (exact.centers, cells.centroids)):
        np.testing.assert_allclose(ours.astype(float), theirs, rtol=1e-12)
    np.testing.assert_allclose(exact.spans.astype(float), cells.shapes.spans, atol=1e-15)
    np.testing.assert_allclose(exact.moment().astype(float), CASES[name].second_moment, rtol=1e-12)


def test_the_fractions_of_a_box_are_those_of_halves():
    box = Box([0.1, 0.0], [0.3, 1.0])
    exact = Boxes(box, Halvings.none(1)).halved(np.array([0]), np.array([0])).exact()
    low, high = Fraction(0.1), Fraction(0.3)
    assert exact.centers[0].tolist() == [(3 * low + high) / 4, (low + 3 * high) / 4]
    assert exact.spans[0, 0].tolist() == [(high - low) / 4] * 2


def test_ends_and_corners_lie_below_concave_functions():
    rng = np.random.default_rng(5)
    for initial, q in ((CASES["box"], 3), (CASES["polytope"], 4), (Uniform(Box(-np.ones(7), np.arange(7.0))), 7)):
        shapes = partition(initial, 1).shapes
        shapes = shapes.take(np.array([0]))
        xi = rng.uniform(-1, 1, (q, 40_000)) if shapes.symmetric else rng.dirichlet(np.ones(q), 40_000).T
        mean, slopes = rng.standard_normal((2, 1)), rng.standard_normal((2, q, 1))
        slopes -= 0 if shapes.symmetric else slopes.mean(axis=1, keepdims=True)
        draws = mean + slopes[:, :, 0] @ xi
        W = rng.standard_normal((5, 2))
        points, divisor = shapes.corners(mean, slopes)
        below = np.min(np.einsum("wi,iec->wec", W, points), axis=0).sum() / divisor
        assert below <= np.min(W @ draws, axis=0).mean() + 0.02
        ends, divisor = shapes.ends(mean[0], slopes[0])
        assert np.minimum(-2 * ends, ends).sum() / divisor <= np.minimum(-2 * draws[0], draws[0]).mean() + 0.02
        far = 50 + 0 * mean[0]  # of one sign all over the cell: then nothing is lost
        ends, divisor = shapes.ends(far, slopes[0])
        assert np.minimum(-2 * ends, ends).sum() / divisor == pytest.approx(-100)


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


def test_an_interval_is_cut_alike_as_an_ellipsoid():
    assert partition(Uniform(Ellipsoid([[4.0]], [1.0])), 4).centroids.round(9).tolist() == [[0.625, 0.875, 1.125, 1.375]]


def test_the_longest_is_halved_and_units_do_not_matter():
    wide = partition(Uniform(Box([0, 0], [1, 8])), 4, np.eye(2))
    assert len(set(wide.centroids[1])) == 4
    assert len(set(partition(Uniform(Box([0, 0], [1, 8])), 4).centroids[1])) == 2
    assert intervals(np.array([0.0, 1.0]), 5) == [1, 5]


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

    cells = partition(Other(), 100)
    assert cells.centroids.tolist() == [[2.0]] and "Other" in cells.exact()


@pytest.mark.parametrize("cut, along", [([0, 0], [0, 0]), ([1], [0]), ([0, 3], [0, 0]), ([-1], [0]), ([0], [3]),
                                        ([0], [-1])])
def test_records_that_are_no_halvings_are_found_out(cut, along):
    box = CASES["box"]
    fake = Boxes(box.support, Halvings(1, np.array(cut), np.array(along)))
    assert not fake.divide(box)
    assert not Boxes(box.support, Halvings(1, np.array(cut) + 0.0, np.array(along))).divide(box)


def test_a_cut_of_what_never_was_is_refused():
    with pytest.raises(InvalidInputError, match="cells that never were"):
        Halvings(1, np.array([1]), np.array([0])).unfolded(np.ones(1), lambda p, _: (p / 2, p / 2))


def test_cells_of_another_distribution_are_found_out():
    box, polytope, points = CASES["box"], CASES["polytope"], CASES["points"]
    cells = partition(box, 4)
    assert not replace(cells, box=Box([-1, 0, 2], [0.5, 3, 2.3])).divide(box) and not cells.divide(polytope)
    simplices = partition(polytope, 30)
    assert isinstance(simplices, Simplices) and simplices.divide(polytope)
    assert not replace(simplices, roots=1.01 * simplices.roots).divide(polytope) and not simplices.divide(box)
    assert not Points(points).divide(Empirical(CORNERS)) and not Points(points).divide(box)
    assert not Cloud(CASES["gaussian"], 9).divide(Gaussian(CENTER, 2 * SHAPE))


def test_halving_ends_where_floats_would_no_longer_be_exact():
    cells = Boxes(Box(0.0, 1.0), Halvings.none(1))
    for _ in range(60):
        cells = cells.halved(cells.leaves[-1:], np.array([0]))
    assert cells.divide(Uniform(Box(0.0, 1.0))) and 40 < cells.leaves.size < 50
    deeper = replace(cells, record=cells.record.more(cells.leaves[-1:], np.array([0])))
    assert not deeper.divide(Uniform(Box(0.0, 1.0)))
