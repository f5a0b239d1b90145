"""Comparisons of published examples: the sentences that are proved, and what is said where nothing is."""

from __future__ import annotations

import json

import draws
import numpy as np
import pytest

from benchmarks.plants.paper import output_feedback, scalar, two_state
from inc_casadi import INC, Box, Budget, Ellipsoid, Gaussian, Plant, Polytope, Saturation, Spec, Tanh, compare
from inc_casadi.comparison import Comparison, controllers
from inc_casadi.errors import DimensionError, InvalidInputError, NoEquilibriumError
from inc_casadi.linear import best_static_gain, discounted_lqr, scaled_lqr_gain
from inc_casadi.linear.best_dynamic import best_dynamic_linear
from inc_casadi.linear.controller import LinearController

CALM = Plant([[0.7, 0.2], [0.0, 0.6]], [[0.0], [1.0]])


@pytest.fixture(scope="module")
def paper() -> Comparison:
    case = two_state()
    K, _ = discounted_lqr(case.plant, case.spec)
    lag = LinearController([[0.5]], [[0.0, 0.02]], [[0.1]], [[-0.33, -0.85]])
    laws = {"clipped LQR": INC.saturated(K, 1.0), "best static gain": best_static_gain(case.plant, case.spec),
            "scaled LQR": scaled_lqr_gain(case.plant, case.spec).F, "lag": lag,
            "best dynamic": best_dynamic_linear(case.plant, case.spec), "too strong": [[-1.0, -2.0]],
            "a function": lambda y: np.clip(K @ y, -1, 1)}
    return compare(case.plant, case.spec, laws, cells=500, seconds=3.0)


def test_the_two_state_example_is_stated_and_proved(paper: Comparison):
    shown = paper.proved()
    assert all(shown.proofs[name] for name in ("clipped LQR", "best static gain", "lower bound, linear controllers"))
    first, second = (one for one in shown.statements if one.name == "clipped LQR" and one.family.key != "static")
    assert first.claim == ("Every admissible finite-order dynamic linear controller costs at least 2.116763; clipped LQR "
                           "costs at most 1.364962; both are proved.")
    assert "exact rational arithmetic" in first.grounds and "Lagrangian" in first.grounds and first.separates
    assert second.claim.startswith("No controller whatever costs less than 1.36") and "of the best possible" in second.claim
    assert not second.separates


def test_costs_of_the_two_state_example(paper: Comparison):
    costs = [paper.cost_of(name) for name in ("clipped LQR", "best static gain", "scaled LQR")]
    assert costs == pytest.approx([1.36496190, 3.34718357, 3.56389246], rel=1e-8)
    assert 0 < paper.gap("clipped LQR") < 0.01 and paper.gap("best static gain") > 1.4
    assert paper.row("clipped LQR").worst == pytest.approx(11.16812, rel=1e-5)


def test_only_a_controller_outside_the_class_is_separated_from_it(paper: Comparison):
    assert paper.separates("clipped LQR", "linear") and paper.separates("clipped LQR", "static")
    assert not any(paper.separates(row.name, "any") for row in paper.rows)
    assert not any(paper.separates(row.name, "linear") for row in paper.rows if row.name != "clipped LQR")


def test_the_best_dynamic_linear_controller_meets_its_bound_and_beats_every_static_gain(paper: Comparison):
    linear, static = paper.floor("linear").value, paper.floor("static").value
    assert linear <= paper.cost_of("best dynamic") < linear * (1 + 1e-4)
    assert paper.separates("best dynamic", "static") and static > 0.98 * paper.cost_of("best static gain")
    [claim] = [one.claim for one in paper.statements if one.name == "best dynamic" and one.separates]
    assert claim.startswith("Every admissible static linear gain u = F y costs at least 3.3")
    assert paper.row("best dynamic").converges.verdict == "certified" and paper.row("best dynamic").seconds < 5


