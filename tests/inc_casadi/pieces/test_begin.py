"""Cells of a flat set: cut in few coordinates, moved in many."""

import numpy as np
import pytest

from inc_casadi import Box, Polytope
from inc_casadi.pieces.begin import Begin, begin_of
from inc_casadi.pieces.cells import cut, in_start, moved, volumes
from inc_casadi.pieces.places import floats

SQUARE, BESIDE = Box([-1.0, 0.0], [1.0, 3.0]), np.array([0.25, -2.0, 7.0])


@pytest.mark.parametrize("region", [SQUARE, Polytope([[-1.0, 0.0], [0.0, -1.0], [1.0, 1.0]], [0.5, 0.25, 1.0])])
def test_cells_lie_over_the_region_with_the_rest_fixed(region):
    cells = Begin(region, BESIDE).cells()
    np.testing.assert_array_equal(cells.now[:, :2], cells.start)
    np.testing.assert_array_equal(cells.now[:, 2:], np.tile(BESIDE, (len(cells.now), 1)))
    at = (cells.motion[cells.owner] @ cells.lifted()[:, :, None])[:, :, 0]
    np.testing.assert_allclose(at, cells.now, atol=1e-15)
    np.testing.assert_allclose(volumes(cells).sum(), region.volume)


def test_cells_are_moved_and_cut_as_the_maps_say():
    cells, rng = Begin(SQUARE, BESIDE).cells(), np.random.default_rng(0)
    A, c, row = rng.standard_normal((1, 5, 5)), rng.standard_normal((1, 5)), rng.standard_normal((1, 5))
    after = moved(cells, A, c)
    np.testing.assert_allclose(after.now, cells.now @ A[0].T + c)
    middle = np.array([-float(row[0] @ after.middles()[0])])
    height = after.now @ row[0] + middle
    halves, _, _ = cut(after, height, in_start(after, row, middle), np.array([1e-9]))
    assert len(halves) == 2
    np.testing.assert_allclose(volumes(halves).sum(), SQUARE.volume)
    np.testing.assert_allclose((halves.motion[halves.owner] @ halves.lifted()[:, :, None])[:, :, 0], halves.now, atol=1e-12)


def test_maps_are_those_of_the_cells():
    F, f = (floats(part) for part in Begin(SQUARE, BESIDE).maps())
    np.testing.assert_array_equal(F, np.eye(5, 2))
    np.testing.assert_array_equal(f, [0.0, 0.0, *BESIDE])
    assert begin_of(SQUARE).cells().now.shape == (4, 2)
