"""The picture of laws on a plant of two states: motions, inputs, means over the grid, bars and lines of costs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from inc_casadi import INC, Box, Ellipsoid, Plant, Spec
from inc_casadi.errors import InvalidInputError
from inc_casadi.plotting import plot_bounds, plot_two_states
from inc_casadi.plotting.cost_panel import ABOUT, AT_LEAST, AT_MOST, FOUND, Row
from inc_casadi.plotting.style import LIMIT
from inc_casadi.plotting.two_state_figure import grid_of

A, B = np.array([[1.1, 1.0], [0.0, 1.02]]), np.array([[0.2], [0.5]])
K, F = np.array([[-1.3749, -2.6490]]), np.array([[-0.3535, -0.8965]])
PLANT = Plant(A, B)
SPEC = Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.6], [0.8, 0.6]), Box(-1, 1.5))
LAWS = {"clipped": INC.linear(K).with_saturated_output(Box(-1, 1.5)), "gain": INC.linear(F)}
ROWS = [Row("clipped", 1.3650, AT_MOST), Row("linear", 2.1167, AT_LEAST), Row("gain", 3.3472, FOUND),
        Row("any", 1.3647, AT_LEAST), Row("tried", 2.5, ABOUT, 0.2)]


def followed(law: Any, x: np.ndarray, steps: int) -> np.ndarray:
    """The motion of x+ = A x + B u step by step, (n, N, steps + 1)."""
    out = [x]
    for _ in range(steps):
        out.append(A @ out[-1] + B @ law(out[-1]))
    return np.stack(out, axis=-1)


def clipped(x: np.ndarray) -> np.ndarray:
    return np.clip(K @ x, -1, 1.5)


@pytest.fixture(scope="module")
def figure() -> Figure:
    return plot_two_states(PLANT, SPEC, LAWS, ROWS, [0.8, 0.5], steps=9, grid=5)


def named(axes: Any, name: str) -> Any:
    [found] = [line for line in axes.lines if line.get_label() == name]
    return found


@pytest.mark.parametrize(("name", "law"), [("clipped", clipped), ("gain", lambda x: F @ x)])
def test_the_motion_is_that_of_the_loop(figure: Figure, name: str, law: Any):
    motion = followed(law, np.array([[0.8], [0.5]]), 9)[:, 0]
    assert np.array(named(figure.axes[0], name).get_data()) == pytest.approx(motion)


def test_inputs_are_held_and_the_limits_are_drawn(figure: Figure):
    axes = figure.axes[1]
    assert {float(line.get_ydata()[0]) for line in axes.lines if line.get_color() == LIMIT} == {-1.0, 1.5}
    bands = sorted((part.get_y(), part.get_y() + part.get_height()) for part in axes.patches if part.get_hatch())
    assert (bands[0][1], bands[1][0]) == (-1.0, 1.5)
    [first, second] = [line for line in axes.lines if line.get_drawstyle() == "steps-post"]
    motion = followed(clipped, np.array([[0.8], [0.5]]), 9)
    assert first.get_ydata() == pytest.approx(clipped(motion[:, 0])[0])
    assert second.get_ydata()[0] == pytest.approx(float((F @ [0.8, 0.5])[0]))


@pytest.mark.parametrize(("name", "law"), [("clipped", clipped), ("gain", lambda x: F @ x)])
def test_the_mean_norm_is_over_a_grid_with_its_corners(figure: Figure, name: str, law: Any):
    grid = np.array([[x, y] for x in (-0.8, -0.4, 0, 0.4, 0.8) for y in (-0.6, -0.3, 0, 0.3, 0.6)]).T
    mean = np.sqrt((followed(law, grid, 9) ** 2).sum(axis=0)).mean(axis=0)
    assert named(figure.axes[2], name).get_ydata() == pytest.approx(mean)


def test_bars_end_at_costs_and_lines_stand_at_bounds(figure: Figure):
    axes = figure.axes[3]
    assert [bar.get_x() + bar.get_width() for bar in axes.patches] == pytest.approx([1.3650, 3.3472, 2.5])
    assert [bar.get_hatch() for bar in axes.patches] == [None, "////", "////"]
    ends = [tuple(line.get_xdata()) for line in axes.lines]
    assert (2.1167, 2.1167) in ends and (1.3647, 1.3647) in ends
    assert all(max(line.get_ydata()) >= 2.5 for line in axes.lines if line.get_xdata()[0] in (2.1167, 1.3647))  # all 3 bars
    assert {text.get_text() for text in axes.texts} == {"linear: at least 2.1167", "any: at least 1.3647"}
    assert [label.get_text().split("\n")[0] for label in axes.get_yticklabels()] == ["clipped", "gain", "tried"]


def test_lines_cross_every_bar_and_names_do_not_cross_lines_to_their_right():
    axes = plot_bounds(ROWS).axes[0]
    heights = {text.xy[0]: text.xy[1] for text in axes.texts}
    assert heights[1.3647] < heights[2.1167] < -0.5  # the axis points down: the smaller bound is named higher up
    low, high = sorted(axes.get_ylim())
    assert low < heights[1.3647] and high == pytest.approx(2.5)


def test_figures_of_different_sizes_get_a_logarithmic_axis_and_negative_ones_are_seen():
    far = plot_bounds([Row("small", 0.01, AT_LEAST), Row("large", 10.0, AT_MOST)]).axes[0]
    assert far.patches[0].get_x() + far.patches[0].get_width() == pytest.approx(10.0)
    assert far.get_xscale() == "log" and far.get_xlim()[0] < 0.01
    assert plot_bounds([Row("low", -2.0, AT_LEAST), Row("up", 1.0, AT_MOST)]).axes[0].get_xlim()[0] < -2.0


def test_a_bound_is_named_by_a_figure_rounded_down():
    [text] = plot_bounds([Row("linear", 2.11676399, AT_LEAST)]).axes[0].texts
    assert text.get_text() == "linear: at least 2.116763"


def test_infinite_costs_and_nothing_at_all_are_no_trouble():
    axes = plot_bounds([Row("lost", np.inf, FOUND), Row("kept", 1.0, AT_MOST)], "Title").axes[0]
    assert len(axes.patches) == 1 and axes.get_title() == "Title"
    assert "no cost is known" in plot_bounds([]).axes[0].texts[0].get_text()


def test_grid_has_its_corners():
    grid = grid_of(Box([-1, 0, 2], [1, 4, 3]), 3)
    assert grid.shape == (3, 27) and grid.min(axis=1).tolist() == [-1, 0, 2] and grid.max(axis=1).tolist() == [1, 4, 3]


def test_it_is_written_where_asked(tmp_path):
    plot_two_states(PLANT, SPEC, LAWS, ROWS, [0.8, 0.5], tmp_path / "two.png", steps=3, grid=3)
    assert (tmp_path / "two.png").stat().st_size > 20_000


@pytest.mark.parametrize(("plant", "spec", "laws", "words"), [
    (Plant(1.5, 1.0), Spec(1.0, 0.0, 1.0, Box(-1, 1), Box(-1, 1)), {"a": INC.linear([[-1.0]])}, "1 states"),
    (PLANT, Spec(np.eye(2), 0.05, 1.0, Ellipsoid(np.eye(2)), Box(-1, 1)), LAWS, "Ellipsoid"),
    (Plant(A, B, dt=0.0), SPEC, LAWS, "discrete"),
    (PLANT, SPEC, {}, "0 laws"),
    (PLANT, SPEC, {str(i): LAWS["gain"] for i in range(5)}, "5 laws"),
])
def test_what_cannot_be_drawn_is_refused(plant: Plant, spec: Spec, laws: dict[str, INC], words: str):
    with pytest.raises(InvalidInputError, match=words):
        plot_two_states(plant, spec, laws, ROWS, [0.8, 0.5])
