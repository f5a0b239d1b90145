"""Regions: volumes by sampling, shapes by membership, laws by hand."""

from dataclasses import replace

import draws
import numpy as np
import pytest

from inc_casadi import INC, Box, LeakyReLU, Plant, Polytope, ReLU, Saturation
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.pieces.cover import source_of
from inc_casadi.pieces.regions import regions

UNITS = (ReLU(), Saturation(), LeakyReLU(0.3), ReLU())
REGION = Box([-1.0, -2.0, 0.5], [2.0, 1.0, 1.5])


def problem(seed):
    rng = np.random.default_rng(seed)
    drawn = draws.controller(rng, m=2, p=4, units=UNITS, gain=1.0, bias=0.7)
    return draws.plant(rng, n=3, m=2, p=4), replace(drawn, U=2 * drawn.U)


@pytest.mark.parametrize("seed", range(2))
def test_volumes_are_those_of_sampled_patterns(seed):
    plant, inc = problem(seed)
    found = regions(plant, inc, REGION)
    assert found.volumes.sum() + found.lost == pytest.approx(REGION.volume, rel=1e-12) and abs(found.lost) < 1e-9
    x = REGION.sample(20_000, np.random.default_rng(seed))
    patterns = source_of(inc, plant.C).patterns_at(x.T)
    hits = np.array([np.all(patterns == pattern, axis=1).mean() for pattern in found.patterns])
    assert hits.sum() == pytest.approx(1.0) and len(found) > 6
    shares = found.volumes / REGION.volume
    assert np.all(np.abs(hits - shares) < 5 * np.sqrt(shares / 20_000) + 1e-4)


def test_each_region_is_a_polytope_with_its_law():
    plant, inc = problem(3)
    found = regions(plant, inc, REGION)
    rng = np.random.default_rng(0)
    total = 0.0
    for i in range(len(found)):
        shape = found.polytope(i)
        total += shape.volume
        assert shape.volume == pytest.approx(found.volumes[i], rel=1e-6)
        x = shape.sample(20, rng)
        np.testing.assert_allclose(found.G[i] @ x + found.g[i][:, None], inc(plant.C @ x), atol=1e-9)
    assert total == pytest.approx(REGION.volume, rel=1e-9)
    with pytest.raises(InvalidInputError, match="no region -1"):
        found.polytope(-1)


def test_a_saturation_by_hand():
    found = regions(Plant([[1.2]], [[1.0]]), INC.saturated([[-0.8]], 1.0), Box([-2.0], [3.0]))
    order = np.argsort([found.polytope(i).center[0] for i in range(3)])
    np.testing.assert_allclose(found.volumes[order], [0.75, 2.5, 1.75], atol=1e-12)
    np.testing.assert_allclose(found.G[order, 0, 0], [0.0, -0.8, 0.0], atol=1e-15)
    np.testing.assert_allclose(found.g[order, 0], [1.0, 0.0, -1.0], atol=1e-15)


def test_patterns_may_share_a_law():
    # relu(x) + relu(-x) has the laws -x and x; a third unit that cancels another doubles the patterns, not the laws.
    inc = INC(np.zeros((4, 4)), [[1.0], [-1.0], [1.0], [1.0]], [[1.0, 1.0, 1.0, -1.0]], [[0.0]], b=[0.0, 0.0, -1.0, -1.0])
    found = regions(Plant([[1.0]], [[1.0]]), inc, Box([-2.0], [2.0]))
    G, g, which = found.distinct_laws()
    assert len(found) == 3 and len(G) == 2 and sorted(G.ravel().tolist()) == [-1.0, 1.0] and not g.any()
    np.testing.assert_array_equal(G[which], found.G)


def test_a_polytope_is_covered_as_it_is():
    triangle = Polytope(np.vstack([-np.eye(2), np.ones((1, 2))]), [0.0, 0.0, 1.0])
    found = regions(Plant(np.eye(2), [[1.0], [0.0]]), INC.saturated([[1.0, 0.0]], 0.5), triangle)
    np.testing.assert_allclose(sorted(found.volumes), [0.125, 0.375], atol=1e-12)


def test_a_budget_lists_what_was_finished():
    plant, inc = problem(4)
    whole, part = regions(plant, inc, REGION), regions(plant, inc, REGION, pieces=50)
    assert whole.ended == "" and part.ended == "more than 50 simplices"
    assert part.lost > 0.01 and part.volumes.sum() + part.lost == pytest.approx(REGION.volume, rel=1e-12)


def test_a_law_of_another_measurement_is_refused():
    with pytest.raises(DimensionError, match="maps 4 measurements"):
        regions(Plant(np.eye(3), np.ones((3, 2))), problem(0)[1], REGION)
