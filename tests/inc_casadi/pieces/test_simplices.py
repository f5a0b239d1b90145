"""Simplices carried as vertices: integrals, cuts and triangulations against sampling and hand calculations."""

from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import Box
from inc_casadi.blocks import exact
from inc_casadi.pieces.simplices import Simplices, begin, cut_along, levelled, pieces_of_cuts, steepest_crossing_edge


def draw(seed, N=5, n=3):
    """Simplices with different positions now and at the start, and cost forms that are sums of squares."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((N, n + 1, 2))
    start = rng.standard_normal((N, n + 1, n))
    return Simplices(rng.standard_normal((N, n + 1, n)), start, rng.dirichlet(np.ones(N)),
                     root @ np.swapaxes(root, 1, 2))


def dirichlet(seed, size, N=200_000):
    return np.random.default_rng(seed).dirichlet(np.ones(size), size=N)


def test_expected_cost_is_the_mean_over_uniform_points():
    simplices = draw(0)
    l = dirichlet(1, 4)
    each = np.einsum("ki,nij,kj->nk", l, simplices.cost, l)
    error = np.sqrt((simplices.weight ** 2 * each.var(axis=1)).sum() / each.shape[1])
    assert abs(simplices.weight @ each.mean(axis=1) - simplices.expected_cost()) < 4 * error


def test_expected_cost_of_a_form_by_hand():
    # On the segment [0, 1] with cost x^2 in barycentric form: the mean is 1/3, in Fractions exactly.
    edge = Simplices(*(exact(part) for part in (np.zeros((1, 2, 1)), np.zeros((1, 2, 1)), np.ones(1),
                                                np.array([[[0.0, 0.0], [0.0, 1.0]]]))))
    assert edge.expected_cost() == Fraction(1, 3)


def test_worst_cost_is_reached_at_a_vertex_and_by_no_sample():
    simplices = draw(2)
    l = dirichlet(3, 4, 2000)
    value, point = simplices.worst_cost()
    assert np.einsum("ki,nij,kj->nk", l, simplices.cost, l).max() <= value
    where = np.flatnonzero(np.all(simplices.start.reshape(-1, 3) == point, axis=1))
    assert where.size == 1
    piece, corner = divmod(int(where[0]), 4)
    assert simplices.cost[piece, corner, corner] == value


def test_a_split_keeps_weight_positions_and_cost_of_every_point():
    whole = draw(4, N=6)
    rng = np.random.default_rng(5)
    i, j, t = np.array([0, 1, 2, 3, 0, 2]), np.array([1, 3, 0, 2, 2, 1]), rng.uniform(0.1, 0.9, 6)
    halves = whole.split(i, j, t)
    assert len(halves) == 12
    np.testing.assert_allclose(halves.weight[:6] + halves.weight[6:], whole.weight, rtol=1e-14)
    np.testing.assert_allclose(halves.weight[:6], t * whole.weight, rtol=1e-14)
    assert halves.expected_cost() == pytest.approx(whole.expected_cost(), rel=1e-12)
    l = rng.dirichlet(np.ones(4), size=50)
    for half, shift in ((0, 0), (1, 6)):
        for k in range(6):
            # The new vertex (1 - t) v_i + t v_j takes the place of j in the first half, of i in the second.
            old = l.copy()
            gone, kept = ((j[k], i[k]), (i[k], j[k]))[half]
            share = (t[k], 1 - t[k])[half]
            old[:, gone], old[:, kept] = share * l[:, gone], l[:, kept] + (1 - share) * l[:, gone]
            for name in ("now", "start"):
                np.testing.assert_allclose(l @ getattr(halves, name)[shift + k], old @ getattr(whole, name)[k], atol=1e-12)
            np.testing.assert_allclose(np.einsum("pi,ij,pj->p", l, halves.cost[shift + k], l),
                                       np.einsum("pi,ij,pj->p", old, whole.cost[k], old), atol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_cutting_along_a_hyperplane_leaves_nothing_across_and_loses_nothing(n):
    whole = draw(6, N=7, n=n)
    normal = np.random.default_rng(7).standard_normal(n)
    pieces, parent, _ = cut_along(whole, whole.now @ normal)
    after = pieces.now @ normal
    assert not np.any((after.max(axis=1) > 1e-12) & (after.min(axis=1) < -1e-12))
    np.testing.assert_allclose(np.bincount(parent, pieces.weight, 7), whole.weight, rtol=1e-12)
    assert pieces.expected_cost() == pytest.approx(whole.expected_cost(), rel=1e-12)
    assert len(pieces) > 7


@pytest.mark.parametrize("n", [1, 2, 3, 5, 7])
def test_the_pieces_of_a_cut_are_counted_before_it_is_made(n):
    simplices = draw(4, N=40, n=n)
    height = np.random.default_rng(5).standard_normal((40, n + 1)).round(0)  # some vertices lie in the hyperplane
    assert pieces_of_cuts(height) == len(cut_along(simplices, height)[0])


def test_cutting_in_fractions_is_exact():
    whole = begin(exact(np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]])), exact(np.ones(1)))
    height = exact(np.array([[-1.0, 2.0, 2.0]]))
    pieces, _, _ = cut_along(whole, height)
    # By hand: the corner triangle with sides 1/3 has a ninth of the area.
    assert sorted(pieces.weight)[0] == Fraction(1, 9) and sum(pieces.weight) == 1
    assert {tuple(v) for v in pieces.start.reshape(-1, 2)} >= {(Fraction(1, 3), 0), (0, Fraction(1, 3))}


def test_a_hyperplane_through_vertices_only_cuts_what_it_crosses():
    whole = draw(8, N=3, n=2)
    pieces, parent, _ = cut_along(whole, np.array([[0.0, 1.0, 2.0], [-1.0, 0.0, -2.0], [-1.0, 0.0, 1.0]]))
    assert np.bincount(parent).tolist() == [1, 1, 2]


def test_the_steepest_edge_joins_the_lowest_and_the_highest_vertex():
    i, j = steepest_crossing_edge(np.array([[0.5, -2.0, 1.0], [-1.0, 3.0, -4.0]]))
    assert (i.tolist(), j.tolist()) == ([1, 2], [2, 1])


@pytest.mark.parametrize("gain", [[[1.0, -2.0, 0.5]], [[1.0, 1.0, 1.0], [0.0, -1.0, 2.0]]])
def test_levelled_is_a_triangulation_of_the_box_with_its_diagonal_along_levels(gain):
    box, gain = Box([-1.0, 0.0, -3.0], [1.0, 0.5, 2.0]), np.array(gain)
    vertices = levelled(box.simplices(), box.lower, box.upper, gain)
    volumes = np.abs(np.linalg.det(vertices[:, 1:] - vertices[:, :1])) / 6
    np.testing.assert_allclose(volumes, box.volume / 6)
    corners = {tuple(v) for v in box.vertices.T}
    assert {tuple(v) for v in vertices.reshape(-1, 3)} == corners
    # Each random point lies in exactly one simplex, so nothing overlaps.
    lifted = np.concatenate([vertices, np.ones((6, 4, 1))], axis=2)
    points = box.sample(500, np.random.default_rng(0))
    l = np.linalg.inv(np.swapaxes(lifted, 1, 2)) @ np.vstack([points, np.ones(500)])
    assert np.all((l.min(axis=1) > 0).sum(axis=0) == 1)
    shared = set.intersection(*({tuple(v) for v in simplex} for simplex in vertices))
    one, other = (np.array(v) for v in shared)
    climbs = [np.abs(gain @ (c - (box.lower + box.upper - c))).sum() for c in box.vertices.T]
    assert np.abs(gain @ (one - other)).sum() == pytest.approx(min(climbs))
