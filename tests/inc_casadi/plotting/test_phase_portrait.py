"""The phase portrait: arrows point where the loop goes, motions are those of the loop, sets stand where they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Polygon
from matplotlib.quiver import Quiver

from inc_casadi import INC, Attraction, Box, Ellipsoid, Invariance, Plant, Polytope, Regional, Stability, Tanh, certify
from inc_casadi.ellipsoid_certificate import EllipsoidCertificate
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.local.certify import certify_attraction
from inc_casadi.pieces.walk import Budget
from inc_casadi.plotting import plot_phase_portrait
from inc_casadi.plotting.paths import arrow_grid, arrows, converging, paths
from inc_casadi.plotting.phase_line import staircase
from inc_casadi.plotting.plane_slice import plane_slice
from inc_casadi.plotting.portrait_regions import regions_in
from inc_casadi.plotting.portrait_sets import window_of
from inc_casadi.regional_certificate import certify_region

PLANT = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
LAW = INC.saturated([[-1.3749, -2.6490]], 1.0)
START, AROUND = Box([-0.8, -0.6], [0.8, 0.7]), Box([-4.0, -2.5], [4.0, 2.0])
LEVEL = [[12.5, 4.05], [4.05, 7.4]]  # {x'P x <= 1} lies where LAW is not clipped, and is invariant
THREE = Plant([[1.02, 0.1, 0], [0, 1, 0.1], [0, -0.2, 0.9]], [[0, 0.02], [0, 0.1], [0.1, 0]], dt=0.1)
LAW3 = INC.linear([[-0.2, -0.3, -0.4], [-1.6, -1.0, -0.2]]).with_saturated_output(Box([-1, -0.5], [1, 0.6]))


def step(x: np.ndarray) -> np.ndarray:
    """The next state (2, N) of the two-state loop, written out."""
    u = np.clip(-1.3749 * x[0] - 2.6490 * x[1], -1, 1)
    return np.stack([1.1 * x[0] + x[1] + 0.2 * u, 1.02 * x[1] + 0.5 * u])


def words(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def field(axes: Any) -> Quiver:
    [found] = [part for part in axes.collections if isinstance(part, Quiver)]
    return found


def outlines(axes: Any) -> dict[str, np.ndarray]:
    return {part.get_label(): part.get_xy() for part in axes.patches if isinstance(part, Polygon) and part.get_label()}


def motions(axes: Any, name: str) -> list[np.ndarray]:
    return [np.stack(line.get_data()) for line in axes.lines if line.get_label().startswith(name)]


@pytest.fixture(scope="module")
def figure() -> Figure:
    starts = np.column_stack([START.vertices, [3.9, 1.9], [0.1, 0.2]])
    disc = Ellipsoid(np.diag([4.0, 9.0]))
    return plot_phase_portrait(PLANT, LAW, AROUND, initial=START, starts=starts, sets={"disc": disc})


def test_arrows_point_along_the_step(figure: Figure):
    shown = field(figure.axes[0])
    x, tip = np.stack([shown.X, shown.Y]), np.stack([shown.U, shown.V])
    cell = np.array([8.0, 4.5]) / 21
    ahead = step(x) - x
    assert x.shape == (2, 441) and np.all(np.abs(x) < [[4.0], [2.5]])
    assert ahead[0] * tip[1] == pytest.approx(ahead[1] * tip[0], abs=1e-12) and np.all(np.sum(ahead * tip, axis=0) >= 0)
    length, speed = (np.linalg.norm(v / cell[:, None], axis=0) for v in (tip, ahead))
    assert length == pytest.approx(0.9 * np.sqrt(speed / speed.max()), abs=1e-9)  # the root: slow ones are seen


def test_motions_are_those_of_the_loop(figure: Figure):
    lines = motions(figure.axes[0], "motions")
    assert len(lines) == 6
    for x in lines:
        x = x[:, np.all(np.isfinite(x), axis=0)]
        assert step(x[:, :-1]) == pytest.approx(x[:, 1:], abs=1e-9)


def test_motions_that_leave_are_told_from_those_that_come_to_rest(figure: Figure):
    axes = figure.axes[0]
    away = motions(axes, "motions not at rest")
    assert len(away) == 1 and away[0][:, 0].tolist() == [3.9, 1.9] and np.isnan(away[0][:, -1]).all()
    assert all(np.abs(x[:, -1]).max() < 0.1 for x in motions(axes, "motions that come to rest"))
    styles = {line.get_label(): (line.get_linestyle(), line.get_color()) for line in axes.lines if len(line.get_xdata()) > 2}
    assert len({dashes for dashes, _ in styles.values()}) == len(styles) == 2


def test_the_regions_are_numbered_as_in_the_legend(figure: Figure):
    axes = figure.axes[0]
    laws = {text.split(": ", 1)[0]: text.split(": ", 1)[1] for text in words(figure) if text[:1].isdigit()}
    assert sorted(laws) == ["1", "2", "3"] and len(axes.texts) == 3
    for text in axes.texts:
        free = float(np.array([-1.3749, -2.6490]) @ text.get_position())
        said = "$u$$ = 1$" if free > 1 else "$u$$ = -1$" if free < -1 else r"$u$$ = -1.37\,x_{1} - 2.65\,x_{2}$"
        assert laws[text.get_text()] == said


def test_sets_are_outlined_where_they_are_under_the_names_given(figure: Figure):
    shown = outlines(figure.axes[0])
    assert {tuple(x) for x in shown["initial set"]} == {tuple(x) for x in START.vertices.T}
    assert np.sum([[4.0], [9.0]] * shown["disc"].T ** 2, axis=0) == pytest.approx(1.0)
    assert "certified" not in " ".join(words(figure))  # nobody is certified but by a certificate
    assert words(figure)[-1] == "equilibrium"


def test_the_window_is_the_region_and_else_holds_the_sets(figure: Figure):
    assert figure.axes[0].get_xlim() == (-4.0, 4.0) and figure.axes[0].get_ylim() == (-2.5, 2.0)
    found = window_of(None, {"s": START}, np.array([[2.0], [0.0]]), (0, 1))
    assert found.lower == pytest.approx([0.6 - 1.25 * 1.4, 0.05 - 1.25 * 0.65])
    assert found.upper[0] == pytest.approx(0.6 + 1.75)


def test_the_certified_ellipsoid_is_the_certificates():
    claim = Attraction(Box([-1.0], [1.0]), directions=START.vertices)
    certificate = certify_attraction(PLANT, LAW, claim, "dead zone")
    axes = plot_phase_portrait(PLANT, LAW, AROUND, certificate=certificate, initial=START).axes[0]
    shown, shape = outlines(axes), certificate.ellipsoid
    dashes = {part.get_label(): part.get_linestyle() for part in axes.patches if isinstance(part, Polygon)}
    assert dashes == {"initial set": ":", "certified region of attraction": "-"}  # told apart without colours
    e = shown["certified region of attraction"].T - shape.center[:, None]
    assert np.sum(e * (shape.P @ e), axis=0) == pytest.approx(shape.level)


def test_regional_and_invariance_certificates_outline_the_set_they_speak_of():
    claim = Regional(START, Box([-1.0], [1.0]), np.eye(2), [[0.05]], 0.98)
    shown = outlines(plot_phase_portrait(PLANT, LAW, certificate=certify(PLANT, LAW, claim)).axes[0])
    assert {tuple(x) for x in shown["certified: motions from here converge"]} == {tuple(x) for x in START.vertices.T}
    stable, box = Plant([[0.5, 0.1], [0.0, 0.4]], [[0.1], [0.2]]), Box([-1.0, -1.0], [1.0, 1.0])
    law = INC.saturated([[0.1, 0.2]], 1.0)
    shown = outlines(plot_phase_portrait(stable, law, certificate=certify(stable, law, Invariance(box))).axes[0])
    assert set(shown) == {"certified invariant set"}


class Basin:
    """What the picture reads of a basin."""

    region = Box([-1.0, -1.0], [1.0, 1.0])

    def polytopes(self) -> list[np.ndarray]:
        return [np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), np.array([[1.0, 1.0], [1.0, 0.0], [0.0, 1.0]])]


def test_a_basin_is_outlined_as_a_union():
    figure = plot_phase_portrait(PLANT, LAW, certificate=Basin())
    shown = [part for part in figure.axes[0].get_children() if isinstance(part, PathPatch)]
    assert {tuple(x) for part in shown for x in part.get_path().vertices} == {(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)}
    assert "certified by exact pieces (in floats)" in words(figure)
    with pytest.raises(InvalidInputError, match="two states only"):
        plot_phase_portrait(PLANT, LAW, certificate=Basin(), axes=(1, 0))


def curves(axes: Any) -> list[np.ndarray]:
    """The level sets drawn, points (N, 2) of each."""
    [found] = [part for part in axes.collections if isinstance(part, QuadContourSet)]
    return [np.concatenate(path.to_polygons(closed_only=False)) for path in found.get_paths()]


def test_level_sets_of_a_global_certificate_are_those_of_its_storage_function():
    plant, law = Plant([[0.9, 0.2], [-0.1, 0.95]], [[0.0], [0.3]]), INC.saturated([[-0.2, -0.4]], 1.0)
    certificate = certify(plant, law, Stability(0.99), multiplier="sector")
    figure = plot_phase_portrait(plant, law, Box([-1, -2], [1, 2]), certificate=certificate, levels=3)
    V = [np.asarray(certificate.storage(curve.T)) for curve in curves(figure.axes[0])]
    assert len(V) == 3 and all(np.ptp(values) < 0.01 * values.mean() for values in V)
    roots = np.sqrt([values.mean() for values in V])
    assert np.allclose(np.diff(roots), roots[0], rtol=1e-2)
    assert "level sets of the storage function $V$" in words(figure)
    default = plot_phase_portrait(plant, law, Box([-1, -2], [1, 2]), certificate=certificate)
    assert len(curves(default.axes[0])) == 6


def test_level_sets_end_where_the_proof_does():
    certificate = EllipsoidCertificate(PLANT, LAW, Attraction(Box([-1.0], [1.0])), "linear", {"P": LEVEL})
    axes = plot_phase_portrait(PLANT, LAW, AROUND, certificate=certificate, levels=2).axes[0]
    V = [np.asarray(certificate.storage(curve.T)).mean() for curve in curves(axes)]
    assert V == pytest.approx([0.25, 1.0], rel=0.02)
    assert not any(isinstance(part, QuadContourSet)
                   for part in plot_phase_portrait(PLANT, LAW, AROUND, certificate=certificate).axes[0].collections)


def test_level_sets_that_cannot_be_drawn_are_refused():
    for levels in (-1, 1.5):
        with pytest.raises(InvalidInputError, match="must be a whole number"):
            plot_phase_portrait(PLANT, LAW, AROUND, levels=levels)
    with pytest.raises(InvalidInputError, match="certificate's storage function: give certificate"):
        plot_phase_portrait(PLANT, LAW, AROUND, levels=3)
    with pytest.raises(InvalidInputError, match="one state"):
        plot_phase_portrait(Plant(0.5, 1.0), INC.linear([[0.1]]), Box(-1, 1), levels=3)


def test_a_certificate_that_does_not_hold_or_is_none_is_refused():
    wide = Regional(Box([-3, -3], [3, 3]), Box([-1.0], [1.0]), np.eye(2), [[0.05]], 0.98)
    with pytest.raises(InvalidInputError, match="does not hold, so it certifies no set"):
        plot_phase_portrait(PLANT, LAW, certificate=certify_region(PLANT, LAW, wide, Budget(pieces=50)))
    with pytest.raises(InvalidInputError, match="certificate is a float"):
        plot_phase_portrait(PLANT, LAW, certificate=1.0)


def test_what_says_nothing_or_does_not_fit_is_refused():
    with pytest.raises(InvalidInputError, match="where to look"):
        plot_phase_portrait(PLANT, LAW)
    with pytest.raises(DimensionError, match="initial is on R\\^3"):
        plot_phase_portrait(PLANT, LAW, initial=Box([-1] * 3, [1] * 3))
    with pytest.raises(DimensionError, match="the ball lies in R\\^3"):
        plot_phase_portrait(PLANT, LAW, sets={"ball": Ellipsoid(np.eye(3))})
    with pytest.raises(InvalidInputError, match="the set 'x' is a list"):
        plot_phase_portrait(PLANT, LAW, sets={"x": [1.0, 2.0]})
    with pytest.raises(InvalidInputError, match="name is taken"):
        plot_phase_portrait(PLANT, LAW, initial=START, sets={"initial set": START})
    with pytest.raises(DimensionError, match="region lies in R\\^1"):
        plot_phase_portrait(PLANT, LAW, Box(-1, 1))
    with pytest.raises(InvalidInputError, match="region is a Ellipsoid"):
        plot_phase_portrait(PLANT, LAW, Ellipsoid(np.eye(2)))  # type: ignore[arg-type]
    with pytest.raises(DimensionError, match="controller maps 2"):
        plot_phase_portrait(THREE, LAW, AROUND)
    for pair in ((0, 0), (0, 3), (0, 1, 2)):
        with pytest.raises(InvalidInputError, match="two different coordinates among 0 to 2"):
            plot_phase_portrait(THREE, LAW3, AROUND, axes=pair)  # type: ignore[arg-type]


AT = np.array([0.0, 0.3, 0.0])


@pytest.fixture(scope="module")
def sliced() -> Figure:
    bodies = {"ball": Ellipsoid(2 * np.eye(3), [0.1, 0.0, 0.2]), "far": Box([2] * 3, [3] * 3)}
    return plot_phase_portrait(THREE, LAW3, Box([-1, -1.2], [1, 1.2]), initial=Box([-0.5] * 3, [0.5] * 3), axes=(2, 0),
                               at=AT, sets=bodies)


def test_the_slice_is_stated_and_its_axes_are_named(sliced: Figure):
    axes = sliced.axes[0]
    assert axes.get_title() == "Phase portrait\nslice $x_{2}$ = 0.3; motions are projected"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("state $x_{3}$", "state $x_{1}$")


def test_regions_of_a_slice_carry_the_law_of_the_slice(sliced: Figure):
    plane = plane_slice(3, (2, 0), AT)
    found = regions_in(LAW3, THREE.C, plane, Box([-1, -1.2], [1, 1.2]))
    assert found is not None and len(found) == 3
    for simplex, i in zip(found.simplices, found.which, strict=True):
        s = simplex.mean(axis=0)
        assert found.G[i] @ s + found.g[i] == pytest.approx(LAW3(np.array([s[1], 0.3, s[0]])))
    assert any(r"x_{3}" in text and r"x_{1}" in text and r"x_{2}" not in text for text in words(sliced)[:3])


def test_arrows_of_a_slice_start_in_it_and_are_projected(sliced: Figure):
    shown = field(sliced.axes[0])
    x = np.stack([shown.Y, np.full(shown.X.size, 0.3), shown.X])
    ahead = (THREE.A @ x + THREE.B @ LAW3(x) - x)[[2, 0]]
    assert ahead[0] * shown.V == pytest.approx(ahead[1] * shown.U, abs=1e-12)


def test_sets_are_cut_by_the_slice(sliced: Figure):
    shown = outlines(sliced.axes[0])
    s = shown["ball"].T
    assert 2 * ((s[1] - 0.1) ** 2 + 0.3**2 + (s[0] - 0.2) ** 2) == pytest.approx(1.0)
    assert "far: misses this slice" in words(sliced)


def test_a_polytope_is_cut_by_its_half_spaces():
    octahedron = Polytope(np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T, np.ones(8))
    corners = plane_slice(3, (0, 1), [0.0, 0.0, 0.4]).outline(octahedron)
    assert {tuple(np.round(x, 9) + 0.0) for x in corners} == {(0.6, 0.0), (-0.6, 0.0), (0.0, 0.6), (0.0, -0.6)}
    assert plane_slice(3, (0, 1), [0.0, 0.0, 1.4]).outline(octahedron) is None
    assert plane_slice(3, (0, 1), [0.0, 0.0, 1.4]).outline(Box([-1] * 3, [1] * 3)) is None
    assert plane_slice(3, (0, 1), [0.0, 0.0, 1.4]).outline(Ellipsoid(np.eye(3))) is None


def test_a_continuous_loop_shows_its_velocity_and_no_region_of_a_smooth_law():
    plant = Plant([[0, 1], [-1, -0.2]], [[0], [1]], dt=0)
    law = INC([[0.1]], [[1, 0.5]], [[-0.8]], [[0, 0]], activation=Tanh())
    figure = plot_phase_portrait(plant, law, Box([-2, -2], [2, 2]), starts=[1.0, 0.5], duration=1.0)
    axes = figure.axes[0]
    shown = field(axes)
    x = np.stack([shown.X, shown.Y])
    ahead = plant.A @ x + plant.B @ law(x)
    assert ahead[0] * shown.V == pytest.approx(ahead[1] * shown.U, abs=1e-12)
    assert not [part for part in axes.collections if type(part) is PolyCollection]
    [path] = motions(axes, "motions")
    speed = np.gradient(path, 1.0 / 200, axis=1)[:, 1:-1]
    inner = path[:, 1:-1]
    assert speed == pytest.approx(plant.A @ inner + plant.B @ law(inner), abs=1e-3)
    assert r"velocity $\dot{x}$" in words(figure)


def test_many_laws_are_counted_instead_of_named():
    rng = np.random.default_rng(3)
    net = INC(0.15 * rng.normal(size=(10, 10)), rng.normal(size=(10, 2)), rng.normal(size=(1, 10)), [[0.0, 0.0]],
              b=rng.normal(size=10))
    figure = plot_phase_portrait(PLANT, net, Box([-2, -2], [2, 2]))
    [regions] = [part for part in figure.axes[0].collections if type(part) is PolyCollection]
    assert words(figure)[0].startswith(f"{len(regions.get_paths())} regions, ") and not figure.axes[0].texts


def test_a_loop_without_equilibrium_has_no_cross_and_nothing_at_rest():
    drift = Plant([[1.0, 0.0], [0.0, 1.0]], [[1.0], [0.0]])
    law = INC(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), [[0.0, 0.0]], d=[0.1])
    figure = plot_phase_portrait(drift, law, Box([-1, -1], [1, 1]))
    assert "equilibrium" not in words(figure) and "motions that come to rest" not in words(figure)


def test_one_state_is_drawn_as_its_graph_with_staircases():
    law = INC.saturated([[-1.2]], 1.0)
    axes = plot_phase_portrait(Plant(1.5, 1.0), law, Box(-2.5, 2.5), initial=Box(-1, 1), starts=[[0.9, -2.2]]).axes[0]
    x, ahead = axes.lines[0].get_data()
    assert ahead == pytest.approx(1.5 * x - np.clip(1.2 * x, -1, 1))
    first = next(line for line in axes.lines if line.get_xdata()[0] == 0.9 and len(line.get_xdata()) > 2)
    corner, height = first.get_data()
    assert corner[:4] == pytest.approx([0.9, 0.9, 0.35, 0.35]) and height[:3] == pytest.approx([0.9, 0.35, 0.35])
    [bar] = [line for line in axes.lines if line.get_linewidth() == 4.0]
    assert list(bar.get_xdata()) == [-1.0, 1.0]


def test_one_continuous_state_has_heads_that_point_as_the_velocity_does():
    law = INC.saturated([[-1.2]], 1.0)
    axes = plot_phase_portrait(Plant(0.5, 1.0, dt=0), law, Box(-3, 3)).axes[0]
    for marker, sign in ((">", 1), ("<", -1)):
        [heads] = [line for line in axes.lines if line.get_marker() == marker]
        x = heads.get_xdata()
        assert len(x) > 5 and np.all(np.sign(0.5 * x - np.clip(1.2 * x, -1, 1)) == sign)


def test_it_is_drawn_into_the_axes_of_the_caller_and_written(figure: Figure, tmp_path: Any):
    mine = Figure()
    left, right = mine.subplots(1, 2)
    assert plot_phase_portrait(PLANT, LAW, AROUND, ax=right, path=tmp_path / "portrait.svg") is mine
    assert not left.collections and right.get_legend() is not None and not mine.legends
    assert b"<svg" in (tmp_path / "portrait.svg").read_bytes()[:1000]


def test_a_motion_that_is_still_under_way_is_not_called_at_rest():
    near = np.array([[0.01], [0.01]])
    found = paths(PLANT, LAW, np.array([[0.8, 0.01], [0.7, 0.0]]), AROUND, steps=1)
    assert found.rests.tolist() == [False, True] and paths(PLANT, LAW, near, AROUND, steps=0).x.shape == (2, 1, 1)


def test_motions_stop_when_they_are_far_and_the_grid_tells_who_converges():
    found = paths(Plant(2.0, 1.0), INC.linear([[0.0]]), np.array([[0.0, 1.0]]), Box(-1, 1), steps=10)
    assert found.rests.tolist() == [True, False] and found.x[0, 1, :3].tolist() == [1.0, 2.0, 4.0]
    assert np.isnan(found.x[0, 1, 3:]).all() and np.all(found.x[0, 0] == 0)
    grid, rests = converging(PLANT, LAW, AROUND, 21)
    later = grid
    for _ in range(120):
        later = step(np.clip(later, -1e6, 1e6))
    assert np.array_equal(rests, np.abs(later).max(axis=0) < 0.1)


def test_the_grid_of_arrows_and_the_staircase_have_no_degenerate_case():
    points, cell = arrow_grid(np.array([-1.0, 0.0]), np.array([1.0, 3.0]), 3)
    assert points.shape == (2, 9) and cell.tolist() == pytest.approx([2 / 3, 1.0])
    assert np.all(arrows(np.zeros((2, 4)), cell) == 0.0)
    assert [part.tolist() for part in staircase(np.array([2.0]))] == [[2.0], [2.0]]
