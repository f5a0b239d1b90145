"""The polytope: vertices, half-spaces and triangulation describe one set, at every size and place."""

import pickle
from itertools import combinations, product

import numpy as np
import pytest
from scipy.optimize import linprog

from inc_casadi.errors import DimensionError, EmptySetError, InvalidInputError, SolverError
from inc_casadi.sets import Box, Polytope, halfspaces
from inc_casadi.sets.simplex import volumes

# A skewed pentagon: x >= -1, y >= -0.5, and three slanted sides.
H2 = np.array([[-1.0, 0.0], [0.0, -2.0], [1.0, 1.0], [1.0, -0.5], [-0.4, 1.0]])
h2 = np.array([1.0, 1.0, 2.0, 1.0, 1.5])


def random_halfspaces(n, seed):
    rng = np.random.default_rng(seed)
    H = np.vstack([-np.eye(n), np.ones((1, n)), rng.standard_normal((n + 2, n))])
    return H, 1.0 + rng.random(len(H))


def vertices_by_enumeration(H, h):
    """Solve every choice of n half-spaces and keep what satisfies the others: no Qhull."""
    n, found = H.shape[1], []
    for rows in combinations(range(len(h)), n):
        if abs(np.linalg.det(H[list(rows)])) > 1e-9:
            x = np.linalg.solve(H[list(rows)], h[list(rows)])
            if np.all(H @ x <= h + 1e-9):
                found.append(x)
    return np.array(found).T


def sorted_columns(points):
    return points[:, np.lexsort(np.round(points, 7))]


@pytest.mark.parametrize(("H", "h"), [(H2, h2), *(random_halfspaces(n, seed=n - 2) for n in (3, 4, 5))])
def test_vertices_agree_with_enumeration(H, h):
    polytope = Polytope(H, h)
    expected = vertices_by_enumeration(H, h)
    np.testing.assert_allclose(sorted_columns(polytope.vertices), sorted_columns(expected), atol=1e-9)
    assert np.all(H @ polytope.vertices <= h[:, None] + 1e-12)


@pytest.mark.parametrize("n", [2, 3, 4])
def test_a_vertex_where_many_half_spaces_meet_is_listed_once(n):
    signs = np.array(list(product([-1.0, 1.0], repeat=n)))
    cross = Polytope(signs, np.ones(2**n))
    expected = np.hstack([np.eye(n), -np.eye(n)])
    np.testing.assert_allclose(sorted_columns(cross.vertices), sorted_columns(expected), atol=1e-14)
    assert cross.volume == pytest.approx(2**n / np.prod(np.arange(1, n + 1)), rel=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_rounding_does_not_split_such_a_vertex(seed):
    rng = np.random.default_rng(seed)
    turn, offset = np.linalg.qr(rng.standard_normal((4, 4)))[0], rng.standard_normal(4)
    signs = np.array(list(product([-1.0, 1.0], repeat=4))) @ turn
    cross = Polytope(signs, 1 + signs @ offset)
    expected = turn.T @ np.hstack([np.eye(4), -np.eye(4)]) + offset[:, None]
    np.testing.assert_allclose(sorted_columns(cross.vertices), sorted_columns(expected), atol=1e-13)
    disturbed = Polytope(signs, 1 + signs @ offset + 1e-11 * rng.standard_normal(16))
    np.testing.assert_allclose(sorted_columns(disturbed.vertices), sorted_columns(expected), atol=1e-10)


@pytest.mark.parametrize("n", [2, 3, 5])
def test_vertices_of_a_slanted_elongated_polytope_are_exact_to_rounding(n):
    rng = np.random.default_rng(n)
    for _ in range(5):
        turn = np.linalg.qr(rng.standard_normal((n, n)))[0]
        H, h = random_halfspaces(n, n)
        H = H / np.logspace(-3, 0, n) @ turn
        slack = np.sort(np.abs(h[:, None] - H @ Polytope(H, h).vertices) / np.linalg.norm(H, axis=1)[:, None], axis=0)
        assert np.max(slack[:n]) < 3e-15


@pytest.mark.parametrize("seed", range(4))
def test_crowded_vertices_far_from_the_origin_are_found(seed):
    # Each vertex lies on dozens of half-spaces whose offsets carry rounding; Qhull's default options give up on most.
    points = np.random.default_rng(seed).standard_normal((5, 20)) + 100.0
    hull = Polytope.from_vertices(points)
    again = Polytope(hull.H, hull.h)
    assert again.vertices.shape == hull.vertices.shape
    np.testing.assert_allclose(sorted_columns(again.vertices), sorted_columns(hull.vertices), atol=1e-7)


def test_a_missing_vertex_is_noticed(monkeypatch):
    polytope = Polytope(*random_halfspaces(3, 1))
    view, z = polytope._frame, (polytope.vertices - polytope._frame.origin[:, None]) / polytope._frame.widths[:, None]
    assert halfspaces._fills(view, z.T)
    assert not any(halfspaces._fills(view, np.delete(z.T, i, axis=0)) for i in range(z.shape[1]))
    clipped = Polytope([*SQUARE, [1, 1]], [1, 1, 1, 1, 1])._frame
    assert not halfspaces._fills(clipped, np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]]))
    monkeypatch.setattr(halfspaces, "_fills", lambda *_: False)
    with pytest.raises(SolverError, match=r"half-spaces in R\^3"):
        halfspaces.vertices(view)


