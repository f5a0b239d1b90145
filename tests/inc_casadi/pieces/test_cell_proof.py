"""A walk over polytopes settled with 256 places: agreement with the walk in floats, and refusal of what is not so."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from settled_walks import SHARE, clipped, walked
from walk_draws import EACH_WALK, draw

from inc_casadi.pieces.cell_motions import motions, placed_laws, planes
from inc_casadi.pieces.cell_proof import settle
from inc_casadi.pieces.cell_vertices import refined, trouble
from inc_casadi.pieces.places import determinants, floats, placed, scaled, times
from inc_casadi.pieces.terminal import in_places
from inc_casadi.pieces.walk import walk


@EACH_WALK
def test_costs_with_256_places_are_those_of_the_walk_in_floats(seed):
    plant, inc, claim = draw(seed)
    found, loop, terminal = walked(plant, inc, claim)
    settled = settle(found, loop, claim, in_places(terminal, SHARE))
    assert not isinstance(settled, str), settled
    assert settled.arrived and settled.enclosure.arrives(in_places(terminal, SHARE))
    assert float(settled.expected) == pytest.approx(found.expected, rel=1e-8)
    assert float(settled.worst) == pytest.approx(found.worst[0], rel=1e-8)
    assert min(float(step.slack) for step in settled.steps) == pytest.approx(found.slack, abs=1e-7)
    assert settled.enclosure.cost < 1e-9 * found.expected


def test_the_cost_is_that_of_the_exact_walk_to_forty_digits():
    plant, inc, claim = clipped()
    found, loop, terminal = walked(plant, inc, claim)
    settled = settle(found, loop, claim, in_places(terminal, SHARE))
    # The walk over simplices in Fractions ends cells at other steps; the same tail cost follows to its slack of 1e-10.
    exactly = walk(replace(loop, arithmetic="exact"), claim, terminal)
    assert abs(float(settled.expected / exactly.done.expected_cost() - 1)) < 1e-10
    assert settled.enclosure.cost < 1e-60


def parts(plant, inc, claim):
    found, loop, _ = walked(plant, inc, claim)
    laws = placed_laws(loop, found.trails.patterns)
    moved = motions(loop, claim, found.trails, laws)
    return found, planes(found, claim.initial.support, laws, moved), moved


def test_maps_planes_and_costs_are_those_of_the_walk():
    found, (a, b), moved = parts(*clipped())
    cells = found.arrived
    np.testing.assert_allclose(floats(a), cells.planes[:, :-1], atol=1e-11 * np.abs(cells.planes).max())
    np.testing.assert_allclose(floats(b), cells.planes[:, -1], atol=1e-11 * np.abs(cells.planes).max())
    np.testing.assert_allclose(floats(moved.F[found.node]), cells.motion[:, :, :-1], atol=1e-10)
    at_center = (cells.motion[:, :, :-1] @ cells.center[:, :, None])[:, :, 0]
    np.testing.assert_allclose(floats(moved.f[found.node]), cells.motion[:, :, -1] - at_center, atol=1e-10)


def test_vertices_are_refined_to_the_last_places_and_a_missing_or_wrong_one_is_noticed():
    found, (a, b), _ = parts(*clipped())
    cells = found.arrived
    vertices = refined(cells, a, b)
    assert vertices.error < 1e-70 and trouble(cells, a, b, vertices) == ""
    np.testing.assert_allclose(floats(vertices.points), cells.start, atol=1e-12)
    row = cells.facets[3] // 2
    at = times(a[row], vertices.points[3][:, None])[:, 0] - b[row]
    assert np.max(np.abs(floats(at))) < 1e-70
    outside = replace(vertices, points=vertices.points + placed(np.array([0.05, 0.0])))
    assert "facet" in trouble(cells, a, b, outside)
    keep = np.arange(len(cells.owner)) != 2
    fewer = replace(cells, owner=cells.owner[keep], facets=cells.facets[keep], start=cells.start[keep])
    assert "close up" in trouble(fewer, a, b, replace(vertices, points=vertices.points[keep]))


def test_a_facet_on_the_wrong_side_is_noticed():
    found, (a, b), _ = parts(*clipped())
    cells = found.arrived
    swapped = replace(cells, facets=cells.facets ^ 1)
    assert "facet" in trouble(swapped, a, b, refined(cells, a, b))


def test_parallel_planes_are_refused():
    found, (a, b), _ = parts(*clipped())
    same = np.repeat(a[:1], len(a), axis=0)
    assert "parallel" in refined(found.arrived, same, b)


def _floor(value):
    return (value.numerator << 256) // value.denominator


def test_places_round_down_once():
    rng = np.random.default_rng(4)
    A, B = (np.vectorize(lambda z: Fraction(z) / 7, otypes=[object])(rng.standard_normal(shape))
            for shape in ((3, 2, 4), (3, 4, 5)))
    A, B = (np.vectorize(lambda z: Fraction(_floor(z), 1 << 256), otypes=[object])(part) for part in (A, B))
    exactly = [[[sum(A[s, i, k] * B[s, k, j] for k in range(4)) for j in range(5)] for i in range(2)]
               for s in range(3)]
    product = times(placed(A), placed(B))
    gap = np.array([[[exactly[s][i][j] - Fraction(int(product[s, i, j]), 1 << 256) for j in range(5)] for i in range(2)]
                    for s in range(3)])
    assert np.all(gap >= 0) and np.all(gap < Fraction(1, 1 << 256)) and np.any(gap > 0)
    np.testing.assert_allclose(floats(scaled(placed(A), placed(A))), (A * A).astype(float), rtol=1e-15)
    square = rng.standard_normal((7, 5, 5))
    np.testing.assert_allclose(floats(determinants(placed(square))), np.linalg.det(square), rtol=1e-10)


def test_a_lost_or_doubled_cell_shows_in_the_volumes():
    plant, inc, claim = clipped()
    found, loop, terminal = walked(plant, inc, claim)
    kept = np.arange(len(found.arrived)) != 1
    fewer = replace(found, arrived=found.arrived.take(kept), node=found.node[kept], steps_taken=found.steps_taken[kept])
    assert "volumes" in settle(fewer, loop, claim, in_places(terminal, SHARE))
    twice = [0, *range(len(found.arrived))]
    cells = type(found.arrived).joined_all([found.arrived.take(np.array([0])), found.arrived], found.arrived.planes)
    more = replace(found, arrived=cells, node=found.node[twice], steps_taken=found.steps_taken[twice])
    assert "volumes" in settle(more, loop, claim, in_places(terminal, SHARE))
    unfinished = replace(found, alive=found.arrived)
    assert "every starting point" in settle(unfinished, loop, claim, in_places(terminal, SHARE))
