"""What may occur is decided without tolerance, and what rounding put outside is brought in by next to nothing."""

import numpy as np
import pytest

from inc_casadi import Box, Ellipsoid, Empirical, Gaussian, Moments, Polytope, Uniform
from inc_casadi.bounds.occurring import drawn_in, may_occur
from inc_casadi.sets.farthest import farthest

RNG = np.random.default_rng(0)
P = np.array([[2.0, 0.5, 0.1], [0.5, 1.0, -0.2], [0.1, -0.2, 3.0]])
SUPPORTS = {"box": Box([-1.0, 0.1, 2.0], [0.3, 1.7, 7.0]), "ellipsoid": Ellipsoid(P, [1.0, -2.0, 0.5], level=2.5),
            "polytope": Polytope.from_vertices(RNG.standard_normal((3, 12)) + 5)}
EVERY = pytest.mark.parametrize("support", SUPPORTS.values(), ids=SUPPORTS)


@EVERY
def test_the_farthest_points_occur_once_they_are_drawn_in(support):
    initial = Uniform(support)
    points = farthest(initial, np.random.default_rng(1).standard_normal((3, 60)))
    inside = drawn_in(initial, points)
    assert may_occur(initial, inside)
    np.testing.assert_allclose(inside, points, rtol=0, atol=1e-13)
    assert not may_occur(initial, support.center[:, None] + (1 + 1e-9) * (points - support.center[:, None]))


@EVERY
def test_points_inside_stay_as_they_are(support):
    points = support.center[:, None] + 0.9 * (support.sample(40, np.random.default_rng(2)) - support.center[:, None])
    np.testing.assert_array_equal(drawn_in(Uniform(support), points), points)


def test_one_unit_of_rounding_outside_is_outside():
    edge = np.array([[0.1], [0.0]])
    for support in (Box([-0.1, -1], [0.1, 1]), Polytope([[1, 0], [-1, 0], [0, 1], [0, -1]], [0.1, 0.1, 1, 1])):
        for initial in (Uniform(support), Moments(support, [0, 0], 0.001 * np.eye(2))):
            assert may_occur(initial, edge)
            outside = np.nextafter(edge, [[1.0], [0.0]])
            assert not may_occur(initial, outside) and may_occur(initial, drawn_in(initial, outside))


def test_a_point_far_outside_is_left_to_be_refused():
    far = np.array([[3.0], [0.0]])
    disc = Uniform(Ellipsoid(np.eye(2)))
    np.testing.assert_array_equal(drawn_in(disc, far), far)
    assert not may_occur(disc, far)


def test_of_finitely_many_points_only_those_with_weight_count():
    known = Empirical([[0.0, 1.0, 0.0, 2.0], [0.0, 0.0, 1.0, 2.0]], [1, 1, 1, 0])
    assert may_occur(known, np.array([[1.0, 0.0], [0.0, 0.0]]))
    assert not may_occur(known, np.array([[0.2], [0.2]])) and not may_occur(known, np.array([[2.0], [2.0]]))
    np.testing.assert_array_equal(drawn_in(known, np.array([[5.0], [5.0]])), [[5.0], [5.0]])


def test_nothing_is_known_to_occur_without_a_bounded_support():
    assert not may_occur(Gaussian([0.0], [[1.0]]), np.zeros((1, 1)))
    assert not may_occur(Uniform(Box(-1, 1)), np.array([[np.nan]]))
