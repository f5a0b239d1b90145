"""Unions of convex polygons: filled once, outlined where they end, and meshes that fill what they say."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.path import Path

from inc_casadi import INC, Box, Plant, Polytope, Regional, certify, simulate
from inc_casadi.plotting.meshes import cost_at, mesh
from inc_casadi.plotting.outlines import around, draw_union, hull, union_path
from inc_casadi.plotting.style import new_figure
from inc_casadi.plotting.union_outline import boundary

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def area(corners: np.ndarray) -> float:
    x, y = corners.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def drawn(polygons: list[np.ndarray], low: float, high: float) -> np.ndarray:
    """The darkness, in [0, 1], of each pixel of a picture of the filled union alone, rows from below."""
    figure = new_figure(2.0, 2.0)
    figure.set_layout_engine("none")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    draw_union(axes, polygons, "black", "none")
    axes.set_xlim(low, high)
    axes.set_ylim(low, high)
    figure.canvas.draw()
    return 1 - np.asarray(figure.canvas.buffer_rgba())[::-1, :, 0] / 255.0


def length(segments: np.ndarray) -> float:
    return float(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum())


def test_the_hull_keeps_corners_only_and_turns_left():
    rng = np.random.default_rng(1)
    points = np.vstack([SQUARE, rng.uniform(0, 1, (50, 2)), [[0.5, 0.0], [1.0, 0.3]]])
    corners = hull(rng.permutation(points))
    assert {tuple(x) for x in corners} == {tuple(x) for x in SQUARE} and area(corners) == pytest.approx(1.0)
    assert len(hull(np.array([[0.0, 0.0], [2.0, 2.0], [1.0, 1.0]]))) == 2
    assert len(hull(np.zeros((3, 2)))) == 1


def test_corners_in_any_order_are_sorted_counterclockwise():
    rng = np.random.default_rng(2)
    angles = [np.sort(rng.uniform(0, 2 * np.pi, k)) for k in (3, 5, 8)]
    shapes = [np.array([3 * i, 0]) + np.stack([2 * np.cos(t), np.sin(t)], axis=1) for i, t in enumerate(angles)]
    corners, counts = around([rng.permutation(shape) for shape in shapes])
    assert counts.tolist() == [3, 5, 8]
    for mine, shape in zip(np.split(corners, np.cumsum(counts)[:-1]), shapes, strict=True):
        assert area(mine) == pytest.approx(area(shape)) and area(mine) > 0


def test_each_outline_of_the_path_is_closed():
    path = union_path([SQUARE[:3], SQUARE[[2, 0, 3]] + 4])
    assert path.codes.tolist() == 2 * [Path.MOVETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY]
    assert np.array_equal(path.vertices[[0, 4]], path.vertices[[3, 7]])


def test_touching_and_overlapping_polygons_are_filled_without_a_seam():
    slanted = [np.array([[0, 0], [1, 0], [0.37, 1], [0, 1]]), np.array([[1, 0], [1, 1], [0.37, 1]]), SQUARE * 0.5 + 0.1]
    picture = drawn(slanted, -0.5, 1.5)
    n = len(picture)
    inside = picture[n // 4 + 1: 3 * n // 4 - 1, n // 4 + 1: 3 * n // 4 - 1]
    assert inside.min() == pytest.approx(1.0)
    assert picture.sum() / picture.size == pytest.approx(0.25, abs=0.01)


def test_the_boundary_is_that_of_the_union():
    ring = [SQUARE * [3, 1], SQUARE * [3, 1] + [0, 2], SQUARE * [1, 1] + [0, 1], SQUARE * [1, 1] + [2, 1]]
    assert length(boundary(ring)) == pytest.approx(12 + 4, abs=1e-4)  # the hole has an edge, too
    assert length(boundary([SQUARE, SQUARE * 0.3 + 0.2])) == pytest.approx(4.0)  # one within another adds nothing
    cross = [SQUARE * [3, 1] + [0, 1], SQUARE * [1, 3] + [1, 0]]
    assert length(boundary(cross)) == pytest.approx(12.0, abs=1e-4)
    assert length(boundary([SQUARE, SQUARE + [1.0, 0.25]])) == pytest.approx(8 - 1.5, abs=1e-4)


def test_points_of_the_boundary_have_the_union_on_one_side():
    rng = np.random.default_rng(4)
    polygons = [hull(rng.normal(size=(6, 2)) + rng.uniform(-2, 2, 2)) for _ in range(12)]
    within = [Path(np.vstack([p, p[:1]])) for p in polygons]

    def held(x: np.ndarray) -> np.ndarray:
        return np.any([path.contains_points(x) for path in within], axis=0)

    segments = boundary(polygons)
    middle, along = segments.mean(axis=1), segments[:, 1] - segments[:, 0]
    aside = 1e-5 * np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
    assert not held(middle + aside).any() and held(middle - aside).all()


def test_flat_polygons_are_their_own_boundary():
    assert length(boundary([np.array([[0.0, 0.0], [3.0, 4.0]])])) == pytest.approx(10.0)  # seen from both sides
    assert boundary([np.zeros((2, 2))]).shape == (0, 2, 2)


@pytest.mark.parametrize("region", [Box([-1.0, 0.0], [1.0, 3.0]),
                                    Polytope([[1, 1], [-1, 0], [0, -1], [0, 1]], [2, 0, 0, 1.5])])
def test_a_mesh_fills_its_region(region: Box | Polytope):
    made = mesh(region, 500)
    corners = made.nodes[made.triangles]
    areas = 0.5 * np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    assert areas.sum() == pytest.approx(region.volume) and len(areas) == pytest.approx(500, rel=0.2)
    assert np.all(region.contains(made.nodes.T, tol=1e-9))


def test_the_cost_at_a_point_is_that_of_its_motion():
    plant, law = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]]), INC.saturated([[-1.3749, -2.6490]], 1.0)
    triangle = Polytope([[1.0, 1.0], [-1.0, 0.3], [0.1, -1.0]], [1.0, 0.7, 0.8])
    certificate = certify(plant, law, Regional(triangle, Box([-1.0], [1.0]), np.eye(2), [[0.05]], 0.98)).require()
    x = np.column_stack([triangle.sample(200, np.random.default_rng(0)), triangle.vertices])
    simulated = simulate(plant, law, x, steps=300).cost(np.eye(2), [[0.05]], 0.98)
    assert cost_at(certificate.walk, x.T) == pytest.approx(simulated, rel=1e-8)
    assert np.isnan(cost_at(certificate.walk, np.array([[9.0, 9.0], [0.0, 9.0]]))).all()
