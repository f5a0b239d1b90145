"""Closed forms on simplices against integrals done by hand."""

from math import factorial

import numpy as np
import pytest

from inc_casadi.errors import SolverError
from inc_casadi.sets import simplex


def test_volumes_by_hand():
    corner = np.vstack([np.zeros(4), np.diag([1.0, 2.0, 3.0, 4.0])])
    assert simplex.volumes(np.stack([corner, corner + 7.0])) == pytest.approx([1.0, 1.0])
    assert simplex.volumes(np.array([[[3.0], [-1.0]]])) == pytest.approx([4.0])


def test_moments_of_a_triangle_by_hand():
    # On {x, y >= 0, x + y <= 1}: E x = 1/3, E x^2 = 1/6, E xy = 1/12.
    mean, covariance = simplex.moments(np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]]), np.ones(1))
    np.testing.assert_allclose(mean, [1 / 3, 1 / 3])
    np.testing.assert_allclose(covariance, [[1 / 18, -1 / 36], [-1 / 36, 1 / 18]])


def test_moments_of_a_mixture_do_not_lose_digits_far_away():
    pieces = np.array([[[0.0], [1.0]], [[1.0], [4.0]]])
    shares = np.array([0.25, 0.75])
    mean, covariance = simplex.moments(pieces, shares)
    assert mean[0] == pytest.approx(2.0)
    assert covariance[0, 0] == pytest.approx(16 / 12)
    mean, covariance = simplex.moments(pieces + 1e8, shares)
    assert covariance[0, 0] == pytest.approx(16 / 12, rel=1e-7)


@pytest.mark.parametrize("n", [2, 3, 4])
def test_draws_spread_evenly_over_the_barycentric_coordinates(n):
    # The standard simplex: 1 - E[max] has no simple symmetry to hide behind; P(lambda_0 > t) = (1 - t)^n.
    corners = np.vstack([np.zeros(n), np.eye(n)])[None]
    points = simplex.sample(corners, np.ones(1), 40_000, np.random.default_rng(n))
    first = 1 - points.sum(axis=0)
    for t in (0.05, 0.3, 0.6):
        expected = (1 - t) ** n
        error = np.sqrt(expected * (1 - expected) / 40_000)
        assert abs(np.mean(first > t) - expected) < 4 * error


def test_draws_choose_simplices_by_their_weight():
    pieces = np.array([[[0.0], [1.0]], [[5.0], [6.0]]])
    points = simplex.sample(pieces, np.array([0.2, 0.8]), 20_000, np.random.default_rng(0))
    assert abs(np.mean(points > 3) - 0.8) < 4 * np.sqrt(0.16 / 20_000)


def test_kuhn_covers_the_square_by_two_triangles():
    assert simplex.kuhn(np.array([0.1, 0.2]), np.array([0.3, 0.7])).tolist() == [
        [[0.1, 0.2], [0.3, 0.2], [0.3, 0.7]], [[0.1, 0.2], [0.1, 0.7], [0.3, 0.7]]]


@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_delaunay_of_a_cube_drops_nothing_but_slivers(n):
    corners = np.array(np.meshgrid(*[[0.0, 1.0]] * n)).reshape(n, -1)
    parts = simplex.volumes(simplex.delaunay(corners, np.full(n, 0.5), np.full(n, 0.5)))
    assert parts.sum() == pytest.approx(1.0, rel=1e-12)
    assert parts.min() >= 0.9 / factorial(n)


def test_a_flat_set_of_vertices_is_an_error():
    with pytest.raises(SolverError, match="Qhull"):
        simplex.delaunay(np.array([[0.0, 1.0, 2.0], [0.0, 1.0, 2.0]]), np.ones(2), np.ones(2))
