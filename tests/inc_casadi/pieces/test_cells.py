"""Simple polytopes: cutting loses nothing, incidence agrees with convex hulls, and ties make no degenerate piece."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from inc_casadi import Box, Polytope
from inc_casadi.pieces.cells import cut, edges, moved, simplices_of, whole
from inc_casadi.sets.simplex import volumes


def shattered(n, rounds, seed):
    """A box cut along random hyperplanes through points within its pieces."""
    rng = np.random.default_rng(seed)
    cells = whole(Box(-np.ones(n), np.arange(1.0, n + 1)))
    for _ in range(rounds):
        normal = rng.standard_normal((len(cells), n))
        offset = (normal * cells.middles()).sum(axis=1)
        height = (normal[cells.owner] * cells.start).sum(axis=1) - offset[cells.owner]
        cells, _, _ = cut(cells, height, np.column_stack([normal, offset]), np.full(len(cells), 1e-12))
    return cells


def total(cells):
    corners, _ = simplices_of(cells)
    return volumes(cells.start[corners]).sum()


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_cutting_conserves_volume_and_every_vertex_lies_on_its_facets(n):
    cells = shattered(n, 6, seed=n)
    assert len(cells) == 64 and total(cells) == pytest.approx(np.prod(np.arange(1.0, n + 1) + 1), rel=1e-12)
    planes = cells.planes[cells.facets // 2]
    residual = (planes[:, :, :-1] * cells.start[:, None, :]).sum(axis=2) - planes[:, :, -1]
    assert np.max(np.abs(residual)) < 1e-13
    for facet in np.unique(cells.facets):
        owners = np.unique(cells.owner[(cells.facets == facet).any(axis=1)])
        a, b = cells.planes[facet // 2][:-1], cells.planes[facet // 2][-1]
        beyond = (cells.start[np.isin(cells.owner, owners)] @ a - b) * (1 if facet % 2 == 0 else -1)
        assert np.max(beyond) < 1e-13, "a cell lies on the wrong side of its facet"


@pytest.mark.parametrize("n", [2, 3, 4])
def test_pieces_are_the_convex_hulls_of_their_vertices(n):
    cells = shattered(n, 4, seed=10 + n)
    corners, owner = simplices_of(cells)
    parts = np.bincount(owner, volumes(cells.start[corners]))
    low, _ = edges(cells)
    for i in range(len(cells)):
        points = cells.start[cells.owner == i]
        hull = ConvexHull(points)
        assert len(hull.vertices) == len(points) and hull.volume == pytest.approx(parts[i], rel=1e-10)
        assert (cells.owner[low] == i).sum() == n * len(points) // 2


def test_a_cut_through_vertices_leaves_simple_pieces():
    """The diagonal plane of a cube passes through four of its corners: they go to one side or the other, none to both."""
    cube = whole(Box(np.zeros(3), np.ones(3)))
    height = cube.start[:, 0] - cube.start[:, 1]
    halves, parent, _ = cut(cube, height, np.array([[1.0, -1.0, 0.0, 0.0]]), np.array([1e-9]))
    assert parent.tolist() == [0, 0] and total(halves) == pytest.approx(1.0, abs=1e-12)
    assert np.max(np.abs(np.clip(halves.start[:, 0] - halves.start[:, 1], None, 0)[halves.owner == 1])) < 1e-9
    low, high = edges(halves)
    assert len(low) * 2 == 3 * len(halves.owner)


def test_a_cut_at_the_side_of_a_piece_follows_the_tolerance():
    square = whole(Box(np.zeros(2), np.ones(2)))
    halves, _, _ = cut(square, square.start[:, 0] - 0.25, np.array([[1.0, 0.0, 0.25]]), np.array([0.1]))
    np.testing.assert_allclose(sorted(set(halves.start[:, 0].round(12))), [0.0, 0.25, 1.0])


def test_moving_keeps_starting_points_and_composes_the_maps():
    rng = np.random.default_rng(3)
    cells = shattered(3, 3, seed=5)
    A, c = rng.standard_normal((len(cells), 3, 3)), rng.standard_normal((len(cells), 3))
    after = moved(moved(cells, A, c), A, c)
    np.testing.assert_allclose((after.motion[after.owner] @ after.lifted()[:, :, None])[:, :, 0], after.now, atol=1e-12)
    again = after.recentered()
    np.testing.assert_allclose((again.motion[again.owner] @ again.lifted()[:, :, None])[:, :, 0], after.now, atol=1e-12)
    np.testing.assert_array_equal(after.start, cells.start)


def test_a_polytope_begins_as_its_simplices():
    rng = np.random.default_rng(7)
    polytope = Polytope.from_vertices(rng.standard_normal((3, 12)))
    cells = whole(polytope)
    assert total(cells) == pytest.approx(polytope.volume, rel=1e-12)
    planes = cells.planes[cells.facets // 2]
    assert np.max(np.abs((planes[:, :, :-1] * cells.start[:, None, :]).sum(axis=2) - planes[:, :, -1])) < 1e-12


def test_choosing_and_joining_give_the_same_cells_back():
    cells = shattered(2, 3, seed=1)
    odd = np.arange(len(cells)) % 2 == 1
    again = type(cells).joined_all([cells.take(odd), cells.take(~odd)], cells.planes)
    assert total(again) == pytest.approx(total(cells), rel=1e-13) and len(again) == len(cells)
    np.testing.assert_allclose(np.sort(again.middles(), axis=0), np.sort(cells.middles(), axis=0))


def test_vertices_that_do_not_close_up_are_noticed():
    cells = shattered(3, 2, seed=2)
    from dataclasses import replace
    facets = cells.facets.copy()
    facets[0, 0] += 1
    with pytest.raises(AssertionError, match="close up"):
        edges(replace(cells, facets=facets))
