"""Figures of results and motions: what they show is true, and they are made without a warning in every case."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import PolyCollection

from inc_casadi import (
    INC,
    Box,
    DiscountedCost,
    Ellipsoid,
    Empirical,
    Gaussian,
    Plant,
    Polytope,
    Regional,
    Spec,
    Tanh,
    certify,
    simulate,
)
from inc_casadi.plotting import plot_result, plot_trajectories
from inc_casadi.plotting.cost_panel import ABOUT, AT_LEAST, AT_MOST, FOUND, Row, rounded, rows_of
from inc_casadi.plotting.motions import motions, starting_points
from inc_casadi.plotting.plane_panels import ellipse, lattice
from inc_casadi.plotting.result_figure import headline
from inc_casadi.plotting.style import formula

GAIN = [[-1.3749, -2.6490]]


@dataclass(frozen=True)
class Shown:
    """What a figure reads of a result."""

    plant: Plant
    spec: Spec
    inc: INC | None
    certificate: Any = None
    estimate: Any = None
    bounds: dict = field(default_factory=dict)
    linear: dict = field(default_factory=dict)

    @property
    def status(self) -> str:
        if self.certificate is not None:
            return "certified"
        return "failed" if self.inc is None else "simulation evidence"

    @property
    def cost(self) -> float:
        return self.certificate.bound if self.certificate is not None else np.inf


def a_bound(value: float, holds: bool = True) -> Any:
    class Stub:
        def __float__(self) -> float:
            return value

        def holds(self) -> bool:
            return holds

    return Stub()


def sampled(mean: float, error: float) -> Any:
    return SimpleNamespace(mean=mean, standard_error=error)


def regional(plant: Plant, spec: Spec, inc: INC) -> Shown:
    claim = Regional(spec.initial, spec.inputs, spec.Q, spec.R, spec.discount)
    certificate = certify(plant, inc, claim).require()
    bounds = {"linear controllers": a_bound(2.11676), "any controller": a_bound(1.36392)}
    return Shown(plant, spec, inc, certificate, sampled(1.3579, 0.0036), bounds, {"static gain": 3.3472})


@pytest.fixture(scope="module")
def two_state() -> Shown:
    plant = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
    spec = Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box(-1, 1))
    return regional(plant, spec, INC.saturated(GAIN, 1.0))


@pytest.fixture(scope="module")
def panels(two_state: Shown) -> list[Any]:
    return plot_result(two_state).axes


def texts(axes: Any) -> list[str]:
    return [text.get_text() for text in axes.texts]


def legend(axes: Any) -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]


def dashed_levels(axes: Any) -> set[float]:
    return {round(float(line.get_ydata()[0]), 9) for line in axes.lines if line.get_linestyle() == "--"}


def test_the_pieces_drawn_fill_the_initial_set(panels: list[Any]):
    plane = panels[0]
    [pieces] = [part for part in plane.collections if isinstance(part, PolyCollection)]
    corners = np.array([path.vertices[:3] for path in pieces.get_paths()])
    edges = corners[:, 1:] - corners[:, :1]
    assert 0.5 * np.abs(np.linalg.det(edges)).sum() == pytest.approx(1.6**2)
    assert f"in {len(corners)} pieces" in plane.get_title()


def test_each_piece_has_the_colour_of_the_law_that_acts_on_it(two_state: Shown, panels: list[Any]):
    plane = panels[0]
    [pieces] = [part for part in plane.collections if isinstance(part, PolyCollection)]
    centers = np.array([path.vertices[:3].mean(axis=0) for path in pieces.get_paths()])
    colours = dict(zip(legend(plane), (h.get_facecolor() for h in plane.get_legend().get_patches()), strict=False))
    u = two_state.inc(centers.T)[0]
    clipped = np.array(GAIN) @ centers.T
    for x, value, drawn, face in zip(centers, u, clipped[0], pieces.get_facecolors(), strict=True):
        name = "$u$$ = 1$" if drawn > 1 else "$u$$ = -1$" if drawn < -1 else r"$u$$ = -1.37\,x_{1} - 2.65\,x_{2}$"
        assert np.allclose(face, colours[name]), (x, value)


def test_limits_are_drawn_where_they_are_and_labelled(panels: list[Any]):
    inputs = panels[1]
    assert dashed_levels(inputs) == {-1.0, 1.0}
    assert texts(inputs) == ["limit $-1$", "limit $1$"]
    assert max(float(np.max(line.get_ydata())) for line in inputs.lines) <= 1.0


def test_the_title_says_the_status_and_never_less_than_the_certified_cost(two_state: Shown, panels: list[Any]):
    title = panels[0].figure.get_suptitle()
    assert title.startswith("certified: expected cost at most ")
    assert two_state.cost <= float(title.split()[-1]) < two_state.cost + 1e-5


def test_the_cost_surface_integrates_to_the_certified_cost(two_state: Shown):
    done = two_state.certificate.walk.done
    triangles, cost = lattice(done.start, done.cost)
    corners = np.stack([triangles.x, triangles.y], axis=1)[triangles.triangles]
    areas = 0.5 * np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    assert areas.sum() == pytest.approx(1.6**2)
    assert areas @ cost[triangles.triangles].mean(axis=1) / areas.sum() == pytest.approx(two_state.cost, rel=0.02)


def test_the_cost_surface_is_the_cost_of_simulated_motions(two_state: Shown):
    done = two_state.certificate.walk.done
    triangles, cost = lattice(done.start, done.cost)
    some = np.random.default_rng(0).choice(cost.size, 40)
    run = simulate(two_state.plant, two_state.inc, np.stack([triangles.x, triangles.y])[:, some], steps=200)
    assert cost[some] == pytest.approx(run.cost(np.eye(2), [[0.05]], 0.98), rel=1e-8)


def test_the_costliest_motion_is_drawn_strong(two_state: Shown):
    shown = motions(two_state)
    costs = shown.run.cost(np.eye(2), [[0.05]], 0.98)
    assert shown.worst == np.argmax(np.round(costs, 9)) and shown.marked == "costliest start"
    unproved = replace(two_state, certificate=None)
    assert motions(unproved).marked == "costliest start shown"


def test_motions_end_where_nothing_moves_any_more(two_state: Shown):
    run = motions(two_state).run
    assert np.max(np.abs(run.x[..., -1])) <= 0.02 * 0.8
    assert run.t.size < 30


def test_the_chart_lists_bounds_that_hold_and_finite_costs_only(two_state: Shown):
    bounds = {"good": a_bound(1.0), "wrong": a_bound(9.0, holds=False), "minus infinity": a_bound(-np.inf)}
    rows = rows_of(replace(two_state, bounds=bounds, linear={"unstable": np.inf, "gain": 3.0}))
    assert [(row.name, row.kind) for row in rows] == [
        ("good", AT_LEAST), ("this controller, certified", AT_MOST), ("this controller, simulated", ABOUT),
        ("gain, found", FOUND)]
    assert rows[2].error == pytest.approx(0.0072)


def test_the_chart_writes_every_figure(panels: list[Any]):
    labels = [label.get_text() for label in panels[2].get_yticklabels()]
    assert [label.split("\n")[1] for label in labels] == [
        "at least 2.11676", "at least 1.36392", "at most 1.364962", "about 1.3579 ± 0.0072", "3.3472"]


def test_rounding_keeps_bounds_true():
    for value in np.random.default_rng(5).lognormal(0, 8, 200):
        assert float(rounded(value, AT_LEAST)) <= value <= float(rounded(value, AT_MOST))
    assert rounded(2.5e-300, AT_MOST) != "0" and rounded(0.0, AT_LEAST) == "0"
    assert Row("J", 1.23456789, FOUND).label == "J\n1.234568"


def three_states() -> Shown:
    plant = Plant([[1.02, 0.1, 0], [0, 1, 0.1], [0, -0.2, 0.9]], [[0, 0.02], [0, 0.1], [0.1, 0]], dt=0.1)
    spec = Spec(np.eye(3), np.diag([0.1, 0.05]), 0.97, Box([-0.2] * 3, [0.2] * 3), Box([-1, -0.5], [1, 2]))
    return Shown(plant, spec, INC.linear([[-0.2, -0.3, -0.4], [-1.6, -1.0, -0.2]]))


def test_several_inputs_name_their_own_limits():
    figure = plot_result(three_states())
    states, inputs, costs, norm = figure.axes
    assert dashed_levels(inputs) == {-1.0, -0.5, 1.0, 2.0}
    assert sorted(texts(inputs)) == ["$u_{1}$ limit $-1$", "$u_{1}$ limit $1$", "$u_{2}$ limit $-0.5$",
                                     "$u_{2}$ limit $2$"]
    assert legend(states) == ["$x_{1}$", "$x_{2}$", "$x_{3}$"] and states.get_xlabel() == "time $t$ in s"
    assert norm.get_yscale() == "log"


def one_state() -> Shown:
    spec = Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-1, 1))
    return regional(Plant(1.5, 1.0), spec, INC.saturated([[-1.5]], 1.0))


def gaussian() -> Shown:
    plant = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
    spec = Spec(np.eye(2), 0.05, 0.98, Gaussian([0.1, 0.0], [[0.05, 0.02], [0.02, 0.06]]))
    inc = INC([[0.1]], [[0.1, 0.2]], [[0.05]], GAIN, activation=Tanh())
    certificate = certify(plant, inc, DiscountedCost(spec.Q, spec.R, spec.discount, spec.initial)).require()
    return Shown(plant, spec, inc, certificate)


def with_start(initial: Any, limits: Any = None) -> Shown:
    plant = Plant([[1.1, 0.4], [0.0, 1.05]], [[0.2, 1.0], [0.5, 0.0]])
    spec = Spec(np.eye(2), np.diag([0.1, 0.2]), 0.95, initial, limits)
    return Shown(plant, spec, INC.linear([[-0.1, -1.9], [-0.9, 0.3]]))


def many_laws() -> Shown:
    plant = Plant([[1.1, 0.4], [0.0, 1.05]], [[0.2, 1.0], [0.5, 0.0]])
    spec = Spec(np.eye(2), 0.1 * np.eye(2), 0.95, Box([-0.8, -0.8], [0.8, 0.8]), Box([-0.4, -0.5], [0.5, 0.5]))
    return regional(plant, spec, INC.linear([[-0.1, -1.9], [-0.9, 0.3]]).with_saturated_output(spec.inputs))


CASES = {
    "one state": one_state,
    "three states, two inputs": three_states,
    "Gaussian start, matrix certificate, no limits": gaussian,
    "ellipsoid, polytope of inputs": lambda: with_start(Ellipsoid(np.diag([9.0, 16.0])),
                                                         Polytope([[1, 1], [-1, 0], [0, -1]], [1, 0.8, 0.6])),
    "points on a line": lambda: with_start(Empirical(np.array([[0.1, 0.2, 0.4], [0.2, 0.4, 0.8]]))),
    "two inputs, regional, many laws": many_laws,
    "diverging": lambda: replace(three_states(), inc=INC.linear(np.zeros((2, 3)) + 0.5),
                                 estimate=sampled(np.inf, np.inf)),
    "no controller": lambda: replace(three_states(), inc=None),
    "no controller, two states": lambda: replace(with_start(Box([-1, 0], [1, 2])), inc=None,
                                                 bounds={"any": a_bound(0.0)}),
    "starting at rest": lambda: with_start(Empirical(np.zeros((2, 1)))),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", CASES)
def test_every_kind_of_result_is_drawn(name: str):
    shown = CASES[name]()
    figure = plot_result(shown)
    figure.draw_without_rendering()
    assert figure.get_suptitle().startswith(shown.status)
    assert all(axes.get_xlabel() or not axes.axison or axes.get_ylabel() for axes in figure.axes)


def test_a_figure_is_written_in_the_format_of_its_name(tmp_path: Path):
    plot_result(replace(three_states(), inc=None), tmp_path / "figure.png")
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")


def test_the_cost_of_one_state_is_a_curve_with_its_largest_value():
    cost = plot_result(one_state()).axes[3]
    assert cost.get_xlabel() == "starting point $x_0$"
    x, value = np.concatenate([np.stack(line.get_data()) for line in cost.lines], axis=1)
    exact = x**2 + 0.9 * np.maximum(1.5 * np.abs(x) - 1, 0) ** 2  # thm:longrun_dyn: the state is zero after two steps
    assert value == pytest.approx(exact, abs=1e-9)


def test_no_proof_is_never_called_certified():
    unproved = three_states()
    for run in (None, sampled(1.5, 0.1), sampled(np.inf, np.inf)):
        title = headline(replace(unproved, estimate=run))
        assert title.startswith("simulation evidence") and title.endswith("nothing is proved")
    assert headline(replace(unproved, inc=None)) == "failed: no controller"


def test_the_ellipse_lies_on_its_level():
    P, center = np.array([[2.0, 0.7], [0.7, 1.5]]), np.array([0.3, -1.0])
    offset = ellipse(center, P, 0.25) - center[:, None]
    assert np.sum(offset * (P @ offset), axis=0) == pytest.approx(0.25)


def test_starting_points_are_in_the_set_and_show_its_corners():
    box = Spec(1.0 * np.eye(2), 1.0, 1.0, Box([-1, 0], [1, 3])).initial
    points = starting_points(box)
    assert np.all(box.support.contains(points, tol=1e-12))
    assert {tuple(corner) for corner in box.vertices.T} <= {tuple(point) for point in points.T}


@pytest.mark.parametrize(("row", "constant", "words"), [
    ([1.0, -2.0], 0.0, r"1\,x_{1} - 2\,x_{2}"), ([0.0, 0.0], 0.0, "0"), ([-0.5], -3.0, r"-0.5\,x - 3"),
    ([0.0, 1e-14], 1.0, "1"),
])
def test_formula(row: list[float], constant: float, words: str):
    assert formula(np.array(row), constant) == words


def test_trajectories_of_discrete_and_continuous_plants(tmp_path: Path):
    law = INC.saturated([[-4.0, -2.0]], 1.0)
    smooth = simulate(Plant([[0, 1], [2, -0.3]], [[0], [1]], dt=0), law, np.array([[0.2, 0.1], [0, 0.3]]), duration=4.0)
    sampled_run = simulate(Plant([[0, 1], [2, -0.3]], [[0], [1]], dt=0).sampled(0.1), law, [0.2, 0.1], steps=30)
    first = plot_trajectories(smooth, Box(-1, 1), tmp_path / "smooth.pdf")
    second = plot_trajectories(sampled_run)
    assert (tmp_path / "smooth.pdf").read_bytes().startswith(b"%PDF")
    assert first.axes[1].get_xlabel() == second.axes[1].get_xlabel() == "time $t$ in s"
    assert len(first.axes[0].lines) == 4 and len(second.axes[0].lines) == 2
    assert {line.get_drawstyle() for line in second.axes[1].lines} == {"steps-post"}
    assert dashed_levels(first.axes[1]) == {-1.0, 1.0} and dashed_levels(second.axes[1]) == set()


def test_drawing_leaves_pyplot_alone():
    code = "import sys, inc_casadi.plotting; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parents[2], timeout=60).returncode == 0
