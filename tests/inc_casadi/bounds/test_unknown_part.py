"""What measurements leave unknown: no estimator does better, and by hand where it can be done by hand."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.stats import binned_statistic

from inc_casadi import Box, Ellipsoid, Gaussian, Moments, Plant, Uniform
from inc_casadi.blocks import exact
from inc_casadi.bounds.information import first_shown, null_space, unseen
from inc_casadi.bounds.unknown_part import Chord, best_chords, chord_variance, unknown_part, within


def measured(C, A=None):
    n = np.shape(C)[1]
    return Plant(np.eye(n) if A is None else A, np.ones((n, 1)), C=C)


def binned_variance(y, target, bins=400):
    """The mean variance of target within narrow bins of a scalar y: the least mean square error, nearly."""
    edges = np.quantile(y, np.linspace(0, 1, bins + 1))
    spread = binned_statistic(y, target, "std", edges).statistic
    return float(np.mean(spread**2))


@pytest.mark.parametrize("width, z", [([2.0], [1.0]), ([2.0, 2.0], [1.0, 1.0]), ([2.0, 3.0], [1.0, -0.4]),
                                      ([1.0, 2.0, 0.5], [0.3, -1.0, 0.2]), ([1.0, 4.0, 2.0], [0.5, 0.0, -1.0])])
def test_the_variance_on_chords_is_that_of_chords_drawn_through_random_points(width, z):
    width, z = np.array(width), np.array(z)
    x = np.random.default_rng(0).uniform(0, 1, (len(z), 200_000)) * width[:, None]
    used = z != 0
    ends = np.stack([-x[used], width[used, None] - x[used]]) / z[used, None]
    length = np.min(np.max(ends, axis=0), axis=0) - np.max(np.min(ends, axis=0), axis=0)
    assert float(chord_variance(width, z)) == pytest.approx(np.mean(length**2) / 12, rel=5e-3)


def test_the_variance_on_chords_by_hand():
    square = exact(np.array([2.0, 2.0]))
    assert chord_variance(square, exact(np.array([1.0, 0.0]))) == Fraction(1, 3)
    assert chord_variance(square, exact(np.array([2.0, 2.0]))) == Fraction(1, 24)  # of t, which runs half as far
    assert chord_variance(square, exact(np.zeros(2))) == 0


@pytest.mark.parametrize("C", [[[1.0, 1.0]], [[1.0, -3.0]], [[0.4, 1.0]]])
def test_one_direction_unknown_is_exact(C):
    plant, start = measured(C), Uniform(Box([-1.0, -0.5], [1.0, 1.5]))
    chords = best_chords(plant, np.array([2.0, 2.0]), 0, np.eye(2))
    M = unknown_part(plant, start, 0, chords).astype(float)
    x = start.sample(400_000, np.random.default_rng(1))
    for h in np.eye(2):
        assert h @ M @ h == pytest.approx(binned_variance((np.array(C) @ x)[0], h @ x), rel=0.02)


def test_the_best_estimator_of_a_box_is_not_linear_and_errs_less():
    plant, start = measured([[1.0, 3.0]]), Uniform(Box([-1, -1], [1, 1]))
    M = unknown_part(plant, start, 0, best_chords(plant, np.full(2, 2.0), 0, np.eye(2))).astype(float)
    linear = unknown_part(plant, Gaussian(start.mean, start.covariance), 0, ()).astype(float)
    assert 0.7 * linear[0, 0] < M[0, 0] < 0.99 * linear[0, 0]


def test_more_unknown_directions_than_one_stay_below_the_truth():
    plant, start = measured([[1.0, 0.7, -0.5, 0.0]]), Uniform(Box(-np.ones(4), np.ones(4)))
    chords = best_chords(plant, np.full(4, 2.0), 0, np.diag([1.0, 2.0, 0.5, 1.0]))
    M = unknown_part(plant, start, 0, chords).astype(float)
    x = start.sample(100_000, np.random.default_rng(2))
    y = (plant.C @ x)[0]
    for h in (*np.eye(4), np.array([1.0, -1.0, 0.5, 0.3])):
        assert h @ M @ h <= binned_variance(y, h @ x) * 1.02
    assert M[3, 3] == pytest.approx(1 / 3) and np.trace(M[:3, :3]) > 0.2


def test_coordinates_are_exact_and_independent():
    plant, start = measured([[0.0, 1.0, 0.0]]), Uniform(Box([-1, 0, 0], [1, 2, 4]))
    chords = best_chords(plant, np.array([2.0, 2.0, 4.0]), 0, np.array([[1.0, 0, 5.0], [0, 0, 0], [5.0, 0, 30.0]]))
    np.testing.assert_array_equal(unknown_part(plant, start, 0, chords).astype(float), np.diag([4 / 12, 0, 16 / 12]))


@pytest.mark.parametrize("initial", [Uniform(Ellipsoid([[1.0, 0.2, 0.0], [0.2, 2.0, 0.3], [0.0, 0.3, 0.5]])),
                                     Gaussian([1.0, 0.0, 2.0], [[2.0, 0.3, 0.0], [0.3, 1.0, 0.2], [0.0, 0.2, 0.5]])])
def test_of_ellipsoids_and_gaussians_the_linear_estimator_is_the_best(initial):
    plant = measured([[1.0, -0.5, 2.0]])
    M, C, S = unknown_part(plant, initial, 0, ()).astype(float), plant.C, initial.covariance
    np.testing.assert_allclose(M, S - S @ C.T @ np.linalg.solve(C @ S @ C.T, C @ S), atol=1e-12)
    x = initial.sample(400_000, np.random.default_rng(3))
    assert M[0, 0] == pytest.approx(binned_variance((C @ x)[0], x[0]), rel=0.02)


def test_what_is_told_later_is_told():
    plant = measured([[1.0, 0.0, 0.0]], [[1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    assert first_shown(plant).tolist() == [0, 1, 2]
    assert [Z.astype(float).T.tolist() for Z in unseen(plant)] == [[[0, 1, 0], [0, 0, 1]], [[0, 0, 1]]]
    assert unseen(measured(np.eye(2))) == [] and first_shown(measured([[0.0, 1.0]])).tolist() == [2, 0]


def test_null_spaces_are_exact():
    rows = exact(np.random.default_rng(4).standard_normal((2, 4)))
    Z = null_space(rows)
    assert Z.shape == (4, 2) and np.all(rows @ Z == 0)
    assert within(Z, np.array([0, 1, 2])).shape == (4, 1) and within(Z, np.array([0, 1])).shape == (4, 0)


def test_chords_that_do_not_fit_prove_nothing():
    plant, start = measured([[1.0, 1.0, 0.0]]), Uniform(Box(-np.ones(3), np.ones(3)))
    good = Chord(0, np.array([0, 1]), np.array([1.0]))
    assert unknown_part(plant, start, 0, (good,)) is not None
    for support, coefficients in (([0, 3], [1.0]), ([1, 0], [1.0]), ([0], [1.0]), ([0, 1], [1.0, 1.0]), ([0, 1], [np.nan])):
        bad = Chord(0, np.array(support), np.array(coefficients))
        assert unknown_part(plant, start, 0, (bad,)) is None
    overlapping = (good, Chord(0, np.array([0, 1, 2]), np.ones(2)))
    assert unknown_part(plant, start, 0, overlapping) is None
    assert unknown_part(plant, Moments(Box(-np.ones(3), np.ones(3)), np.zeros(3), np.eye(3) / 9), 0, (good,)) is None