def test_a_function_is_only_simulated_and_beats_nobody(paper: Comparison):
    row = paper.row("a function")
    assert not row.certified and row.limits.verdict == row.converges.verdict == "seen in simulation"
    assert row.cost.value == pytest.approx(1.364962, abs=5 * row.cost.error) and row.cost.error < 0.02
    assert not paper.separates("a function", "linear") and np.isnan(paper.gap("a function"))


def test_a_gain_that_breaks_the_limits_is_no_member_however_cheap(paper: Comparison):
    row = paper.row("too strong")
    assert row.limits.verdict == "violated" and "1.4" in row.limits.reason  # 0.8 (1 + 2) - 1
    assert row.cost.value < 1.1 < paper.floor("any").value and row.bound == np.inf
    assert paper.inversions() == () and "too strong" in str(paper) and "limits violated" in str(paper)


def test_a_nonlinear_law_that_breaks_the_limits_has_a_cost_but_no_standing():
    case = scalar(0.9)
    shown = compare(case.plant, case.spec, {"wide": INC.saturated([[-1.5]], 1.2)}, bounds=["any"], cells=50)
    row = shown.row("wide")
    assert row.limits.verdict == "violated" and "0.2" in row.limits.reason and row.cost.how == "exact"
    assert row.cost.value == pytest.approx(1 / 3 + 0.9 * 0.3**3 / 4.5)  # |x1| = 1.5 |x0| - 1.2 beyond |x0| = 0.8
    assert shown.inversions() == () and not shown.certifies("wide") and np.isnan(shown.gap("wide"))


def test_a_dynamic_controller_costs_what_its_motions_cost(paper: Comparison):
    row, case = paper.row("lag"), two_state()
    assert row.certified and row.kind == "dynamic linear, order 1" and row.limits.verdict == "certified"
    points = case.spec.initial.sample(40_000, np.random.default_rng(5))
    x, xi, total = points, np.zeros((1, points.shape[1])), np.zeros(points.shape[1])
    for k in range(400):
        xi, u = row.controller.step(xi, x)
        total += 0.98**k * (np.sum(x**2, axis=0) + 0.05 * u[0] ** 2)
        x = case.plant.A @ x + case.plant.B @ u
    assert row.bound == pytest.approx(total.mean(), abs=5 * total.std() / 200)


def test_the_table_has_bounds_verdicts_and_the_caveat(paper: Comparison):
    text = str(paper)
    for words in ("lower bound, linear controllers: at least 2.116763", "3.347184", "exact, certified",
                  "simulated, 20000 samples", "fixed state", "prop:no_arbitrary_sof", "Nothing is shown of too strong"):
        assert words in text, words
    assert "proved" not in text.split("\n")[1] and "INCONSISTENT" not in text


def test_plain_rows_survive_json_and_share_their_keys(paper: Comparison):
    rows = json.loads(json.dumps(paper.to_rows(), allow_nan=False))
    assert len({tuple(row) for row in rows}) == 1 and len(rows) == 10
    assert [row["role"] for row in rows] == 7 * ["controller"] + 3 * ["lower bound"]
    assert rows[0]["certified"] and rows[0]["proved"] is None and rows[0]["cost"] == pytest.approx(1.3649619)


def test_output_feedback_embedding():
    case = output_feedback(weight=0.3)
    shown = compare(case.plant, case.spec, {"sat": INC.saturated([[-1.5]], 1.0), "gain": [[-1.0]]}, cells=1000, seconds=2.0,
                    prove=True)
    free = 0.1 / (1 - 0.9 / 4)  # the second state, which no controller can change
    assert shown.cost_of("sat") == pytest.approx(1 / 3 + 0.9 / 36 + free) and shown.separates("sat", "static")
    assert shown.cost_of("gain") == pytest.approx(1 / (3 * (1 - 0.9 / 4)) + free)
    assert shown.floor("static").value <= shown.cost_of("gain") and "both are proved" in shown.statements[0].claim


