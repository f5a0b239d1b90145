"""Pictures of laws: every region is drawn where it is, in the colour of its law."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.path import Path

from inc_casadi import INC, Box, Plant
from inc_casadi.errors import InvalidInputError
from inc_casadi.mpc import MPC
from inc_casadi.pieces.difference import largest_difference
from inc_casadi.pieces.regions import Regions, regions
from inc_casadi.plotting import plot_difference, plot_regions
from inc_casadi.plotting.difference_figure import pieces_of
from inc_casadi.plotting.regions_figure import mean_inputs, outlines

PLANT = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
CLIPPED = INC.saturated([[-1.3749, -2.6490]], 1.0)
BOX = Box([-0.8, -0.8], [0.8, 0.8])


def network(q: int, m: int, n: int, seed: int) -> INC:
    """A random controller whose hidden units read each other."""
    rng = np.random.default_rng(seed)
    return INC(0.15 * rng.normal(size=(q, q)), rng.normal(size=(q, n)), rng.normal(size=(m, q)), np.zeros((m, n)),
               b=rng.normal(size=q))


def polygons(axes: Any) -> PolyCollection:
    [found] = [part for part in axes.collections if isinstance(part, PolyCollection)]
    return found


def legend(figure: Figure) -> dict[str, Any]:
    [found] = figure.legends
    return {text.get_text(): handle for text, handle in zip(found.get_texts(), found.legend_handles, strict=True)}


@pytest.fixture(scope="module")
def few() -> Regions:
    return regions(PLANT, CLIPPED, BOX)


@pytest.fixture(scope="module")
def many() -> Regions:
    return regions(PLANT, network(10, 1, 2, 3), Box([-2.0, -2.0], [2.0, 2.0]))


def test_regions_fill_the_box_and_each_is_its_own(many: Regions):
    shapes = outlines(many)
    for shape, volume in zip(shapes, many.volumes, strict=True):
        x, y = shape.T
        assert 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) == pytest.approx(volume, rel=1e-6)
    assert many.volumes.sum() == pytest.approx(16.0) and len(many) > 20


def test_the_legend_states_the_law_that_acts_where_its_colour_is(few: Regions):
    figure = plot_regions(few)
    colours = {name: handle.get_facecolor() for name, handle in legend(figure).items()}
    shown = polygons(figure.axes[0])
    assert len(colours) == len(shown.get_paths()) == 3
    for path, face in zip(shown.get_paths(), shown.get_facecolors(), strict=True):
        free = float(np.array([-1.3749, -2.6490]) @ path.vertices[:-1].mean(axis=0))
        name = "$u$$ = 1$" if free > 1 else "$u$$ = -1$" if free < -1 else r"$u$$ = -1.37\,x_{1} - 2.65\,x_{2}$"
        assert np.allclose(face, colours[name])


def test_regions_of_one_law_share_its_colour():
    plant = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
    redundant = INC(np.zeros((2, 2)), [[1.0, 0.0], [-1.0, 0.0]], [[1.0, -1.0]], [[0.0, 0.5]])  # relu(x) - relu(-x) = x
    found = regions(plant, redundant, BOX)
    figure = plot_regions(found)
    assert len(found) == 2 and list(legend(figure)) == [r"$u$$ = 1\,x_{1} + 0.5\,x_{2}$"]
    assert figure.axes[0].get_title() == "The law in 2 regions, 1 affine law, exact"


def test_many_laws_are_shaded_by_their_mean_input(many: Regions):
    figure = plot_regions(many)
    shown, law = polygons(figure.axes[0]), network(10, 1, 2, 3)
    rng = np.random.default_rng(0)
    for path, value, volume in zip(shown.get_paths(), shown.get_array(), many.volumes, strict=True):
        if volume > 0.3:
            x = rng.uniform(-2, 2, (20_000, 2))
            inside = x[Path(path.vertices).contains_points(x)]
            spread = law(inside.T).std() / np.sqrt(len(inside))
            assert value == pytest.approx(law(inside.T).mean(), abs=5 * spread + 1e-9)


def test_a_law_in_two_places_has_one_mean():
    corners = np.array([[[0.0], [1.0]], [[3.0], [5.0]], [[1.0], [3.0]]])
    made = Regions(np.zeros((3, 1), int), np.array([[[2.0]], [[2.0]], [[0.0]]]), np.array([[1.0], [1.0], [7.0]]),
                   np.array([1.0, 2.0, 2.0]), 0.0, corners, np.arange(3), 0.0)
    G, g, of = made.distinct_laws()
    assert mean_inputs(made, G, g, of)[:, 0] == pytest.approx([2 * (0.5 + 2 * 4) / 3 + 1, 7.0])


def test_two_inputs_have_a_panel_each():
    found = regions(Plant(np.eye(2), np.eye(2)), network(6, 2, 2, 5), Box([-2.0, -2.0], [2.0, 2.0]))
    figure = plot_regions(found)
    names = [axes.get_ylabel() for axes in figure.axes if axes.get_label() == "<colorbar>"]
    assert names == ["mean input $u_{1}$ under each law", "mean input $u_{2}$ under each law"]
    first, second = (polygons(axes).get_array() for axes in figure.axes[:2])
    assert len(first) == len(found) and not np.allclose(first, second)


def test_one_state_shows_the_law_itself():
    law = network(5, 2, 1, 8)
    figure = plot_regions(regions(Plant(1.2, [[1.0, 2.0]]), law, Box(-2, 2)))
    lines = figure.axes[0].lines
    for k in range(2):
        mine = [line for line in lines if line.get_color() == legend(figure)[f"$u_{{{k + 1}}}$"].get_color()]
        x, u = np.concatenate([np.stack(line.get_data()) for line in mine], axis=1)
        assert u == pytest.approx(law(x[None])[k]) and x.min() == -2 and x.max() == 2


def test_three_states_are_refused_and_an_unfinished_search_says_so():
    found = regions(Plant(np.eye(3), np.ones((3, 1))), network(3, 1, 3, 1), Box([-1.0] * 3, [1.0] * 3))
    with pytest.raises(InvalidInputError, match="3 states"):
        plot_regions(found)
    none = regions(PLANT, network(10, 1, 2, 3), Box([-2.0, -2.0], [2.0, 2.0]), pieces=12)
    with pytest.raises(InvalidInputError, match="more than 12 simplices ended the search"):
        plot_regions(none)
    part = regions(PLANT, network(10, 1, 2, 3), Box([-2.0, -2.0], [2.0, 2.0]), pieces=100)
    assert 0 < len(part) < 50 and part.ended
    assert "more than 100 simplices ended the search" in words(plot_regions(part))


def words(figure: Figure) -> str:
    return " ".join([figure.get_suptitle(), *(axes.get_title() for axes in figure.axes)])


@pytest.fixture(scope="module")
def compared() -> Any:
    return largest_difference(CLIPPED, MPC(PLANT, np.eye(2), [[0.05]], 4, Box([-1.0], [1.0])), Box([-1.5] * 2, [1.5] * 2))


def test_the_difference_drawn_is_that_of_the_laws(compared: Any):
    x, first, second = pieces_of(compared)
    points = x.reshape(-1, 2)
    assert first.ravel() == pytest.approx(CLIPPED(points.T)[0])
    some = np.random.default_rng(1).choice(len(points), 20)
    exact = [compared.second.solve(point)[0, 0] for point in points[some]]
    assert second.ravel()[some] == pytest.approx(exact, abs=1e-4)  # the solver's accuracy
    areas = 0.5 * np.abs(np.linalg.det(x[:, 1:] - x[:, :1]))
    assert areas.sum() == pytest.approx(9.0)


def test_the_star_stands_at_the_largest_difference(compared: Any):
    figure = plot_difference(compared)
    [star] = [line for line in figure.axes[0].lines if line.get_marker() == "*"]
    at = np.concatenate(star.get_data())
    assert at == pytest.approx(compared.point)
    gap = CLIPPED(at[:, None])[0, 0] - compared.second.solve(at)[0, 0]
    assert abs(gap) == pytest.approx(compared.value, abs=1e-4) and "0.0127096" in figure.axes[0].get_title()
    bar = figure.axes[1]
    assert bar.get_ylim() == pytest.approx((-compared.value, compared.value), rel=1e-6)


def test_the_bands_cover_every_point_and_lie_where_their_values_are(compared: Any):
    figure = plot_difference(compared)
    [bands] = [part for part in figure.axes[0].collections if getattr(part, "filled", False)]
    points = Box([-1.5] * 2, [1.5] * 2).sample(300, np.random.default_rng(3)).T
    gap = CLIPPED(points.T)[0] - np.array([compared.second.solve(x)[0, 0] for x in points])
    held = np.array([path.contains_points(points) for path in bands.get_paths()])
    assert np.all(held.any(axis=0))
    width = np.diff(bands.levels)[0]
    for band, low in enumerate(bands.levels[:-1]):
        assert np.all(gap[held[band]] >= low - 0.01 * width) and np.all(gap[held[band]] <= low + 1.01 * width)


def test_lines_lie_on_their_level_and_are_dashed_where_it_is_negative(compared: Any):
    [lines] = [part for part in plot_difference(compared).axes[0].collections if getattr(part, "filled", True) is False]
    assert lines.levels == pytest.approx(compared.value * np.array([-0.75, -0.5, -0.25, 0.25, 0.5, 0.75]))
    for level, path, (_, dashes) in zip(lines.levels, lines.get_paths(), lines.get_linestyle(), strict=True):
        assert (dashes is not None) == (level < 0)
        for x in path.vertices[::40]:
            assert CLIPPED(x[:, None])[0, 0] - compared.second.solve(x)[0, 0] == pytest.approx(level, abs=1e-4)


def test_the_difference_of_one_state_is_drawn_as_lines():
    found = largest_difference(INC.linear([[2.0]]), INC.saturated([[2.0]], 1.0), Box([-1.0], [0.75]))
    first, second, gap, star = plot_difference(found).axes[0].lines
    x = first.get_xdata()
    assert first.get_ydata() == pytest.approx(2 * x) and second.get_ydata() == pytest.approx(np.clip(2 * x, -1, 1))
    assert gap.get_ydata() == pytest.approx(2 * x - np.clip(2 * x, -1, 1))
    assert [float(v[0]) for v in star.get_data()] == [-1.0, -1.0]
    with pytest.raises(InvalidInputError, match="3 states"):
        plot_difference(largest_difference(network(2, 1, 3, 1), network(2, 1, 3, 2), Box([-1.0] * 3, [1.0] * 3)))
