"""The box: its corners, half-spaces, support function and triangulation describe one and the same set."""

import math

import numpy as np
import pytest

from inc_casadi.errors import DimensionError, EmptySetError, InvalidInputError
from inc_casadi.sets import Box
from inc_casadi.sets.simplex import volumes

BOX = Box([-1.0, 0.5, 2.0], [0.3, 1.5, 7.0])


def test_corners_by_hand():
    assert Box([-1, 5], [2, 6]).vertices.tolist() == [[-1.0, -1.0, 2.0, 2.0], [5.0, 6.0, 5.0, 6.0]]


def test_corners_lie_on_n_half_spaces_each():
    slack = BOX.h[:, None] - BOX.H @ BOX.vertices
    assert BOX.vertices.shape == (3, 8)
    assert np.all(slack >= 0)
    assert np.all((slack == 0).sum(axis=0) == 3)


def test_membership_agrees_with_the_half_spaces():
    points = np.random.default_rng(3).uniform(-2, 8, (3, 4000))
    points[:, :8] = BOX.vertices
    expected = np.all(BOX.H @ points <= BOX.h[:, None], axis=0)
    assert 8 <= expected.sum() < 4000
    np.testing.assert_array_equal(BOX.contains(points), expected)


def test_the_tolerance_of_membership_is_a_distance():
    beside = BOX.upper + [0.0, 1e-6, 0.0]
    assert BOX.contains(beside) is False
    assert BOX.contains(beside, tol=1.1e-6) is True
    assert BOX.contains(beside, tol=0.9e-6) is False
    assert BOX.contains(BOX.lower - 1e-6, tol=1.1e-6) is True


def test_support_is_attained_at_a_corner():
    directions = np.random.default_rng(4).standard_normal((3, 50))
    np.testing.assert_allclose(BOX.support(directions), (directions.T @ BOX.vertices).max(axis=1), rtol=1e-12)
    assert isinstance(BOX.support([1.0, 0.0, 0.0]), float) and BOX.support([-1.0, 0.0, 0.0]) == 1.0


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_the_triangulation_fills_the_box(n):
    box = Box(-np.arange(1, n + 1), np.arange(1, n + 1) ** 2)
    simplices = box.simplices()
    assert simplices.shape == (math.factorial(n), n + 1, n)
    parts = volumes(simplices)
    np.testing.assert_allclose(parts, box.volume / math.factorial(n), rtol=1e-12)
    corners = {tuple(corner) for corner in box.vertices.T}
    assert {tuple(corner) for corner in simplices.reshape(-1, n)} == corners


def test_every_point_lies_in_exactly_one_simplex():
    points = BOX.sample(500, np.random.default_rng(5))
    simplices = BOX.simplices()
    edges = (simplices[:, 1:] - simplices[:, :1]).transpose(0, 2, 1)
    inner = np.linalg.solve(edges[:, None], (points.T[None] - simplices[:, :1])[..., None])[..., 0]
    inside = np.all(inner >= 0, axis=2) & (inner.sum(axis=2) <= 1)
    np.testing.assert_array_equal(inside.sum(axis=0), 1)


def test_volume_center_and_scalar_ends():
    assert BOX.volume == pytest.approx(1.3 * 1.0 * 5.0)
    np.testing.assert_allclose(BOX.center, [-0.35, 1.0, 4.5])
    assert Box(-1, 3).dimension == 1 and Box(-1, 3).contains(2.0) is True


@pytest.mark.parametrize(("lower", "upper", "error", "message"), [
    ([0, 1, 0], [1, 1, 2], EmptySetError, "coordinate 1 has lower = 1 and upper = 1"),
    ([0, 0], [1, -2], EmptySetError, "coordinate 1"),
    ([], [], EmptySetError, "at least one"),
    ([0, 0], [1], DimensionError, "upper has shape"),
    ([[0, 0]], [1, 1], DimensionError, "lower has shape"),
    ([0, np.nan], [1, 1], InvalidInputError, "lower holds a NaN"),
    ([0, 0], [1, np.inf], InvalidInputError, "upper holds a NaN or an infinity"),
])
def test_a_bad_box_is_refused(lower, upper, error, message):
    with pytest.raises(error, match=message):
        Box(lower, upper)


def test_too_many_corners_or_simplices_are_refused():
    with pytest.raises(InvalidInputError, match=r"2\^21 vertices"):
        Box(np.zeros(21), np.ones(21)).vertices  # noqa: B018
    with pytest.raises(InvalidInputError, match="9! simplices"):
        Box(np.zeros(9), np.ones(9)).simplices()
    with pytest.raises(InvalidInputError, match=r"quadrature of 16777216 nodes.*sample"):
        Box(np.zeros(12), np.ones(12)).quadrature(4)


def test_points_of_the_wrong_size_are_refused():
    with pytest.raises(DimensionError, match="x has shape"):
        BOX.contains([1.0, 2.0])
    with pytest.raises(DimensionError, match="direction has shape"):
        BOX.support(np.ones((2, 3)))
    with pytest.raises(InvalidInputError, match="x holds a NaN"):
        BOX.contains([0.0, np.nan, 3.0])


def test_the_arrays_are_read_only():
    for array in (BOX.lower, BOX.upper, BOX.vertices, BOX.H, BOX.h, BOX.center):
        assert not array.flags.writeable
