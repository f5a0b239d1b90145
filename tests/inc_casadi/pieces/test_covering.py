"""Simplices that cover a polytope: proved when they do, refused when a sliver or a piece is missing."""

import numpy as np
import pytest

from inc_casadi import Box, Polytope
from inc_casadi.pieces.covering import covering, covers


def polytope(rng, n):
    H = np.vstack([rng.normal(size=(n + 3, n)), np.eye(n), -np.eye(n)])
    return Polytope(H, rng.uniform(0.5, 2.0, size=len(H)))


@pytest.mark.parametrize("n", [1, 2, 3])
def test_random_polytopes_are_covered_by_a_hair_more_than_themselves(n):
    rng = np.random.default_rng(n)
    for _ in range(3):
        region = polytope(rng, n)
        simplices = covering(region)
        corners = simplices.reshape(-1, n).T
        assert np.max(region.H @ corners - region.h[:, None]) < 1e-10
        assert not np.array_equal(simplices, region.simplices()) or covers(simplices, region.H, region.h)
        assert not covers(region.center + 0.999 * (simplices - region.center), region.H, region.h)


@pytest.mark.parametrize("n", [2, 3])
def test_a_missing_simplex_is_noticed(n):
    region = polytope(np.random.default_rng(5 + n), n)
    simplices = covering(region)
    for gone in range(len(simplices)):
        assert not covers(np.delete(simplices, gone, axis=0), region.H, region.h)


def test_a_gap_of_one_bit_between_two_triangles_is_noticed():
    square = Box([0.0, 0.0], [1.0, 1.0])
    simplices = square.simplices().copy()
    assert covers(simplices, square.H, square.h)
    corner = np.argwhere(np.all(simplices[0] == [1.0, 1.0], axis=1))[0, 0]
    simplices[0, corner] = np.nextafter(1.0, 2.0)
    assert not covers(simplices, square.H, square.h)


def test_overlaps_and_turned_simplices_do_no_harm_but_flat_ones_are_refused():
    square = Box([0.0, 0.0], [1.0, 1.0])
    simplices = square.simplices()
    assert covers(simplices[:, ::-1], square.H, square.h)
    flat = np.array([[[0.0, 0.0], [0.5, 0.5], [1.0, 1.0]]])
    assert not covers(np.concatenate([simplices, flat]), square.H, square.h)


def test_two_simplices_on_the_same_side_are_no_neighbours():
    square = Box([0.0, 0.0], [1.0, 1.0])
    assert not covers(square.simplices()[[0, 0]], square.H, square.h)


def test_a_simplex_short_of_the_boundary_by_a_few_roundings_is_refused():
    triangle, H = np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]]), np.array([[-1.0, 0.0], [0.0, -1.0], [1.0, 1.0]])
    assert covers(triangle, H, np.array([0.0, 0.0, 1.0])) and covers(triangle, H, np.array([0.0, 0.0, 1 - 1e-15]))
    assert not covers(triangle, H, np.array([0.0, 0.0, 1 + 1e-15]))


def test_simplices_beside_the_region_cover_nothing():
    square = Box([0.0, 0.0], [1.0, 1.0])
    assert not covers(square.simplices() + 5.0, square.H, square.h)


def test_corners_that_are_floats_are_left_alone():
    diamond = Polytope([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]], np.ones(4))
    assert np.array_equal(covering(diamond), diamond.simplices())