def test_an_interval_is_cut_by_its_tightest_ends():
    interval = Polytope([[2.0], [-4.0], [1.0], [-1.0]], [3.0, 2.0, 9.0, 5.0])
    assert interval.vertices.tolist() == [[-0.5, 1.5]]
    assert interval.volume == 2.0 and interval.center.tolist() == [0.5]
    assert interval.simplices().tolist() == [[[-0.5], [1.5]]]


@pytest.mark.parametrize("size", [1e-12, 1e-6, 1.0, 1e6, 1e12])
@pytest.mark.parametrize("offset", [0.0, 10.0])
def test_size_and_place_change_nothing_else(size, offset):
    c = size * offset * np.array([1.0, -2.0])
    moved, plain = Polytope(H2, size * h2 + H2 @ c), Polytope(H2, h2)
    expected = size * sorted_columns(plain.vertices) + c[:, None]
    np.testing.assert_allclose(sorted_columns((moved.vertices - c[:, None]) / size) * size + c[:, None], expected,
                               rtol=1e-12)
    assert moved.volume == pytest.approx(size**2 * plain.volume, rel=1e-10)
    np.testing.assert_allclose(moved.covariance, size**2 * plain.covariance, rtol=1e-9)


def test_coordinates_of_very_different_units_and_rows_of_any_length():
    units, lengths = np.array([1e-6, 1e6]), np.array([1e-5, 1.0, 1e8, 3.0, 1e-3])
    scaled, plain = Polytope(lengths[:, None] * H2 / units, lengths * h2), Polytope(H2, h2)
    found = sorted_columns(scaled.vertices / units[:, None])
    np.testing.assert_allclose(found, sorted_columns(plain.vertices), rtol=1e-9)


def test_a_remote_half_space_does_not_hide_the_set():
    square = Polytope([[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1]], [1, 0, 1, 0, 1e12])
    assert sorted(map(tuple, square.vertices.T)) == [(0, 0), (0, 1), (1, 0), (1, 1)]


def test_a_thin_diagonal_strip_is_accepted_and_exact():
    strip = Polytope([[1, 1], [-1, -1], [1, -1], [-1, 1]], [1e-5, 1e-5, 1, 1])
    assert strip.volume == pytest.approx(2e-5, rel=1e-9)
    assert strip.vertices.shape == (2, 4)
    with pytest.raises(EmptySetError, match="no interior to rounding"):
        Polytope([[1, 1], [-1, -1], [1, -1], [-1, 1]], [1e-10, 1e-10, 1, 1])


def test_a_width_of_a_few_units_in_the_last_place_is_rounding():
    assert Polytope([[1.0], [-1.0]], [1 + 1e-12, -1.0]).volume == pytest.approx(1e-12, rel=1e-3)
    with pytest.raises(EmptySetError, match="no interior to rounding"):
        Polytope([[1.0], [-1.0]], [1 + 4e-15, -1.0])


