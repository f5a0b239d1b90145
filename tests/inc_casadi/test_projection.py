"""Projections against linear programs at random points, and a shadow known by hand."""

import numpy as np
import pytest

from inc_casadi.errors import EmptySetError
from inc_casadi.linear_program import maximum
from inc_casadi.projection import projection


@pytest.mark.parametrize("seed, n, r", [(0, 2, 3), (1, 3, 2), (2, 1, 2)])
def test_a_point_is_in_the_shadow_when_some_v_completes_it(seed, n, r):
    rng = np.random.default_rng(seed)
    H = rng.normal(size=(n + r + 6, n + r))
    H = np.vstack([H, -H.sum(axis=0)])
    h = rng.uniform(0.5, 1.5, size=len(H))
    shadow = projection(H[:, :n], H[:, n:], h)
    x = 1.3 * np.abs(shadow.vertices).max() * rng.uniform(-1, 1, size=(n, 150))
    completed = [maximum(np.zeros(r), H[:, n:], h - H[:, :n] @ point) is not None for point in x.T]
    near = np.min(np.abs(shadow.H @ x - shadow.h[:, None]), axis=0) < 1e-6
    np.testing.assert_array_equal(np.array(completed)[~near], shadow.contains(x)[~near])
    assert 5 < sum(completed) < 145


def test_the_shadow_of_a_cube_along_its_diagonal():
    # (x, v) with |.| <= 1 in the frame x1 + v, x2 + v, v: a hexagon of area 4 + 2 * 4.
    cube = np.vstack([np.eye(3), -np.eye(3)]) @ np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    shadow = projection(cube[:, :2], cube[:, 2:], np.ones(6))
    assert shadow.vertices.shape == (2, 6) and shadow.volume == pytest.approx(12.0, rel=1e-9)


def test_sets_that_are_no_polytope():
    with pytest.raises(EmptySetError, match="unbounded"):
        projection(np.array([[1.0], [0.0], [0.0]]), np.array([[0.0], [1.0], [-1.0]]), np.ones(3))
    with pytest.raises(EmptySetError, match="no point"):
        projection(np.array([[1.0], [-1.0]]), np.zeros((2, 1)), np.array([-1.0, -1.0]))