def test_two_inputs_with_limits_of_their_own():
    plant = Plant([[1.2, 0.3], [0.0, 1.05]], [[1.0, 0.2], [0.1, 0.8]])
    spec = Spec(np.diag([1, 2]), np.diag([0.05, 0.1]), 0.95, Box([-1, -0.6], [1, 0.9]), Box([-0.5, -0.7], [0.6, 0.5]))
    shown = compare(plant, spec, cells=500, seconds=2.0)
    assert [row.name for row in shown.rows] == ["clipped LQR", "best static gain", "scaled LQR"]
    assert shown.separates("clipped LQR", "linear") and shown.row("clipped LQR").kind == "neural, 2 units"
    assert shown.require_consistent() is shown


def test_where_nothing_separates_the_missing_part_is_stated():
    spec = Spec(np.eye(2), 1.0, 1.0, Box([-1, -1], [1, 1]), Box(-5, 5))  # limits that are never met
    law = INC.saturated(0.9 * discounted_lqr(CALM, spec)[0], 5.0)
    shown = compare(CALM, spec, {"clipped LQR": law}, bounds=["any", "linear"], cells=50)
    [missing] = [one.claim for one in shown.statements if one.family.key == "linear"]
    lack = shown.cost_of("clipped LQR") - shown.floor("linear").value
    assert lack > 1e-4 and "no separation from linear controllers" in missing.lower()
    assert f"is {np.ceil(lack * 1e7) / 1e7:.4g}"[:8] in missing
    assert "No controller is shown to beat a class" in str(shown)


def test_gaussian_starts_leave_linear_controllers_without_feedback():
    spec = Spec(np.eye(2), 1.0, 1.0, Gaussian([0, 0], np.eye(2)), Box(-1, 1))
    laws = {"gain": [[-0.1, -0.2]], "net": INC.from_layers([([[-0.3, -0.2]], [0.0]), ([[0.5]], [0.0])], Tanh())}
    shown = compare(CALM, spec, laws, bounds=["linear", "any"], cells=100)
    assert shown.floors[0].bound is None and "Gaussian" in shown.floors[0].reason and "Gaussian" in str(shown)
    assert shown.row("gain").limits.verdict == "violated" and "unbounded" in shown.row("gain").limits.reason
    net = shown.row("net")
    assert net.certified and net.cost.how == "upper bound" and "built in" in net.limits.reason
    assert shown.floor("any").value < net.bound < 1.5 * shown.floor("any").value


def test_of_a_continuous_plant_only_the_global_inequality_says_something():
    plant = Plant([[0.0, 1.0], [-1.0, -1.0]], [[0.0], [1.0]], dt=0)
    spec = Spec(np.eye(2), 1.0, 1.0, Box([-1, -1], [1, 1]), Box(-9, 9))
    shown = compare(plant, spec, {"sat": INC.saturated([[-1.0, -1.0]], 9.0), "gain": [[-1.0, -1.0]], "f": lambda y: -y[:1]})
    assert [row.certified for row in shown.rows] == [True, False, False]
    assert all(floor.bound is None for floor in shown.floors)
    assert shown.row("gain").cost.value == pytest.approx(0.75)  # x'' = -2 x - 2 x', integral of x'x + u^2, within limits
    assert 0.75 < shown.row("sat").bound < 1.0
    assert "\n".join([str(shown), *shown.row("gain").notes]).count("sampled(dt)") >= 5
    assert all("continuous" in floor.reason for floor in shown.floors[:2])


def test_a_controller_that_fails_is_a_row_and_the_others_stay():
    case = two_state()

    def broken(y: np.ndarray) -> np.ndarray:
        if y.shape[1] > 100:
            raise ValueError("out of memory")
        return np.zeros((1, y.shape[1]))

    laws = {"loop": INC([[2.0]], [[1.0, 0.0]], [[1.0]], [[0.0, 0.0]]), "nothing": [[0.0, 0.0]], "broken": broken,
            "short": INC.saturated([[-1.3, -2.6]], 0.8), "fine": [[-0.35, -0.89]]}
    shown = compare(case.plant, case.spec, laws, bounds=[], budget=Budget(steps=1))
    reasons = {row.name: str(one) for row, one in zip(shown.rows, shown.statements, strict=False)}
    assert "well posed" in reasons["loop"] and len(shown.row("loop").notes) == 1  # nothing else is tried
    assert "out of memory" in reasons["broken"]
    assert shown.row("nothing").cost.value == np.inf and shown.row("nothing").converges.verdict == "violated"
    assert "still under way" in reasons["short"] and shown.row("short").cost.how == "simulated"
    assert shown.row("fine").certified


