"""A walk over polytopes settled with 256 places: agreement with the walk in floats, and refusal of what is not so."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from walk_draws import USABLE, draw

from inc_casadi import INC, Box, Plant
from inc_casadi.claims.regional import Regional
from inc_casadi.pieces.cell_motions import motions, placed_laws, planes
from inc_casadi.pieces.cell_proof import settle
from inc_casadi.pieces.cell_vertices import refined, trouble
from inc_casadi.pieces.cell_walk import cell_walk
from inc_casadi.pieces.laws import PiecewiseLoop
from inc_casadi.pieces.places import determinants, floats, placed, scaled, times
from inc_casadi.pieces.terminal import find, in_fractions, in_places
from inc_casadi.pieces.walk import walk

SHARE = 1 - 2.0**-40


def walked(plant, inc, claim):
    loop = PiecewiseLoop(plant, inc)
    terminal, why = find(loop, claim)
    assert terminal is not None, why
    exactly = in_fractions(replace(loop, arithmetic="exact"), claim, terminal)
    return cell_walk(loop, claim, terminal), replace(loop, arithmetic="fixed"), exactly


def clipped(gain=((-1.37, -2.65),), limit=1.0, half=0.8):
    plant = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
    box = Box([-half, -half], [half, 0.9 * half])
    return plant, INC.saturated(gain, limit), Regional(box, Box([-limit], [limit]), np.eye(2), [[0.05]], 0.98)


@pytest.mark.parametrize("seed", USABLE)
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
    np.testing.assert_allclose(floats(moved.f[found.node]), cells.motion[:, :, -1], atol=1e-10)


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
    blurred = replace(vertices, error=1.0)
    assert trouble(cells, a, b, blurred) == "" or "facet" in trouble(cells, a, b, blurred)
    with pytest.raises(AssertionError, match="close up"):
        keep = np.arange(len(cells.owner)) != 2
        trouble(replace(cells, owner=cells.owner[keep], facets=cells.facets[keep], start=cells.start[keep]), a, b,
                replace(vertices, points=vertices.points[keep]))


def test_a_facet_on_the_wrong_side_is_noticed():
    found, (a, b), _ = parts(*clipped())
    cells = found.arrived
    swapped = replace(cells, facets=cells.facets ^ 1)
    assert "facet" in trouble(swapped, a, b, refined(cells, a, b))


def test_parallel_planes_are_refused():
    found, (a, b), _ = parts(*clipped())
    same = np.repeat(a[:1], len(a), axis=0)
    assert "parallel" in refined(found.arrived, same, b)


def test_places_round_down_once():
    rng = np.random.default_rng(4)
    A, B = rng.standard_normal((3, 2, 4)), rng.standard_normal((3, 4, 5))
    exactly = [[[sum(Fraction(A[s, i, k]) * Fraction(B[s, k, j]) for k in range(4)) for j in range(5)] for i in range(2)]
               for s in range(3)]
    product = times(placed(A), placed(B))
    gap = np.array([[[exactly[s][i][j] - Fraction(int(product[s, i, j]), 1 << 256) for j in range(5)] for i in range(2)]
                    for s in range(3)])
    assert np.all(gap >= 0) and np.all(gap < Fraction(1, 1 << 255))
    np.testing.assert_allclose(floats(scaled(placed(A), placed(A))), A * A, rtol=1e-15)
    square = rng.standard_normal((7, 5, 5))
    np.testing.assert_allclose(floats(determinants(placed(square))), np.linalg.det(square), rtol=1e-10)