@pytest.mark.parametrize(("H", "h"), [(H2, h2), random_halfspaces(3, 1), random_halfspaces(5, 3)])
def test_the_triangulation_fills_the_polytope(H, h):
    polytope = Polytope(H, h)
    simplices = polytope.simplices()
    assert np.all(volumes(simplices) > 0)
    points = np.random.default_rng(6).uniform(-2, 4, (len(H[0]), 2000))
    points = np.hstack([points, polytope.center[:, None] + 0.3 * (points - polytope.center[:, None])])
    edges = (simplices[:, 1:] - simplices[:, :1]).transpose(0, 2, 1)
    inner = np.einsum("sij,spj->spi", np.linalg.inv(edges), points.T[None] - simplices[:, :1])
    inside = np.all(inner >= -1e-12, axis=2) & (inner.sum(axis=2) <= 1 + 1e-12)
    within = polytope.contains(points)
    assert 20 < within.sum() < len(within)
    np.testing.assert_array_equal(inside.sum(axis=0), within.astype(int))


def test_volume_by_the_shoelace_formula():
    polytope = Polytope(H2, h2)
    x, y = polytope.vertices - polytope.center[:, None]
    turn = np.argsort(np.arctan2(y, x))
    x, y = x[turn], y[turn]
    assert polytope.volume == pytest.approx(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2, rel=1e-12)


def test_volume_grows_by_the_determinant():
    H, h = random_halfspaces(4, 2)
    M = np.random.default_rng(7).standard_normal((4, 4))
    image = Polytope(H @ np.linalg.inv(M), h)
    assert image.volume == pytest.approx(abs(np.linalg.det(M)) * Polytope(H, h).volume, rel=1e-9)


def test_support_agrees_with_a_linear_program():
    H, h = random_halfspaces(4, 2)
    directions = np.random.default_rng(8).standard_normal((4, 12))
    expected = [-linprog(-d, A_ub=H, b_ub=h, bounds=(None, None)).fun for d in directions.T]
    np.testing.assert_allclose(Polytope(H, h).support(directions), expected, rtol=1e-8)
    assert isinstance(Polytope(H, h).support(directions[:, 0]), float)


def test_the_tolerance_of_membership_is_a_distance_for_rows_of_any_length():
    square = Polytope([[1e3, 0], [-1, 0], [0, 1], [0, -1e-3]], [1e3, 1, 1, 1e-3])
    assert square.contains([1 + 1e-6, 0.0]) is False
    assert square.contains([1 + 1e-6, 0.0], tol=1.1e-6) is True
    assert square.contains([[1 + 1e-6, 0.0], [0.0, -1 - 1e-6]], tol=0.9e-6).tolist() == [False, False]


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_the_hull_of_the_vertices_is_the_polytope(n):
    H, h = random_halfspaces(n, 9)
    polytope = Polytope(H, h)
    scatter = np.hstack([polytope.vertices, polytope.sample(30, np.random.default_rng(10)), polytope.vertices])
    hull = Polytope.from_vertices(scatter)
    assert {tuple(v) for v in hull.vertices.T} == {tuple(v) for v in polytope.vertices.T}
    assert hull.volume == pytest.approx(polytope.volume, rel=1e-9)
    directions = np.random.default_rng(11).standard_normal((n, 20))
    np.testing.assert_allclose(hull.support(directions), polytope.support(directions), rtol=1e-9)
    points = np.random.default_rng(12).uniform(-2, 4, (n, 3000))
    np.testing.assert_array_equal(hull.contains(points), polytope.contains(points))


def test_the_hull_of_a_cube_has_six_half_spaces():
    cube = Polytope.from_vertices(Box([-1, 0, 2], [1, 3, 7]).vertices)
    assert cube.H.shape == (6, 3) and cube.volume == pytest.approx(30.0)


def test_points_on_an_edge_are_no_vertices():
    assert Polytope.from_vertices([[0, 1, 2, 2, 0, 1], [0, 0, 0, 2, 2, 1]]).vertices.tolist() == [[0, 2, 2, 0],
                                                                                               [0, 0, 2, 2]]