def test_a_gain_from_an_ellipsoid_is_judged_by_its_lyapunov_inequality():
    spec = Spec(np.eye(2), 0.05, 0.98, Ellipsoid(np.eye(2) / 0.64), Box(-1, 1))
    plant, F = two_state().plant, np.array([[-0.3, -0.8]])
    row = compare(plant, spec, {"gain": F}, bounds=[]).row("gain")
    closed, power, total = plant.A + plant.B @ F, np.eye(2), 0.0
    for k in range(2000):
        total += 0.98**k * np.sum((spec.Q + 0.05 * F.T @ F) * (power @ (0.16 * np.eye(2)) @ power.T))
        power = closed @ power
    assert row.certified and row.cost.how == "Lyapunov" and row.bound == pytest.approx(total) and row.bound >= total
    assert row.prove()


def test_linear_controllers_that_fail_say_where():
    case = two_state()
    wide = LinearController([[0.5]], [[0.0, 0.02]], [[0.1]], [[-0.5, -1.0]])
    shown = compare(case.plant, case.spec, {"grows": LinearController.static([[0.1, 0.1]]), "wide": wide}, bounds=[])
    grows, broke = shown.rows
    assert grows.converges.verdict == "violated" and grows.cost.value == np.inf and "spectral radius" in str(shown)
    assert broke.limits.verdict == "violated" and "0.2 at k = 0" in broke.limits.reason  # 0.8 (0.5 + 1) - 1
    assert broke.cost.evidence is None and broke.cost.how == "Lyapunov" and broke.notes
    assert broke.converges.verdict == "certified"


def test_whatever_the_toolbox_refuses_inside_a_row_stays_in_the_row(monkeypatch: pytest.MonkeyPatch):
    def refuse(*_: object) -> None:
        raise NoEquilibriumError("there is none")

    monkeypatch.setattr(controllers, "_JUDGES", ((INC, refuse), *controllers._JUDGES[1:]))
    case = two_state()
    shown = compare(case.plant, case.spec, {"gain": [[-0.3, -0.8]], "f": lambda y: 0 * y[:1]}, bounds=[], samples=10)
    assert shown.rows[0].notes == ("there is none",) and shown.rows[1].cost.how == "simulated"


def test_usual_controllers_that_cannot_be_had_are_rows_with_reasons():
    case = two_state()
    far = Spec(np.eye(2), 0.05, 0.98, Box([-9, -9], [9, 9]), Box(-1, 1))
    shown = compare(case.plant, far, bounds=[], budget=Budget(pieces=50, steps=20), samples=100)
    assert "no static gain" in str(shown) and len(shown.rows) == 3 and not any(row.certified for row in shown.rows)


def test_a_missing_solver_is_a_line_with_its_reason(monkeypatch: pytest.MonkeyPatch):
    import sys
    case = two_state()
    monkeypatch.setitem(sys.modules, "clarabel", None)
    shown = compare(case.plant, case.spec, {"sat": INC.saturated([[-1.3, -2.6]], 1.0)}, bounds=["linear"])
    assert "clarabel" in str(shown) and shown.row("sat").certified


def test_same_seed_same_report_but_for_the_seconds():
    case = two_state()
    rows = [compare(case.plant, case.spec, {"f": lambda y: -np.tanh(y[:1] + 2 * y[1:])}, bounds=["linear"], samples=500,
                    seed=seed).to_rows() for seed in (3, 3, 4)]
    for row in (one for some in rows for one in some):
        del row["seconds"]
    assert rows[0] == rows[1] != rows[2]


