"""Covers: simplices that fill a polytope, each with one affine law per source, against the laws evaluated directly."""

from dataclasses import replace

import draws
import numpy as np
import pytest

from inc_casadi import Box, LeakyReLU, Polytope, ReLU, Saturation
from inc_casadi.errors import InvalidInputError
from inc_casadi.pieces.cover import cover, one_law_each, source_of, triangulated
from inc_casadi.sets.simplex import volumes

UNITS = (ReLU(), Saturation(), LeakyReLU(0.3), ReLU(), Saturation())
REGION = Box([-1.0, -2.0, 0.5], [2.0, 1.0, 1.5])
C = np.array([[1.0, 0.5, 0.0], [0.0, -1.0, 2.0], [0.3, 0.0, 1.0], [1.0, 1.0, 1.0]])


def law(seed):
    drawn = draws.controller(np.random.default_rng(seed), m=2, p=4, units=UNITS, gain=1.0, bias=0.7)
    return replace(drawn, U=2 * drawn.U)


def inside(simplices, seed):
    """One random point of each simplex, columns (n, N)."""
    weights = np.random.default_rng(seed).dirichlet(np.ones(4), size=len(simplices.now))
    return np.einsum("nk,nki->in", weights, simplices.now)


def by_pieces(source, patterns, x):
    laws = source.laws(patterns)
    return np.einsum("kmn,nk->mk", laws.Gx, x) + laws.g.T


@pytest.mark.parametrize("seed", range(3))
def test_the_law_of_each_simplex_is_the_controller(seed):
    inc = law(seed)
    source = source_of(inc, C)
    found = cover([source], REGION)
    assert found.ended == "" and found.done.all() and len(np.unique(found.patterns[0], axis=0)) > 6
    x = inside(found.simplices, seed)
    np.testing.assert_allclose(by_pieces(source, found.patterns[0], x), inc(C @ x), atol=1e-11)
    corners = found.simplices.now[:, 2].T
    np.testing.assert_allclose(by_pieces(source, found.patterns[0], corners), inc(C @ corners), atol=1e-11)


def test_the_simplices_fill_the_region():
    found = cover([source_of(law(4), C)], REGION)
    sizes = volumes(found.simplices.now)
    assert sizes.sum() == pytest.approx(REGION.volume, rel=1e-12)
    np.testing.assert_allclose(sizes, found.simplices.weight * REGION.volume, atol=1e-12)
    assert REGION.contains(found.simplices.now.reshape(-1, 3).T, 1e-12).all()


def test_two_sources_are_both_affine_on_each_simplex():
    first, second = law(5), law(6)
    sources = [source_of(first, C), source_of(second, C)]
    found = cover(sources, REGION)
    x = inside(found.simplices, 7)
    for source, patterns, inc in zip(sources, found.patterns, (first, second), strict=True):
        np.testing.assert_allclose(by_pieces(source, patterns, x), inc(C @ x), atol=1e-11)
    assert found.simplices.weight.sum() == pytest.approx(1.0, rel=1e-12)


def test_a_law_that_is_affine_already_is_not_cut():
    region = Polytope(np.vstack([-np.eye(2), np.ones((1, 2))]), [0.0, 0.0, 1.0])
    found = cover([source_of(draws.controller(np.random.default_rng(0), m=1, p=2, units=()), np.eye(2))], region)
    assert len(found.simplices) == 1 and found.patterns[0].shape == (1, 0)


def test_fractions_cut_without_losing_anything():
    inc = draws.controller(np.random.default_rng(8), m=2, p=2, units=UNITS[:3], gain=1.0, bias=0.7)
    region = Box([-1.0, -2.0], [1.0, 1.5])
    by_floats = cover([source_of(inc, np.eye(2))], region)
    exactly = cover([source_of(inc, np.eye(2), "exact")], region)
    assert exactly.simplices.weight.sum() == 1 and len(exactly.simplices) == len(by_floats.simplices)
    for patterns in np.unique(by_floats.patterns[0], axis=0):
        share = [np.sum(each.simplices.weight[(each.patterns[0] == patterns).all(axis=1)]) for each in (by_floats, exactly)]
        assert float(share[1]) == pytest.approx(share[0], rel=1e-10)


def test_a_budget_of_pieces_ends_it_and_says_which_are_done():
    inc = law(9)
    source = source_of(inc, C)
    found = cover([source], REGION, pieces=60)
    assert found.ended == "more than 60 simplices" and 0 < found.done.sum() < len(found.done)
    assert found.simplices.weight.sum() == pytest.approx(1.0, rel=1e-12)
    done = found.finished
    corners = done.simplices.now.reshape(-1, 3).T
    by_law = by_pieces(source, np.repeat(done.patterns[0], 4, axis=0), corners)
    np.testing.assert_allclose(by_law, inc(C @ corners), atol=1e-11)
    # What is not done is not affine: some vertex contradicts the law of its centroid.
    rest = replace(found, done=~found.done).finished
    corners = rest.simplices.now.reshape(-1, 3).T
    gap = np.abs(by_pieces(source, np.repeat(rest.patterns[0], 4, axis=0), corners) - inc(C @ corners)).max()
    assert gap > 1e-3


def test_no_time_ends_it():
    assert cover([source_of(law(9), C)], REGION, seconds=-1.0).ended == "the time limit"


def test_parents_are_the_simplices_that_were_cut():
    source = source_of(law(10), C)
    start = triangulated(REGION, np.asarray)
    parts = one_law_each(source, start, 10**6, np.inf)
    weights = np.bincount(parts.parent, parts.simplices.weight)
    np.testing.assert_allclose(weights, start.weight, rtol=1e-12)


def test_a_smooth_unit_is_refused():
    with pytest.raises(InvalidInputError, match="hidden unit 2 has activation"):
        source_of(draws.controller(np.random.default_rng(0)), C)