def test_a_zero_row_says_nothing_or_forbids_everything():
    assert Polytope([[1], [0], [-1]], [1, 0, 1]).H.shape == (2, 1)
    with pytest.raises(EmptySetError, match=r"row 1 of H is zero and h\[1\] = -0.5"):
        Polytope([[1], [0], [-1]], [1, -0.5, 1])
    with pytest.raises(EmptySetError, match="every row of H is zero"):
        Polytope([[0, 0], [0, 0]], [1, 1])


SQUARE = [[1, 0], [-1, 0], [0, 1], [0, -1]]


@pytest.mark.parametrize(("H", "h", "message"), [
    (SQUARE, [1, -2, 1, 1], "is empty"),
    (SQUARE, [1, -1, 1, 1], "no interior"),
    (SQUARE, [1 / 3, -1 / 3, 1, 1], "no interior"),
    ([[1, 1], [-1, -1], [1, -1], [-1, 1]], [0.3, -0.1 - 0.2, 1, 1], "no interior"),
    (SQUARE, [0, 0, 0, 0], "no interior"),
    (SQUARE[:3], [1, 1, 1], "unbounded: nothing limits coordinate 1 from below"),
    (SQUARE[:2], [1, 1], "unbounded: no row of H holds coordinate 1"),
    ([[1, 1], [-1, -1], [2, 2]], [1, 1, 1], "unbounded"),
    ([[1.0]], [1], "unbounded"),
    ([[1, 2], [1, 1], [0, 1]], [1, 1, 1], "unbounded"),
])
def test_an_empty_flat_or_unbounded_polytope_is_refused(H, h, message):
    with pytest.raises(EmptySetError, match=message):
        Polytope(H, h)


@pytest.mark.parametrize("size", [1e-12, 1e-6, 1e6, 1e12])
def test_flat_and_empty_are_told_at_every_size(size):
    for h, message in (([1, -1, 1, 1], "no interior"), ([1, -1.001, 1, 1], "is empty")):
        with pytest.raises(EmptySetError, match=message):
            Polytope(SQUARE, size * np.array(h))


@pytest.mark.parametrize(("H", "h", "error", "message"), [
    (SQUARE, [1, 1, 1], DimensionError, "h has shape"),
    ([1, 2], [1, 1], DimensionError, "H has shape"),
    (np.zeros((0, 2)), [], DimensionError, "H has shape"),
    (np.zeros((2, 0)), [1, 1], DimensionError, "H has shape"),
    ([[np.nan]], [1], InvalidInputError, "H holds a NaN"),
    (SQUARE, [1, 1, 1, np.inf], InvalidInputError, "h holds"),
])
def test_a_bad_polytope_is_refused(H, h, error, message):
    with pytest.raises(error, match=message):
        Polytope(H, h)


@pytest.mark.parametrize(("points", "error", "message"), [
    ([[0, 1, 2], [5, 5, 5]], EmptySetError, "coordinate 1 equal to 5"),
    ([[0, 1, 2], [1, 2, 3]], EmptySetError, "lie in a hyperplane"),
    ([[0, 1], [1, 2]], EmptySetError, "lie in a hyperplane"),
    ([[3.0, 3.0]], EmptySetError, "coordinate 0"),
    (np.zeros((2, 0)), EmptySetError, "no point"),
    ([0, 1], DimensionError, "vertices has shape"),
    ([[0, np.nan]], InvalidInputError, "vertices holds a NaN"),
])
def test_bad_vertices_are_refused(points, error, message):
    with pytest.raises(error, match=message):
        Polytope.from_vertices(points)


def test_a_polytope_survives_pickling_and_cannot_be_written():
    polytope = Polytope(H2, h2)
    again = pickle.loads(pickle.dumps(polytope))
    np.testing.assert_array_equal(again.vertices, polytope.vertices)
    moments = (polytope.center, polytope.covariance)
    for array in (polytope.H, polytope.h, polytope.vertices, polytope.simplices(), *moments):
        assert not array.flags.writeable