def test_progress_lines(capsys: pytest.CaptureFixture[str]):
    case = output_feedback()
    compare(case.plant, case.spec, {"gain": [[-1.0]]}, bounds=["linear"], verbose=True)
    lines = capsys.readouterr().out.splitlines()
    assert "gain: at most 0.4301" in lines[0] and "lower bound, linear controllers: 0.408" in lines[1]


@pytest.mark.parametrize(("changes", "words"), [
    ({"plant": 3}, "plant"), ({"spec": 3}, "spec"), ({"controllers": [1]}, "controllers"),
    ({"controllers": {"F": [[1.0, 2.0, 3.0]]}}, "'F'"), ({"controllers": {"F": [[np.nan, 1.0]]}}, "'F'"),
    ({"controllers": {"law": INC.linear([[1.0]])}}, "'law' reads 1"), ({"controllers": {"word": "LQR"}}, "'word'"),
    ({"controllers": {"f": lambda y: y}}, "'f' answers"), ({"controllers": {"f": lambda y: y[7]}}, "'f' fails"),
    ({"controllers": {1: [[1.0, 2.0]]}}, "names are words"), ({"bounds": ["sof"]}, "'sof'"),
    ({"bounds": "any"}, "must list"),
    ({"cells": 0}, "cells"), ({"seconds": -1.0}, "seconds"), ({"budget": 3}, "budget"),
    ({"controllers": {"c": LinearController.static([[1.0]])}}, "'c' reads 1"),
])
def test_bad_arguments_are_refused_by_name(changes: dict, words: str):
    case = two_state()
    arguments = {"plant": case.plant, "spec": case.spec, "controllers": {}} | changes
    with pytest.raises((InvalidInputError, DimensionError), match=words):
        compare(**arguments)


def test_a_polytope_of_limits_and_a_tanh_net_that_keeps_its_box():
    limits = Polytope.from_vertices([[-1.0, 1.0]])
    spec = Spec(np.eye(2), 1.0, 1.0, Box([-1, -1], [1, 1]), limits)
    net = INC.from_layers([([[-0.3, -0.2]], [0.0]), ([[0.3]], [0.0])], Tanh())
    leaning = INC(net.W, net.U, net.V, [[0.0, -0.05]], activation=Tanh())  # its range is unbounded
    falling = INC(net.W, net.U, net.V, [[-0.9, -0.9]], activation=Tanh())
    shown = compare(CALM, spec, {"net": net, "leaning": leaning, "falling": falling}, bounds=[])
    assert shown.row("falling").limits.verdict == "violated"  # 1.8 + 0.3 tanh(0.5) from a corner
    assert shown.row("net").certified and "built in" in shown.row("net").limits.reason
    assert shown.row("leaning").certified and "invariant" in shown.row("leaning").limits.reason
    assert bool(shown.row("leaning").prove()) and len(list(shown.row("leaning").evidence)) == 2


@pytest.mark.parametrize(("size", "words"), [
    (0.9, "matrix inequality"), pytest.param(0.02, "the largest cost", marks=pytest.mark.slow)])
def test_in_many_dimensions_the_lower_of_two_bounds_is_stated(size, words):
    n = 9
    middle = 0 if size > 0.5 else np.arange(1.0, n + 1)[:, None] / n
    start = Polytope.from_vertices(size * draws.regular_simplex(n) + middle)
    plant = Plant(np.diag(np.linspace(0.1, 0.9, n)), np.ones((n, 1)))
    spec = Spec(np.eye(n), 0.1, 0.95, start, Box(-1, 1))
    law = INC([[0.125]], -0.6 * np.ones((1, n)), [[0.2]], np.zeros((1, n)), activation=Saturation())  # it switches
    row = compare(plant, spec, {"net": law}, bounds=[]).row("net")
    assert row.certified and row.cost.words.startswith(words) and row.cost.value <= row.worst
