"""Pictures of sets in motion: reachable sets, regions of attraction, costs; what is drawn is what was computed."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Polygon, Rectangle
from matplotlib.path import Path

from inc_casadi import INC, Box, Ellipsoid, Plant, Regional, certify, simulate
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.figures import at_most
from inc_casadi.pieces.reach import ReachableSets, reachable
from inc_casadi.pieces.walk import Budget
from inc_casadi.plotting import plot_attraction, plot_cost, plot_reachable
from inc_casadi.plotting.attraction_figure import rounded_down
from inc_casadi.plotting.meshes import mesh
from inc_casadi.plotting.surface_figure import TRIANGLES
from inc_casadi.regional_certificate import certify_region

PLANT = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
LAW = INC.saturated([[-1.3749, -2.6490]], 1.0)
BOX = Box([-0.8, -0.8], [0.8, 0.8])
HALF = Box([-4.0, -1.0], [2.0, 1.0])


def legend(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def filled(axes: Any) -> list[PathPatch]:
    """The unions of polygons drawn, without their outlines."""
    return [part for part in axes.get_children() if isinstance(part, PathPatch) and part.get_facecolor()[3] > 0]


def total_area(path: Path) -> float:
    shapes = np.split(path.vertices, np.flatnonzero(path.codes == Path.CLOSEPOLY)[:-1] + 1)
    return sum(0.5 * float(np.sum(x[:-1] * y[1:] - y[:-1] * x[1:])) for x, y in (shape.T for shape in shapes))


@pytest.fixture(scope="module")
def sets() -> ReachableSets:
    return reachable(PLANT, LAW, BOX, 4)


@pytest.fixture(scope="module")
def plane(sets: ReachableSets) -> Any:
    return plot_reachable(sets, simulate(PLANT, LAW, BOX.sample(30, np.random.default_rng(0)), steps=9).x).axes[0]


def test_each_set_is_drawn_whole_and_in_turn(sets: ReachableSets, plane: Any):
    shown = filled(plane)
    assert len(shown) == 5
    for k, patch in enumerate(shown):
        exact = sum(float(np.sum(_areas(polygon))) for polygon in sets.polytopes(k))
        assert total_area(patch.get_path()) == pytest.approx(exact, rel=1e-9)
        assert patch.get_path().get_extents().get_points() == pytest.approx(sets.boxes[k])
    colours = [patch.get_facecolor()[:3] for patch in shown]
    assert len(set(colours)) == 5 and [np.sum(c) for c in colours] == sorted(np.sum(c) for c in colours)  # ever lighter


def _areas(points: np.ndarray) -> np.ndarray:
    order = np.argsort(np.arctan2(*(points - points.mean(axis=0)).T[::-1]))
    x, y = points[order].T
    return 0.5 * np.abs(x * np.roll(y, -1) - y * np.roll(x, -1)) if len(x) < 3 else np.array(
        [0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))])


def test_the_boxes_are_the_exact_ones(sets: ReachableSets, plane: Any):
    dashed = [part for part in plane.patches if isinstance(part, Rectangle)]
    corners = np.array([[part.get_xy(), (part.get_x() + part.get_width(), part.get_y() + part.get_height())]
                        for part in dashed])
    assert corners == pytest.approx(sets.boxes) and {part.get_linestyle() for part in dashed} == {"--"}


def test_simulated_motions_lie_on_top_and_within(sets: ReachableSets, plane: Any):
    [dots] = [line for line in plane.lines if line.get_marker() == "."]
    x = np.stack(dots.get_data()).reshape(2, 30, -1)
    assert x.shape[2] == 5  # steps that the sets do not cover are left out
    for k, patch in enumerate(filled(plane)):
        assert patch.get_path().contains_points(x[:, :, k].T, radius=1e-6).all() or k > 2  # later sets are thin
        assert np.all(sets.boxes[k, 0][:, None] <= x[:, :, k] + 1e-12) and dots.get_zorder() > patch.get_zorder()


def test_the_outline_of_a_set_has_no_inner_line(sets: ReachableSets, plane: Any):
    outlines = [part for part in plane.collections if isinstance(part, LineCollection)]
    first = np.array(outlines[0].get_segments())
    assert np.linalg.norm(first[:, 1] - first[:, 0], axis=1).sum() == pytest.approx(6.4)
    second = np.array(outlines[1].get_segments()).mean(axis=1)
    assert sets.pieces[1] == 3 and len(second) >= 6
    seam = np.array([[-0.2, 0.0], [0.0, 0.0], [0.2, 0.0]])  # the law changes here; the set goes on
    assert np.min(np.linalg.norm(second[:, None] - seam, axis=2)) > 0.1


def test_other_numbers_of_states_are_drawn_as_exact_intervals():
    plant = Plant([[1.02, 0.1, 0], [0, 1, 0.1], [0, -0.2, 0.9]], [[0, 0.02], [0, 0.1], [0.1, 0]])
    law = INC.linear([[-0.2, -0.3, -0.4], [-1.6, -1.0, -0.2]]).with_saturated_output(Box([-1, -0.5], [1, 0.5]))
    found = reachable(plant, law, Box([-0.5] * 3, [0.5] * 3), 6)
    panels = plot_reachable(found).axes
    assert [axes.get_ylabel() for axes in panels if axes.axison] == [
        "state $x_{1}$", "state $x_{2}$", "state $x_{3}$", "input $u_{1}$", "input $u_{2}$"]
    for axes, ends in zip(panels, [*np.moveaxis(found.boxes, 2, 0), *np.moveaxis(found.inputs, 2, 0)], strict=False):
        [bars] = [part for part in axes.collections if isinstance(part, LineCollection)]
        assert np.array(bars.get_segments())[:, :, 1] == pytest.approx(ends)


def test_points_of_another_dimension_are_refused(sets: ReachableSets):
    with pytest.raises(DimensionError, match=r"points has shape \(3, 4\)"):
        plot_reachable(sets, np.zeros((3, 4)))


def test_a_search_that_ended_early_says_so():
    found = reachable(PLANT, LAW, BOX, 20, budget=Budget(pieces=2))
    assert found.ended and "ended the search" in plot_reachable(found).axes[0].get_title()


@dataclass(frozen=True)
class Shown:
    """What the picture reads of a basin."""

    pieces: tuple[np.ndarray, ...]
    region: Box
    equilibrium: np.ndarray
    share: float
    ended: str = ""

    def polytopes(self) -> list[np.ndarray]:
        return list(self.pieces)


BASIN = Shown((np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), np.array([[1.0, 1.0], [1.0, 0.0], [0.0, 1.0]])), HALF,
              np.array([0.25, 0.5]), 1 / 12)


def test_the_certified_polygons_are_drawn_with_their_share_rounded_down():
    figure = plot_attraction(BASIN)
    [union] = filled(figure.axes[0])
    assert total_area(union.get_path()) == pytest.approx(1.0)
    assert legend(figure) == ["certified by exact pieces (in floats),\n8.33 % of the region", "region examined"]
    assert figure.axes[0].get_title() == "Region of attraction of $x^*$ = (0.25, 0.5)"
    [region] = [part for part in figure.axes[0].patches if isinstance(part, Polygon)]
    assert {tuple(x) for x in region.get_xy()} == {tuple(x) for x in HALF.vertices.T}
    assert rounded_down(0.99999) == "99.99 %" and rounded_down(1.0) == "100.00 %"


def test_an_empty_basin_and_an_exhausted_budget_are_told():
    figure = plot_attraction(Shown((), HALF, np.zeros(2), 0.0, "more than 7 pieces"))
    assert legend(figure)[0] == "nothing is certified" and not filled(figure.axes[0])
    assert "more than 7 pieces" in figure.axes[0].get_title()


def test_ellipsoids_are_drawn_on_their_level_under_the_name_given():
    shapes = {"one": Ellipsoid([[2.0, 0.5], [0.5, 1.0]], [0.3, -0.2], 0.7), "two": Ellipsoid(np.eye(2))}
    figure = plot_attraction(ellipsoids=shapes)
    assert legend(figure) == ["one", "two"]  # nobody is called certified by the picture itself
    for line, shape in zip(figure.axes[0].lines, shapes.values(), strict=True):
        e = np.stack(line.get_data()) - shape.center[:, None]
        assert np.sum(e * (shape.P @ e), axis=0) == pytest.approx(shape.level)
    assert len({line.get_linestyle() for line in figure.axes[0].lines}) == 2


def test_a_certificate_stands_for_its_ellipsoid_only_while_it_holds():
    shape = Ellipsoid(np.diag([4.0, 9.0]))
    holds = SimpleNamespace(ellipsoid=shape, holds=lambda: True)
    [line] = plot_attraction(ellipsoids={"certified": holds}).axes[0].lines
    assert np.sum([[4.0], [9.0]] * np.stack(line.get_data()) ** 2, axis=0) == pytest.approx(1.0)
    fails = SimpleNamespace(ellipsoid=shape, holds=lambda: False, reason="a margin is negative")
    with pytest.raises(InvalidInputError, match="'certified' does not hold, so it has no region: a margin is negative"):
        plot_attraction(ellipsoids={"certified": fails})
    with pytest.raises(InvalidInputError, match="'box' is a Box"):
        plot_attraction(ellipsoids={"box": BOX})


def test_the_simulated_ground_covers_the_points_that_converge():
    grid = np.stack(np.meshgrid(np.linspace(-4, 2, 61), np.linspace(-1, 1, 41))).reshape(2, -1)
    good = grid[0] + 2 * grid[1] < 0.5
    axes = plot_attraction(BASIN, simulated=(grid, good)).axes[0]
    ground = min((part for part in axes.collections if len(part.get_facecolor())), key=lambda part: part.get_zorder())
    held = np.any([path.contains_points(grid.T, radius=1e-9) for path in ground.get_paths()], axis=0)
    within = np.abs(grid[0] + 2 * grid[1] - 0.5) > 0.2
    assert np.array_equal(held[within], good[within]) and ground.get_zorder() < filled(axes)[0].get_zorder()
    for all_or_none in (True, False):
        figure = plot_attraction(simulated=(grid, np.full(grid.shape[1], all_or_none)))
        assert len(figure.axes[0].patches) == all_or_none
        assert legend(figure) == [f"converges in simulation, {100 * all_or_none} % of 2501 points"]


def test_the_strip_is_shaded_beyond_its_bound_within_the_picture():
    v, bound = np.array([0.6, -0.8]), 0.9
    axes = plot_attraction(BASIN, strip=(v, bound)).axes[0]
    beyond = [part.get_xy() for part in axes.patches if isinstance(part, Polygon) and part.get_fill()]
    assert sorted(np.sign(xy[0] @ v) for xy in beyond) == [-1, 1]
    for corners in beyond:
        assert np.all(np.abs(corners @ v) >= bound - 1e-12)
        assert np.min(np.abs(corners @ v)) == pytest.approx(bound)
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    assert left == pytest.approx(-4, abs=0.4) and right < 2.5 and low > -1.3 and high < 1.3
    assert legend(plot_attraction(BASIN, strip=(v, 99.0)))[-1].endswith("outside this picture")


def test_nothing_to_draw_and_other_dimensions_are_refused():
    with pytest.raises(InvalidInputError, match="nothing to draw"):
        plot_attraction()
    with pytest.raises(InvalidInputError, match="'ball' has 3 states"):
        plot_attraction(ellipsoids={"ball": Ellipsoid(np.eye(3))})
    with pytest.raises(InvalidInputError, match="the strip has 3 states"):
        plot_attraction(BASIN, strip=([1.0, 0.0, 0.0], 1.0))
    with pytest.raises(DimensionError, match=r"\(2, 5\) and \(4,\)"):
        plot_attraction(simulated=(np.zeros((2, 5)), np.zeros(4)))


@pytest.fixture(scope="module")
def certificate() -> Any:
    return certify(PLANT, LAW, Regional(BOX, Box([-1.0], [1.0]), np.eye(2), [[0.05]], 0.98)).require()


def test_the_surface_is_the_cost_of_motions(certificate: Any):
    figure = plot_cost(certificate)
    surface = max(figure.axes[0].collections, key=lambda part: part.get_zorder())
    made = mesh(BOX, TRIANGLES)
    cost = simulate(PLANT, LAW, made.nodes.T, steps=200).cost(np.eye(2), [[0.05]], 0.98)
    assert np.asarray(surface.get_array()) == pytest.approx(cost[made.triangles].mean(axis=1), rel=1e-8)  # one a triangle
    low, high = figure.axes[0].get_zlim()
    assert low < 0 and certificate.worst[0] <= high < 1.1 * certificate.worst[0]
    assert np.all(np.abs(figure.axes[0].xy_dataLim.get_points()) <= 0.8 + 1e-12)


def test_the_title_of_the_surface_never_says_less_than_the_largest_cost(certificate: Any):
    figure = plot_cost(certificate)
    assert f"at most {at_most(certificate.worst_bound)} (star)" in figure.get_suptitle()
    bar = figure.axes[1]
    assert bar.get_ylabel() == "discounted cost from $x_0$" and bar.get_ylim()[1] == pytest.approx(certificate.worst[0])


def test_without_a_certificate_there_is_no_surface():
    wide = Regional(Box([-3, -3], [3, 3]), Box([-1.0], [1.0]), np.eye(2), [[0.05]], 0.98)
    timid = certify_region(PLANT, LAW, wide, Budget(pieces=50))
    with pytest.raises(InvalidInputError, match="does not hold"):
        plot_cost(timid)
    one = certify(Plant(1.5, 1.0), INC.saturated([[-1.5]], 1.0), Regional(Box(-1, 1), Box(-1, 1), 1.0, 0.0, 0.9))
    with pytest.raises(InvalidInputError, match="1 states"):
        plot_cost(one)
