"""Regions of attraction: inside what simulation says, near all of it, and true where it can be worked out by hand."""

import numpy as np
import oracles
import pytest

from inc_casadi import INC, Box, Plant, Polytope, ReLU
from inc_casadi.errors import InvalidInputError
from inc_casadi.pieces.basin import region_of_attraction
from inc_casadi.pieces.walk import Budget

PLANT = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
GAIN = np.array([[-1.0955, -1.9764]])


def converges(plant, inc, points, steps=400):
    x, u = oracles.roll_out(plant, inc, points, steps)
    return np.max(np.abs(x[:, :, -1]), axis=0) < 1e-6, u


def test_the_scalar_plant_converges_exactly_inside_two():
    """x+ = 1.5 x - sat(x) stays at x = 2, and runs away beyond; eq:scalar_plant."""
    basin = region_of_attraction(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.0]], 1.0), Box([-5.0], [3.0]))
    ends = np.concatenate(basin.polytopes())
    assert 2 - 1e-4 < ends.max() < 2 and -2 < ends.min() < -2 + 1e-4
    assert basin.share == pytest.approx(0.5, abs=1e-4) and basin.contains(1.99) and not basin.contains(2.01)
    assert "converges" in basin.sentence()


def test_certified_points_converge_and_few_that_converge_are_missed():
    inc, region = INC.saturated(GAIN, 1.0), Box([-6.0, -2.5], [6.0, 2.5])
    basin = region_of_attraction(PLANT, inc, region, smallest=3e-4, budget=Budget(seconds=10))
    points = region.sample(4000, np.random.default_rng(0))
    good, _ = converges(PLANT, inc, points)
    inside = basin.contains(points)
    assert not np.any(inside & ~good)
    assert inside.sum() > 0.85 * good.sum()
    assert basin.share == pytest.approx(inside.mean(), abs=0.025)
    assert basin.simulated == pytest.approx(good.mean(), abs=0.025)
    assert basin.fraction == pytest.approx(inside.sum() / good.sum(), abs=0.03)
    corners = np.concatenate(basin.polytopes())
    middles = np.array([polygon.mean(axis=0) for polygon in basin.polytopes()])
    inner = 0.999 * corners + 0.001 * np.repeat(middles, [len(polygon) for polygon in basin.polytopes()], axis=0)
    assert converges(PLANT, inc, inner.T)[0].mean() > 0.999
    np.testing.assert_allclose(basin.volume, basin.share * region.volume)


@pytest.mark.slow
def test_cells_do_not_overlap():
    basin = region_of_attraction(PLANT, INC.saturated(GAIN, 1.0), Box([-3.0, -2.0], [3.0, 2.0]), smallest=1e-3,
                                  budget=Budget(seconds=6))
    assert np.sum([_area(polygon) for polygon in basin.polytopes()]) == pytest.approx(basin.volume, rel=1e-9)
    assert basin.share <= 1.0


def _area(points):
    from scipy.spatial import ConvexHull
    return ConvexHull(points).volume


def test_where_an_input_breaks_its_limit_nothing_is_certified():
    """u = K x unclipped with |u| <= 1: the region is the maximal output-admissible set of the linear law."""
    inc, region = INC.linear(GAIN), Box([-2.0, -2.0], [2.0, 2.0])
    basin = region_of_attraction(PLANT, inc, region, Box([-1.0], [1.0]))
    points = region.sample(4000, np.random.default_rng(1))
    good, u = converges(PLANT, inc, points)
    good &= np.max(np.abs(u[0]), axis=1) <= 1
    inside = basin.contains(points)
    assert not np.any(inside & ~good) and inside.sum() > 0.97 * good.sum() > 100


@pytest.mark.slow
def test_an_implicit_law_with_bias_converges_to_its_own_equilibrium():
    inc = INC([[0.2, -0.3], [0.1, 0.0]], [[1.0, 0.5], [0.0, 1.0]], [[-0.2, -0.1]], GAIN, [0.3, -0.2], [0.05], ReLU())
    plant = Plant([[0.9, 0.5], [0.0, 1.02]], [[0.2], [0.5]])
    triangle = Polytope.from_vertices([[-1.0, 1.5, 0.0], [-1.0, -0.5, 1.0]])
    basin = region_of_attraction(plant, inc, triangle)
    assert basin.share > 0.999
    x, _ = oracles.roll_out(plant, inc, triangle.vertices, 400)
    np.testing.assert_allclose(x[:, :, -1], np.repeat(basin.equilibrium[:, None], 3, axis=1), atol=1e-6)


@pytest.mark.slow
def test_a_small_budget_keeps_what_was_certified():
    region, few_pieces = Box([-6.0, -2.5], [6.0, 2.5]), Budget(pieces=30, seconds=4)
    few = region_of_attraction(PLANT, INC.saturated(GAIN, 1.0), region, budget=few_pieces)
    assert "30 pieces" in few.ended and 0 < few.share < 1


def test_without_a_stable_equilibrium_there_is_a_reason():
    with pytest.raises(InvalidInputError, match="does not stabilize"):
        region_of_attraction(PLANT, INC.saturated(np.array([[0.1, 0.1]]), 1.0), Box([-1, -1], [1, 1]))


def test_a_rest_on_kinks_has_a_region_too():
    """u = -1.2 relu(x) + 0.8 relu(-x), so x+ = 0.3 x on the right and 0.7 x on the left of the origin, its kink."""
    inc = INC(np.zeros((2, 2)), [[1.0], [-1.0]], [[-1.2, 0.8]], [[0.0]], activation=ReLU())
    basin = region_of_attraction(Plant([[1.5]], [[1.0]]), inc, Box([-3.0], [2.0]))
    assert basin.share == pytest.approx(1.0, abs=1e-9) and basin.equilibrium == pytest.approx(0.0, abs=1e-12)
