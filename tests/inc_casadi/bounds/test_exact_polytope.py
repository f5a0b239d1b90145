"""Every vertex is found exactly, however many half-spaces meet in it, and the simplices fill the polytope once."""

from fractions import Fraction
from itertools import combinations, product
from math import factorial

import numpy as np
import pytest

from inc_casadi import Box, Polytope
from inc_casadi.blocks import exact
from inc_casadi.bounds import exact_polytope
from inc_casadi.bounds.exact_polytope import corners, orthogonal, tiling
from inc_casadi.exact import solve

CROSS = np.hstack([np.eye(3), -np.eye(3)])


def by_brute_force(H, h):
    """Solve every choice of n half-spaces and keep the points inside."""
    H, h = exact(H), exact(h)
    found = set()
    for chosen in combinations(range(len(h)), H.shape[1]):
        x = solve(H[list(chosen)], h[list(chosen)])
        if x is not None and np.all(H @ x <= h):
            found.add(tuple(x))
    return found


def volume(found):
    simplices = found.points[tiling(found)].astype(float)
    return float(np.sum(np.abs(np.linalg.det(simplices[:, 1:] - simplices[:, :1])))) / factorial(found.points.shape[1])


def draws():
    rng = np.random.default_rng(5)
    yield "interval", Polytope([[1.0], [-3.0], [2.0]], [1, 2, 5])
    yield "box", Box([-1.0, 0.1, 2.0], [0.3, 0.7, 5.0])
    yield "octahedron, four half-spaces in a vertex", Polytope(list(product((1, -1), repeat=3)), np.ones(8))
    yield "with half-spaces that touch a vertex, an edge, nothing", Polytope(
        np.vstack([np.eye(3), -np.eye(3), [[1, 1, 1], [1, 1, 0], [1, 0, 1]]]), [1.0] * 6 + [3, 2, 5])
    slanted = np.vstack([rng.standard_normal((2, 3)), -np.eye(3), np.ones((1, 3))])
    yield "with half-spaces twice", Polytope(np.vstack([slanted, 2 * slanted]), np.append(np.ones(6), 2 * np.ones(6)))
    for n, count in ((2, 9), (3, 11), (4, 6)):
        yield f"hull in R^{n}", Polytope.from_vertices(rng.standard_normal((n, count)))
    yield "hull with vertices of high degree, rounded", Polytope.from_vertices(rng.standard_normal((3, 3)) @ CROSS)


@pytest.mark.parametrize("region", [region for _, region in draws()], ids=[name for name, _ in draws()])
def test_all_vertices_are_found_and_the_volume_is_filled(region):
    found = corners(region)
    assert {tuple(point) for point in found.points} == by_brute_force(region.H, region.h)
    assert volume(found) == pytest.approx(region.volume, rel=1e-12)
    np.testing.assert_array_equal(found.incident, found.points @ exact(region.H).T == exact(region.h))


def test_simplices_do_not_overlap():
    H = np.vstack([np.random.default_rng(2).standard_normal((7, 3)), np.eye(3), -np.eye(3)])
    region = Polytope(H, np.ones(13))
    found = corners(region)
    simplices = found.points[tiling(found)].astype(float)
    points = region.sample(500, np.random.default_rng(0))
    lifted = np.concatenate([simplices, np.ones((*simplices.shape[:2], 1))], axis=2)
    inside = np.all(np.linalg.inv(lifted).transpose(0, 2, 1) @ np.vstack([points, np.ones(500)]) >= 0, axis=1)
    assert np.all(inside.sum(axis=0) == 1)


def test_an_orthogonal_vector_and_how_many_there_are():
    vector, freedom = orthogonal(exact(np.array([[1.0, 2.0, 3.0], [2.0, 4.0, 6.0]])))
    assert freedom == 2 and vector @ np.array([1, 2, 3]) == 0 and np.any(vector != 0)
    assert orthogonal(exact(np.array([[0.0, 1e-300]])))[0].tolist() == [Fraction(1), Fraction(0)]
    assert orthogonal(np.empty((0, 1), dtype=object))[1] == 1


def test_too_many_edges_are_said_in_words(monkeypatch):
    monkeypatch.setattr(exact_polytope, "MOST_EDGES", 10)
    assert "more than 10 edges of a polytope of 6 half-spaces" in corners(Box([0, 0, 0], [1, 1, 1]))
