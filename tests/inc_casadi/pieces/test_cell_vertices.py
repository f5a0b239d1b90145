"""Vertices worked out anew: error bounds that are true, and lists of vertices that are not all of them."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import Box
from inc_casadi.blocks import exact
from inc_casadi.pieces.cell_vertices import refined, trouble
from inc_casadi.pieces.cells import cut, whole
from inc_casadi.pieces.fixed import ONE
from inc_casadi.pieces.linear import solve
from inc_casadi.pieces.places import placed

SQUARE = Box([-1.0, 0.0], [1.0, 3.0])


def shattered(n, rounds, seed):
    """A box cut along random hyperplanes through points within its pieces, and the planes with 256 places."""
    rng = np.random.default_rng(seed)
    cells = whole(Box(-np.ones(n), np.arange(1.0, n + 1)))
    for _ in range(rounds):
        normal = rng.standard_normal((len(cells), n))
        offset = (normal * cells.middles()).sum(axis=1)
        height = (normal[cells.owner] * cells.start).sum(axis=1) - offset[cells.owner]
        cells, _, _ = cut(cells, height, np.column_stack([normal, offset]), np.full(len(cells), 1e-12))
    return cells, *on_planes(cells)


def on_planes(cells):
    return placed(cells.planes[:, :-1]), placed(cells.planes[:, -1])


def fractions(array):
    return np.vectorize(lambda n: Fraction(int(n), ONE), otypes=[object])(array)


def errors(cells, a, b, vertices):
    """The exact distance of each coordinate (M, n) from where the vertex's planes meet."""
    rows = cells.facets // 2
    exactly = np.array([solve(fractions(a[row]), fractions(b[row])[:, None])[:, 0] for row in rows])
    return np.abs(fractions(vertices.points) - exactly)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_vertices_are_within_the_stated_error(n):
    cells, a, b = shattered(n, 3, seed=n)
    b = b + (b >> 40)  # the planes are not quite those that the vertices were computed with
    vertices = refined(cells, a, b)
    assert vertices.error < 1e-70 and trouble(cells, a, b, vertices) == ""
    assert np.max(errors(cells, a, b, vertices)) <= Fraction(vertices.error)


def test_the_error_is_true_also_where_newtons_method_has_not_converged(monkeypatch):
    """With an inverse that is short by 0.4 of itself, every step leaves 0.4 of the error, and the bound is attained."""
    cells = whole(Box([-1.0], [1.0]))
    a, b = placed(1e-3 * cells.planes[:, :-1]), placed(1e-3 * cells.planes[:, -1] + 1e-4)
    inverse = np.linalg.inv
    monkeypatch.setattr(np.linalg, "inv", lambda G: 0.6 * inverse(G))
    vertices = refined(cells, a, b)
    worst = np.max(errors(cells, a, b, vertices))
    assert worst <= Fraction(vertices.error) and float(worst) > 0.9 * vertices.error > 1e-9


def test_nearly_parallel_planes_are_refused_though_their_inverse_looks_right():
    cells = whole(SQUARE)
    a, b = on_planes(cells)
    slope = 2.0**-49
    a[0] = placed(np.array([1.0, 0.0]))
    a[2] = placed(np.array([1.0, slope]))
    a[3] = placed(np.array([-1.0, slope]))
    assert "parallel" in refined(cells, a, b)


def test_a_plane_without_direction_is_refused():
    cells = whole(SQUARE)
    a, b = on_planes(cells)
    a[1] = 0
    assert "no direction" in refined(cells, a, b)


def test_a_vertex_on_a_facet_that_is_not_its_own_is_noticed():
    """The right side x <= 1 moved onto the left side x >= -1: the left corners lie on it, or so near that it is unsure."""
    cells = whole(SQUARE)
    a, b = on_planes(cells)
    for beside in (0, 1 << 10, -(1 << 10)):
        moved = b.copy()
        moved[0] = placed(np.array(-1.0)) + beside
        vertices = refined(cells, a, moved)
        assert "facet" in trouble(cells, a, moved, replace(vertices, error=1e-70)), beside
    moved[0] = placed(np.array(-1.0)) + (1 << 30)
    vertices = refined(cells, a, moved)
    assert trouble(cells, a, moved, vertices) == ""  # 2^-226 is enough when the vertices are known to the last places
    assert "facet" in trouble(cells, a, moved, replace(vertices, error=2.0**-227))


def test_errors_larger_than_the_cell_leave_every_vertex_in_doubt():
    cells, a, b = shattered(2, 2, seed=5)
    vertices = replace(refined(cells, a, b), error=1.0)
    assert "facet" in trouble(cells, a, b, vertices)


def test_vertices_of_another_cell_do_not_close_a_gap():
    """Two halves of a square, the cut vertices of the lower listed with the facets of the upper: each edge has one end."""
    square = whole(SQUARE)
    cells, _, _ = cut(square, square.start[:, 0] - 0.25, np.array([[1.0, 0.0, 0.25]]), np.array([1e-12]))
    a, b = on_planes(cells)
    vertices = refined(cells, a, b)
    assert trouble(cells, a, b, vertices) == ""
    wrong = cells.facets.copy()
    new = (cells.facets // 2 == len(cells.planes) - 1).any(axis=1) & (cells.owner == 0)
    wrong[new] = np.where(wrong[new] // 2 == len(cells.planes) - 1, wrong[new] ^ 1, wrong[new])
    assert "facet" in trouble(replace(cells, facets=wrong), a, b, vertices)


def test_exact_numbers_are_used_as_they_are():
    """A third is no float: planes that meet at thirds are solved to the last places."""
    cells = whole(SQUARE)
    a, b = on_planes(cells)
    b[0] = placed(exact(np.array(1.0)) / 3).item()
    vertices = refined(cells, a, b)
    third = [int(n) for n in vertices.points[:, 0] if n > 0]
    assert third and all(abs(Fraction(n, ONE) - Fraction(1, 3)) < Fraction(4, ONE) for n in third)
