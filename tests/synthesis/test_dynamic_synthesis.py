"""The verb for controllers with memory: what it returns, keeps, refuses and says."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace

import numpy as np
import pytest

from inc_casadi import INC, Box, Gaussian, Plant, Polytope, Spec, Tanh
from inc_casadi.__main__ import main
from inc_casadi.dynamic import DynamicINC, corrected, observer
from inc_casadi.errors import DimensionError, FormatError, InvalidInputError, NotCertifiedError, NotStabilizableError
from inc_casadi.linear import discounted_lqr
from synthesis import dynamic_rounds, dynamic_synthesis, synthesize_dynamic
from synthesis.causes import Cause
from synthesis.dynamic_gate import gate_dynamic
from synthesis.dynamic_result import DynamicResult
from synthesis.dynamic_starts import DYNAMIC_STARTS, steady_gain
from synthesis.dynamic_storage import load_dynamic_result
from synthesis.dynamic_training import simulated_dynamic

DOUBLE = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]])
SPEC = Spec(np.eye(2), 0.1, 0.95, Box([-1, -0.5], [1, 0.5]), Box(-0.5, 0.5))
QUICK = {"hidden": 0, "rounds": 1, "verbose": False, "proof_seconds": 30.0}
WILD = DynamicINC(INC.linear([[0.5, 0.0], [0.0, 0.5]]), [0.0])
FIRST = ("filter, clipped LQR", "observer with noise 1, clipped LQR")


@pytest.fixture
def boundless(monkeypatch):
    """No lower bounds, which take seconds: where they do not matter."""
    monkeypatch.setattr(dynamic_synthesis, "lower_bounds", lambda *arguments: {})


@pytest.fixture(scope="module")
def result():
    return synthesize_dynamic(DOUBLE, SPEC, starts=FIRST, **QUICK)


def test_the_cheapest_certified_candidate_is_returned(result):
    first, second = result.history
    assert result.status == "certified" and result.chosen is first and first.cost < second.cost
    assert result.cost == result.certificate.bound == first.cost and result.proof


def test_its_cost_is_that_of_motions(result):
    nodes, weights = SPEC.initial.quadrature(120)
    x, xi, total = nodes, np.repeat(result.dynamic.xi_0[:, None], nodes.shape[1], axis=1), 0.0
    for k in range(150):
        after, u = result.dynamic.step(xi, DOUBLE.C @ x)
        total += 0.95**k * ((x**2).sum(axis=0) + 0.1 * u[0] ** 2)
        x, xi = DOUBLE.A @ x + DOUBLE.B @ u, after
    np.testing.assert_allclose(result.cost, weights @ total, rtol=1e-3)


def test_it_beats_every_linear_controller_and_nothing_is_cheaper_than_the_bound(result):
    floor = result.bounds["linear controllers"].value
    assert result.bounds["any controller"].value < result.cost < 0.6 * floor
    assert "every admissible finite-order dynamic linear controller costs at least" in str(result)


@pytest.mark.slow
def test_training_lowers_the_certified_cost(result):
    more = synthesize_dynamic(DOUBLE, SPEC, starts=FIRST[:1], hidden=0, training_iterations=12, tol=0, verbose=False)
    assert more.chosen.name.endswith("trained") and more.chosen.of == FIRST[0] and more.chosen.training
    assert result.bounds["any controller"].value < more.cost < 0.985 * result.cost and more.proof


def test_report_says_what_is_proved(result):
    text = result.report()
    assert text.startswith("status") and "CERTIFIED" in text and "4 states of its own" in text
    assert "input limits kept on every motion" in text and "settled rigorously" in text and str(result) == text


def test_it_reopens_with_everything_and_is_checked_without_solvers(result, tmp_path, capsys):
    path = tmp_path / "result.json"
    result.save(path)
    again = load_dynamic_result(path)
    assert str(again) == str(result) and again.cost == result.cost and again.chosen is again.history[0]
    assert again.certificate.prove() and main(["check", str(path)]) == 0


def test_a_file_about_another_controller_or_specification_is_refused(result, tmp_path):
    other = DynamicINC(result.dynamic.law, result.dynamic.xi_0 + 0.125)
    dearer = replace(SPEC, R=np.array([[0.2]]))
    strangers = replace(result, dynamic=other), replace(result, spec=dearer), replace(result, dynamic=None)
    for number, changed in enumerate(strangers):
        path = tmp_path / f"{number}.json"
        changed.save(path)
        with pytest.raises(FormatError, match=r"certificate|lower bound"):
            load_dynamic_result(path)
    (tmp_path / "odd.json").write_text(json.dumps({}))
    with pytest.raises(FormatError):
        load_dynamic_result(tmp_path / "odd.json")


def test_no_field_of_a_result_is_forgotten(result, tmp_path):
    result.save(tmp_path / "result.json")
    again = load_dynamic_result(tmp_path / "result.json")
    for field in fields(DynamicResult):
        assert bool(getattr(again, field.name)) == bool(getattr(result, field.name)), field.name
    assert dict(again.seconds) == dict(result.seconds) and again.notes == result.notes


def test_without_a_certificate_it_says_so(boundless):
    found = synthesize_dynamic(DOUBLE, SPEC, start=WILD, starts=(), **QUICK)
    assert found.status == "failed" and found.cost == np.inf and found.certificate is None and found.proof is None
    with pytest.raises(NotCertifiedError, match="does not stabilize"):
        found.require()
    assert "not proved" in str(found)


def test_given_laws_with_and_without_memory_come_first(boundless):
    measured = Plant(DOUBLE.A, DOUBLE.B)
    law = INC.saturated(discounted_lqr(measured, SPEC)[0], 0.5)
    held = observer(measured, 0.5 * measured.A, law)
    found = synthesize_dynamic(measured, SPEC, start=[law, held], starts=(), tol=0.0, **QUICK)
    assert [one.name for one in found.history] == ["given 1", "given 2"] and found.chosen is found.history[0]
    assert found.dynamic.order == 1


def test_an_executor_gives_the_same(result, boundless):
    with ThreadPoolExecutor(2) as pool:
        found = synthesize_dynamic(DOUBLE, SPEC, starts=FIRST, executor=pool, **QUICK)
    assert found.cost == result.cost and [one.name for one in found.history] == [one.name for one in result.history]


def test_interrupting_it_keeps_the_best_so_far(boundless, monkeypatch):
    made = dynamic_rounds.attempt_dynamic

    def interrupted(task):
        if task.name == FIRST[0]:
            return made(task)
        raise KeyboardInterrupt

    monkeypatch.setattr(dynamic_rounds, "attempt_dynamic", interrupted)
    found = synthesize_dynamic(DOUBLE, SPEC, starts=FIRST, **QUICK)
    assert found.status == "certified" and any(note.startswith("interrupted after 1 of 2") for note in found.notes)


def test_an_interrupted_training_ends_the_search_with_what_it_had(boundless, monkeypatch):
    made = dynamic_rounds.attempt_dynamic
    monkeypatch.setattr(dynamic_rounds, "attempt_dynamic", lambda task: replace(made(task), note="interrupted"))
    found = synthesize_dynamic(DOUBLE, SPEC, starts=FIRST, **QUICK)
    assert found.status == "certified" and len(found.history) == 1
    assert any(note.startswith("interrupted after 1 of 2") for note in found.notes)


@pytest.mark.parametrize("changed, error, words", [
    ({"starts": ["nobody"]}, InvalidInputError, "nobody"), ({"starts": ()}, InvalidInputError, "nothing to try"),
    ({"start": INC.linear([[1.0, 1.0]])}, DimensionError, "start maps 2 measurements"),
    ({"start": [3.0]}, InvalidInputError, "start must be"), ({"hidden": -1}, InvalidInputError, "hidden"),
    ({"kappa": 1.0}, InvalidInputError, "kappa"),
    ({"plant": Plant([[2.0, 0.0], [0.0, 0.5]], [[0.0], [1.0]])}, NotStabilizableError, "no input reaches"),
    ({"plant": Plant(DOUBLE.A, DOUBLE.B, DOUBLE.C, dt=0)}, InvalidInputError, "period"),
])
def test_what_does_not_fit_is_refused(changed, error, words):
    options = {"plant": DOUBLE, "spec": SPEC} | QUICK | changed
    with pytest.raises(error, match=words):
        synthesize_dynamic(options.pop("plant"), options.pop("spec"), **options)


def test_an_output_that_hides_an_unstable_mode_has_no_observer(boundless):
    hidden = Plant(np.diag([1.1, 0.5]), [[1.0], [1.0]], [[0.0, 1.0]])
    found = synthesize_dynamic(hidden, replace(SPEC, initial=Box([-0.1, -0.1], [0.1, 0.1])), **QUICK)
    assert found.status == "failed" and any("does not show the mode" in note for note in found.notes)


def test_the_gate_asks_other_ways_where_pieces_do_not_apply():
    plant, spec = Plant(0.9, 1.0), Spec(1.0, 0.1, 0.95, Gaussian([0.0], [[0.25]]))
    held = observer(plant, [[0.8]], corrected(INC.linear([[-0.5]]), [[0.5]], plant.C))
    verdict = gate_dynamic(plant, spec, held)
    run = simulated_dynamic(plant, spec, held, 20_000)
    assert verdict.accepted and "not uniform" in verdict.refusals[0]
    assert run.mean - 4 * run.standard_error < verdict.cost < 1.1 * run.mean


def test_the_gate_refuses_by_reasons():
    smooth = observer(DOUBLE, [[2.0], [1.0]], INC([[0.0]], [[-0.5, -1.2]], [[0.5]], [[0.0, 0.0]], activation=Tanh()))
    loud = DynamicINC(INC([[2.0]], [[1.0, 0.0]], [[0.1], [0.0]], np.zeros((2, 2))), [0.0])
    for dynamic, cause in ((smooth, Cause.SMOOTH), (WILD, Cause.UNSTABLE), (loud, Cause.ILL_POSED)):
        verdict = gate_dynamic(DOUBLE, SPEC, dynamic)
        assert not verdict.accepted and verdict.causes[0] is cause


@pytest.mark.parametrize("name", [name for name in DYNAMIC_STARTS if name != "kept gain" and "noise 0.01, MPC" not in name])
def test_each_start_keeps_the_limits_and_comes_to_rest(name):
    run = simulated_dynamic(DOUBLE, SPEC, DYNAMIC_STARTS[name](DOUBLE, SPEC), 300)
    assert run.settled and run.excess <= 1e-9 and run.mean < 2.2


def test_starts_clip_to_a_box_within_a_polytope_of_limits():
    plant = Plant(DOUBLE.A, np.eye(2), DOUBLE.C)
    spec = replace(SPEC, R=0.1 * np.eye(2), inputs=Polytope([[1, 1], [1, -1], [-1, 1], [-1, -1]], [0.5] * 4))
    assert simulated_dynamic(plant, spec, DYNAMIC_STARTS[FIRST[0]](plant, spec), 300).excess <= 1e-9


def test_steady_gain_solves_the_riccati_equation():
    M = steady_gain(DOUBLE, SPEC, 0.1)
    W = np.asarray(SPEC.initial.covariance)
    N, S = 0.1 * W[:1, :1], W
    for _ in range(500):
        gain = S @ DOUBLE.C.T @ np.linalg.inv(DOUBLE.C @ S @ DOUBLE.C.T + N)
        S = DOUBLE.A @ (S - gain @ DOUBLE.C @ S) @ DOUBLE.A.T + W
    np.testing.assert_allclose(M, gain, rtol=1e-8)


def test_above_eight_states_the_expected_cost_of_a_kept_gain_is_exact(tmp_path, boundless):
    plant = Plant(np.diag(np.linspace(0.1, 0.9, 9)), np.full((9, 1), 0.1), np.full((1, 9), 0.1))
    spec = Spec(np.eye(9), 0.1, 0.95, Box(-np.ones(9), np.ones(9)), Box(-1, 1))
    found = synthesize_dynamic(plant, spec, start=INC.saturated([[-0.5]], 1.0), starts=(), **QUICK)
    F = plant.A - 0.05 * plant.B @ np.ones((1, 9))
    x, total = np.eye(9) / np.sqrt(3.0), 0.0  # columns whose outer products add up to the covariance of x_0
    for k in range(300):
        total += 0.95**k * float(np.sum(x**2) + 0.1 * np.sum((0.05 * x.sum(axis=0)) ** 2))
        x = F @ x
    assert found.proof and found.certificate.plant.n == 10
    np.testing.assert_allclose(found.cost, total, rtol=1e-9)
    found.save(tmp_path / "result.json")
    assert load_dynamic_result(tmp_path / "result.json").cost == found.cost


def test_a_file_with_a_certificate_of_another_extended_loop_is_refused(tmp_path, boundless):
    plant = Plant(0.5 * np.eye(9), np.ones((9, 1)), np.ones((1, 9)))
    spec = Spec(np.eye(9), 0.1, 0.95, Box(-0.1 * np.ones(9), 0.1 * np.ones(9)), Box(-1, 1))
    found = synthesize_dynamic(plant, spec, start=INC.saturated([[-0.05]], 1.0), starts=(), **QUICK)
    replace(found, spec=replace(spec, R=np.array([[0.2]]))).save(tmp_path / "result.json")
    with pytest.raises(FormatError, match="certificate is about another specification"):
        load_dynamic_result(tmp_path / "result.json")


def test_the_best_gain_that_keeps_the_limits_takes_part():
    spec = Spec(1.0, 0.0, 0.5, Box(-1, 1), Box(-1, 1))
    law = DYNAMIC_STARTS["kept gain"](Plant(1.5, 1.0), spec)
    assert law.step([0.0], [1.0])[1].item() == pytest.approx(-1.0, abs=1e-6)
