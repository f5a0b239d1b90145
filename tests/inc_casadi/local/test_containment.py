"""Whether initial states lie in an ellipsoid: against points, by hand, and within rounding of the edge."""

from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import Box, Ellipsoid, Empirical, Gaussian, Moments, Uniform
from inc_casadi.local.containment import hull_of, largest, margin, norm_above, outermost
from inc_casadi.local.rest import Rest


def resting(*x, spread=0):
    """A rest at x, or within `spread` of it; z and u play no part."""
    low, high = (np.array([Fraction(entry) + Fraction(end) for entry in x], dtype=object) for end in (-spread, spread))
    return Rest(low, high, low, high, low, high)


def drawn(rng, n):
    A = rng.normal(size=(n, n))
    return A @ A.T + 0.1 * np.eye(n)


@pytest.mark.parametrize("seed", range(5))
def test_the_largest_form_over_an_ellipsoid_is_attained_by_a_point_and_exceeded_by_none(seed):
    rng = np.random.default_rng(seed)
    hull = Ellipsoid(drawn(rng, 3), center=rng.normal(size=3) * (seed > 0), level=1.7)
    P, center = drawn(rng, 3), rng.normal(size=3) * (seed > 1)
    value, _ = largest(hull, P, center)
    d = rng.normal(size=(3, 200_000))
    rim = hull.center[:, None] + np.linalg.solve(np.linalg.cholesky(hull.P / hull.level).T, d / np.linalg.norm(d, axis=0))
    e = rim - center[:, None]
    found = np.max(np.einsum("in,ij,jn->n", e, P, e))
    assert found <= value <= found * 1.01
    worst = outermost(hull, P, center)[:, 0]
    assert worst @ P @ worst == pytest.approx(value, rel=1e-5)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("scale", "inside"), [(1 - 1e-6, True), (1 + 1e-6, False)])
def test_an_ellipsoid_within_another_by_a_millionth_is_told_from_one_that_is_not(seed, scale, inside):
    rng = np.random.default_rng(seed)
    hull = Ellipsoid(drawn(rng, 3), center=0.2 * rng.normal(size=3) * (seed > 0))
    P, x = drawn(rng, 3), 0.1 * rng.normal(size=3) * (seed > 1)
    P = P / largest(hull, P, x)[0] * scale
    multiplier = largest(hull, P, x)[1]
    assert (margin(hull, P, resting(*x), multiplier) > 0) == inside
    assert margin(hull, P, resting(*x), 0.0) < 0
    assert not inside or margin(hull, P, resting(*x), 100.0) < 0  # not every multiplier shows it


def test_corners_on_the_rim_are_inside_and_one_unit_of_rounding_further_out_is_not():
    P, corners = np.diag([0.25, 1.0]), np.array([[2.0, 0.0, -2.0], [0.0, 1.0, 0.0]])
    assert margin(corners, P, resting(0, 0), 0.0) == 0.0
    beyond = corners.copy()
    beyond[1, 1] = np.nextafter(1.0, 2.0)
    assert margin(beyond, P, resting(0, 0), 0.0) < 0
    tiny = np.array([[1.0 + 2.0**-52], [0.0]])
    assert margin(tiny, np.diag([1.0, 1.0]), resting(0, 0), 0.0) < 0


def test_a_rest_known_between_bounds_takes_their_width_off():
    P, corners = np.eye(2), np.array([[0.9], [0.0]])
    assert margin(corners, P, resting(0, 0, spread=Fraction(1, 20)), 0.0) > 0  # 0.9 + 0.05 sqrt(2) < 1
    assert margin(corners, P, resting(0, 0, spread=Fraction(1, 10)), 0.0) < 0
    assert margin(corners, P, resting(0, 0, spread=Fraction(2)), 0.0) < 0     # not even the middle need be inside
    third = resting(Fraction(1, 3), 0)
    assert margin(np.array([[4 / 3], [0.0]]), P, third, 0.0) >= 0 > margin(np.array([[1.3334], [0.0]]), P, third, 0.0)


def test_norms_are_rounded_up():
    P = np.array([[2.0, -1.0], [-1.0, 3.0]])
    half = np.array([Fraction(1, 3), Fraction(1, 7)], dtype=object)
    corners = np.array([[1, 1, -1, -1], [1, -1, 1, -1]]) * half.astype(float)[:, None]
    assert norm_above(P, half) >= np.sqrt(np.max(np.einsum("in,ij,jn->n", corners, P, corners)))
    assert Fraction(norm_above(P, half)) ** 2 >= half @ np.array([[2, 1], [1, 3]]) @ half
    assert norm_above(np.eye(2), np.array([Fraction(0)] * 2, dtype=object)) == 0.0
    for tiny in (Fraction(1, 10**400), Fraction(6, 5) / 2**537):  # the squares of both are lost among the smallest floats
        assert Fraction(norm_above(np.eye(1), np.array([tiny], dtype=object))) >= tiny


def test_what_the_initial_states_fill():
    box = Box([-1, 0], [1, 2])
    assert hull_of(Uniform(box)).shape == (2, 4) and isinstance(hull_of(Uniform(Ellipsoid(np.eye(2)))), Ellipsoid)
    assert hull_of(Moments(box, [0.0, 1.0], 0.01 * np.eye(2))).shape == (2, 4)
    assert hull_of(Empirical([[0.0, 1.0, 2.0], [0.0, 2.0, 1.0]])).shape == (2, 3)
    assert "unbounded" in hull_of(Gaussian([0.0], [[1.0]]))
    assert "16384" in hull_of(Uniform(Box(-np.ones(15), np.ones(15)))) and "2^30" in hull_of(
        Uniform(Box(-np.ones(30), np.ones(30))))


def test_of_many_corners_the_outermost_are_asked_for_up_to_their_sign():
    corners = Uniform(Box(-np.arange(1.0, 7), np.arange(1.0, 7))).vertices
    found = outermost(corners, np.diag([1.0, 0, 0, 0, 0, 0]) + 0.01 * np.eye(6), np.zeros(6))
    assert found.shape == (6, 32) and len(np.unique(np.abs(found), axis=1).T) == 1
