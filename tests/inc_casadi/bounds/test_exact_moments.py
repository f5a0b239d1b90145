"""Exact second moments against hand values and floats; exact semidefiniteness on both sides of the edge."""

from fractions import Fraction
from math import factorial

import numpy as np
import pytest

from inc_casadi import Box, Ellipsoid, Empirical, Gaussian, Moments, Polytope, Uniform
from inc_casadi.blocks import exact
from inc_casadi.bounds.exact_moments import extended_moment, is_semidefinite

P = np.array([[2.0, 0.5, 0.1], [0.5, 1.0, -0.2], [0.1, -0.2, 3.0]])
HULL = Polytope.from_vertices(np.random.default_rng(3).standard_normal((3, 10)) + 1)
KINDS = {
    "box": Uniform(Box([-1.0, 0.5, 2.0], [0.3, 1.5, 7.0])), "polytope": Uniform(HULL),
    "ellipsoid": Uniform(Ellipsoid(P, [1.0, -2.0, 0.5], level=2.5)),
    "empirical": Empirical([[1.0, 2.0, 4.0, 0.0], [0.0, -1.0, 1.0, 2.0], [3.0, 3.0, 5.0, 1.0]], [0.1, 0.2, 0.0, 0.4]),
    "moments": Moments(HULL, HULL.center, HULL.covariance / 2),
}


@pytest.mark.parametrize("initial", KINDS.values(), ids=KINDS)
def test_it_is_the_moment_in_floats_to_rounding(initial):
    M = extended_moment(initial)
    z = np.append(initial.mean, 1.0)
    want = np.outer(z, z)
    want[:3, :3] = initial.second_moment
    np.testing.assert_allclose(M.astype(float), want, rtol=1e-12, atol=1e-13)
    assert np.all(M == M.T) and is_semidefinite(M)


def test_hand_values():
    third = Fraction(1, 3)
    assert extended_moment(Uniform(Box([0, 0], [1, 3]))).tolist() == [
        [third, Fraction(3, 4), Fraction(1, 2)], [Fraction(3, 4), 3, Fraction(3, 2)], [Fraction(1, 2), Fraction(3, 2), 1]]
    assert extended_moment(Uniform(Ellipsoid(np.diag([1.0, 3.0]), level=2.0)))[1, 1] == Fraction(1, 6)
    weights = np.array([1, 2]) / 3  # whose floats do not sum to 1 exactly, as Fractions
    assert extended_moment(Empirical([[1.0, 2.0]], weights))[1, 1] == 1
    assert extended_moment(Empirical([[0.0, 1.0]], [3, 1]))[0].tolist() == [Fraction(1, 4), Fraction(1, 4)]


def test_a_triangle_is_met_from_below():
    # E x^2 = 1/6, E x y = 1/12, E x = 1/3 on the triangle (0, 0), (1, 0), (0, 1).
    true = np.array([[2, 1, 4], [1, 2, 4], [4, 4, 12]]) * Fraction(1, 12)
    M = extended_moment(Uniform(Polytope([[-1, 0], [0, -1], [1, 1]], [0, 0, 1])))
    assert is_semidefinite(true - M) and 0 < np.max(np.abs(true - M)) < Fraction(1, 2**190)


def test_a_polytope_far_away_and_large_is_met_from_below():
    # The square of side 2^20 about (2^30, 0), of which everything is a whole number.
    big, half = 2**30, 2**19
    M = extended_moment(Uniform(Polytope([[1, 0], [-1, 0], [0, 1], [0, -1]], [big + half, half - big, half, half])))
    var = Fraction(half**2, 3)
    true = np.array([[big**2 + var, 0, big], [0, var, 0], [big, 0, 1]])
    assert is_semidefinite(true - M) and np.max(np.abs(true - M)) < Fraction(2**62, 2**190)


def test_a_polygon_of_many_triangles_is_met_from_below():
    # Summed triangle by triangle, with all denominators kept.
    from inc_casadi.bounds.exact_polytope import corners, tiling
    from inc_casadi.pieces.linear import determinant

    near = np.linspace(-0.03, 0.03, 120)  # and most of the triangles small, so that rounding their shares counts
    flat = Polytope.from_vertices(np.hstack([[[-0.9, 0.9], [0.9, 0.9]], [near, 50 * near**2 - 0.9]]))
    found, total, mass = corners(flat), np.full((3, 3), Fraction(0), dtype=object), Fraction(0)
    for simplex in found.points[tiling(found)]:
        size = abs(determinant(simplex[1:] - simplex[0])) / factorial(2)
        z = np.hstack([simplex, np.full((3, 1), Fraction(1), dtype=object)])
        total += size / 12 * (z.T @ z + np.outer(z.sum(axis=0), z.sum(axis=0)))
        mass += size
    assert is_semidefinite(total / mass - extended_moment(Uniform(flat)))


def test_what_cannot_be_stated_is_said_in_words():
    assert "Gaussian" in extended_moment(Gaussian([0.0], [[1.0]]))
    slightly = np.array([[1.0, 1.0], [1.0, 1.0 - 2**-52]]) * 0.1
    assert "negative eigenvalue" in extended_moment(Moments(Box([-1, -1], [1, 1]), [0, 0], slightly))


@pytest.mark.parametrize("matrix, answer", [
    ([[0.0]], True), ([[-1e-300]], False), ([[0.0, 1e-300], [1e-300, 5.0]], False), ([[1.0, 1.0], [1.0, 1.0]], True),
    ([[1.0, 1.0], [1.0, 1.0 - 2**-53]], False), ([[0.0, 0.0], [0.0, 2.0]], True), ([[0.0, 0.0], [0.0, -2.0]], False)])
def test_semidefinite_on_both_sides_of_the_edge(matrix, answer):
    assert is_semidefinite(exact(np.array(matrix))) is answer


@pytest.mark.parametrize("seed", range(5))
def test_semidefinite_matrices_of_low_rank(seed):
    rng = np.random.default_rng(seed)
    root = rng.integers(-4, 5, (4, 2)).astype(float)
    assert is_semidefinite(exact(root @ root.T))
    down = rng.integers(-4, 5, 4).astype(float)
    assert is_semidefinite(exact(root @ root.T - 1e-3 * np.outer(down, down))) == (
        np.linalg.eigvalsh(root @ root.T - 1e-3 * np.outer(down, down))[0] > -1e-9)
