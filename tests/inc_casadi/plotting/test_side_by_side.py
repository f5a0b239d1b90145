"""Motions of several laws in the same axes: lines are the trajectories, what the limits exclude is hatched."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Rectangle

from inc_casadi import INC, Box, Plant, Polytope, simulate
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.plotting import plot_trajectories
from inc_casadi.simulate import Trajectory

PLANT = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
CLIPPED, FREE = INC.saturated([[-1.3749, -2.6490]], 1.0), INC.linear([[-1.3749, -2.6490]])
LIMITS = Box([-1.0], [1.5])


def run(law: INC = CLIPPED, start: Any = (0.8, 0.7), plant: Plant = PLANT, steps: int = 20) -> Trajectory:
    return simulate(plant, law, start, steps=steps)


def lines(axes: Any) -> list[Any]:
    return [line for line in axes.lines if len(line.get_xdata()) > 2]


def bands(axes: Any) -> list[tuple[float, float]]:
    """Lower and upper edge of each hatched band."""
    found = [part for part in axes.patches if isinstance(part, Rectangle) and part.get_hatch()]
    return sorted((part.get_y(), part.get_y() + part.get_height()) for part in found)


@pytest.fixture(scope="module")
def figure() -> Any:
    two = run(CLIPPED, [[0.8, 0.1], [0.7, -0.5]])
    return plot_trajectories({"clipped": run(), "free": run(FREE), "from two": two}, LIMITS)


def test_lines_are_the_trajectories(figure: Any):
    first, second, inputs = figure.axes
    for axes, values in ((first, run().x[0]), (second, run().x[1]), (inputs, run().u[0])):
        assert len(lines(axes)) == 4  # the last law has two motions
        assert lines(axes)[0].get_ydata() == pytest.approx(values) and list(lines(axes)[0].get_xdata()) == list(range(21))
    assert lines(inputs)[1].get_ydata() == pytest.approx(run(FREE).u[0])
    assert {line.get_drawstyle() for line in lines(inputs)} == {"steps-post"}
    assert {line.get_drawstyle() for line in lines(first)} == {"default"}


def test_each_law_has_three_signs_of_its_own_and_a_name(figure: Any):
    [legend] = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["clipped", "free", "from two"]
    looks = [(line.get_color(), str(line.get_linestyle()), line.get_marker()) for line in lines(figure.axes[0])]
    assert looks[2] == looks[3] and all(len({look[k] for look in looks}) == 3 for k in range(3))
    handles = [(h.get_color(), str(h.get_linestyle()), h.get_marker()) for h in legend.legend_handles]
    assert handles == looks[:3]


def test_what_lies_beyond_the_limits_is_hatched_up_to_the_edges(figure: Any):
    axes = figure.axes[2]
    (bottom, low), (high, top) = bands(axes)
    assert (low, high) == (-1.0, 1.5) and (bottom, top) == pytest.approx(axes.get_ylim())
    assert bottom < run(FREE).u.min() < -1.0  # a law that breaks them is seen to
    assert [text.get_text() for text in axes.texts] == ["limit $-1$", "limit $1.5$"] and not bands(figure.axes[0])


def test_one_trajectory_has_the_same_bands_and_different_limits_of_inputs_have_none():
    assert [edge for pair in bands(plot_trajectories(run(), LIMITS).axes[1]) for edge in pair][1:3] == [-1.0, 1.5]
    plant = Plant(0.9 * np.eye(3), np.eye(3, 2))
    motion = simulate(plant, INC.linear(-0.1 * np.eye(2, 3)), np.ones(3), steps=8)
    assert not bands(plot_trajectories(motion, Box([-1, -2], [1, 2])).axes[1])
    assert len(bands(plot_trajectories(motion, Box([-1, -1], [1, 1])).axes[1])) == 2


def test_two_inputs_have_a_panel_with_their_own_limits_each():
    plant = Plant(0.9 * np.eye(3), np.eye(3, 2))
    motion = simulate(plant, INC.linear(-0.1 * np.eye(2, 3)), np.ones(3), steps=8)
    wedge = Polytope([[1, 1], [-1, 0], [0, -1]], [1, 0.8, 0.6])
    panels = plot_trajectories({"law": motion}, wedge).axes
    assert [axes.get_ylabel() for axes in panels if axes.axison] == [
        "state $x_{1}$", "state $x_{2}$", "state $x_{3}$", "input $u_{1}$", "input $u_{2}$"]
    for axes, low, high in ((panels[3], -0.8, 1.6), (panels[4], -0.6, 1.8)):
        (_, below), (above, _) = bands(axes)
        assert (below, above) == pytest.approx((low, high))


def test_of_many_states_the_norm_is_drawn_and_one_state_needs_no_number():
    wide = simulate(Plant(0.5 * np.eye(6), np.ones((6, 1))), INC.linear(np.zeros((1, 6))), np.ones(6), steps=5)
    axes = plot_trajectories({"law": wide}).axes[0]
    assert axes.get_ylabel() == r"norm of the state $\|x\|$"
    assert axes.lines[0].get_ydata() == pytest.approx(np.sqrt(6) * 0.5 ** np.arange(6))
    one = simulate(Plant(0.5, 1.0), INC.linear([[0.0]]), [1.0], steps=5)
    assert [axes.get_ylabel() for axes in plot_trajectories({"law": one}).axes] == ["state $x$", "input $u$"]


def test_continuous_laws_share_a_time_in_seconds():
    plant = Plant([[0, 1], [2, -0.3]], [[0], [1]], dt=0)
    smooth = simulate(plant, INC.saturated([[-4.0, -2.0]], 1.0), [0.2, 0.1], duration=4.0)
    held = run(INC.saturated([[-4.0, -2.0]], 1.0), (0.2, 0.1), plant.sampled(0.1), 40)
    panels = plot_trajectories({"smooth": smooth, "sampled": held}).axes
    assert panels[-1].get_xlabel() == "time $t$ in s"
    assert [line.get_drawstyle() for line in panels[-1].lines] == ["default", "steps-post"]


def test_what_cannot_be_drawn_together_is_refused():
    with pytest.raises(InvalidInputError, match="no law is given"):
        plot_trajectories({})
    with pytest.raises(DimensionError, match="'one' has 1 states and 1 inputs, but the first law has 2 and 1"):
        plot_trajectories({"two": run(), "one": simulate(Plant(0.5, 1.0), INC.linear([[0.0]]), [1.0], steps=5)})
    sampled = run(plant=Plant(PLANT.A, PLANT.B, dt=0.1))
    with pytest.raises(InvalidInputError, match=r"'b' counts time \$t\$ in s, but the first law counts step"):
        plot_trajectories({"a": run(), "b": sampled})
    with pytest.raises(DimensionError, match="inputs lies in R\\^2, but there are 1 inputs"):
        plot_trajectories(run(), Box([-1, -1], [1, 1]))
    with pytest.raises(InvalidInputError, match="'x' is a list"):
        plot_trajectories({"x": [1.0]})  # type: ignore[dict-item]
    with pytest.raises(InvalidInputError, match=r"\(2, 0, 4\): there is no motion"):
        plot_trajectories(replace(run(), x=np.zeros((2, 0, 4))))
