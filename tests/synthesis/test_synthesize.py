"""The main verb: what it returns, what it refuses, and that it says so honestly."""

import json
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from inc_casadi import INC, Box, Ellipsoid, Gaussian, Plant, Polytope, ReLU, Spec, Tanh, bounds
from inc_casadi.ellipsoidal_region import EllipsoidalRegion
from inc_casadi.errors import (
    DimensionError,
    EmptySetError,
    FormatError,
    InfeasibleError,
    InvalidInputError,
    NotCertifiedError,
    NotStabilizableError,
)
from inc_casadi.interchange.files import digest
from synthesis import load_result, synthesize
from synthesis.attempts import TRAINED, attempt, plan
from synthesis.competitors import keeps_limits
from synthesis.followups import Done
from synthesis.gate import gate

PLANT = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
SPEC = Spec(np.eye(2), [[0.05]], 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box([-1.0], [1.0]))


@pytest.fixture(scope="module")
def quick():
    return synthesize(PLANT, SPEC, hidden=0, verbose=False)


def test_the_untrained_answer_is_the_proved_saturated_lqr(quick):
    assert quick.status == "certified" and quick.cost == pytest.approx(1.36496190, abs=1e-8)
    assert quick.certificate.prove().succeeded
    assert quick.estimate.mean == pytest.approx(quick.cost, abs=4 * quick.estimate.standard_error)
    assert quick.worst >= quick.estimate.largest
    values = {name: float(bound) for name, bound in quick.bounds.items()}
    assert values["linear controllers"] > quick.cost > values["any controller"] > 1.3647
    assert quick.linear["best static linear gain"] == pytest.approx(3.347184, abs=1e-5)


def test_the_answer_is_settled_rigorously(quick):
    assert quick.proof and "256 binary places" in quick.proof.method
    assert "all of it settled rigorously" in str(quick)
    unsettled = replace(quick, proof=replace(quick.proof, succeeded=False, reason="no time"))
    assert "settled" not in str(unsettled) and "checked in floating point only" in str(unsettled)


def test_the_status_is_recomputed_and_never_remembered(quick):
    broken = replace(quick, certificate=replace(quick.certificate, level=100 * quick.certificate.level))
    assert broken.status == "simulation evidence" and broken.cost == np.inf
    unproved = replace(quick, certificate=None)
    assert unproved.status == "simulation evidence"
    assert replace(unproved, estimate=replace(quick.estimate, excess=0.1)).status == "failed"
    assert replace(unproved, estimate=replace(quick.estimate, mean=np.inf)).status == "failed"


def test_the_cheapest_certified_attempt_is_taken(quick):
    def choose(attempts):
        return sys.modules["synthesis.synthesize"]._best([Done(task, each) for each in attempts])

    one, task = quick.history[0], plan(PLANT, SPEC, 0, ReLU(), 0.95, 0, 1.0)[0]
    cheap = replace(one, name="cheap", verdict=replace(one.verdict, cost=1.0))
    bare = replace(one, name="bare", verdict=replace(one.verdict, certificate=None, cost=np.inf),
                   estimate=replace(one.estimate, mean=0.1))
    assert choose([one, cheap, bare]) is cheap
    worse = replace(bare, name="worse", estimate=replace(one.estimate, mean=0.2))
    wild = replace(bare, name="wild", estimate=replace(one.estimate, mean=0.05, excess=1.0))
    assert choose([worse, bare, wild]) is bare and choose([]) is None


def test_the_table_says_what_an_engineer_asks(quick):
    text = str(quick)
    for words in ("CERTIFIED", "input limits kept", "converges from every initial state", "certified expected cost",
                  "certified worst cost", "standard error", "lower bound", "time", "1 attempt in 1 round",
                  "every admissible finite-order dynamic linear", "no controller whatever"):
        assert words in text, words


def test_a_result_opens_again_with_its_proof_checkable(quick, tmp_path):
    path = tmp_path / "result.json"
    quick.save(path)
    again = load_result(path)
    assert again.holds() and again.certificate.bound == quick.certificate.bound
    assert again.certificate.prove().succeeded
    assert again.figures["best static linear gain"] == quick.linear["best static linear gain"]
    text = path.read_text()
    path.write_text(text.replace('"version": 2', '"version": 7'))
    with pytest.raises(FormatError, match="version 7"):
        load_result(path)
    quick.save(path)
    content = json.loads(path.read_text())
    content["map"]["plant"]["data"]["A"]["array"][0] = 1.05
    path.write_text(json.dumps(content))
    with pytest.raises(FormatError, match="was altered after it was saved"):
        load_result(path)
    content["digest"] = digest({"map": content["map"]})  # as whoever alters a file on purpose would
    path.write_text(json.dumps(content))
    with pytest.raises(FormatError, match="about another plant or controller"):
        load_result(path)


@pytest.mark.parametrize("pool", [ThreadPoolExecutor, ProcessPoolExecutor])
def test_any_executor_gives_the_same_answer(quick, pool):
    with pool(max_workers=1) as executor:
        result = synthesize(PLANT, SPEC, hidden=0, executor=executor, verbose=False)
    assert result.cost == quick.cost
    np.testing.assert_array_equal(result.inc.U, quick.inc.U)


def test_a_linear_gain_that_exceeds_the_limits_later_is_told_apart():
    """x+ = (x1 + x2, x2 + u) from (0.1, 1): u0 = -0.5 keeps the limit 0.5, u1 = -1.1 - 0.2 does not."""
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.0], [1.0]])
    spec = Spec(np.eye(2), [[0.001]], 0.95, Box([-0.1, -1.0], [0.1, 1.0]), Box([-0.5], [0.5]))
    assert not keeps_limits(plant, spec, np.array([[-1.0, -0.4]]))
    small = Spec(np.eye(2), [[0.001]], 0.95, Box([-0.01, -0.1], [0.01, 0.1]), Box([-0.5], [0.5]))
    assert keeps_limits(plant, small, np.array([[-0.5, -1.0]]))
    ball = Spec(np.eye(2), [[0.001]], 0.95, Ellipsoid(np.eye(2) / 0.01), Box([-0.5], [0.5]))
    assert keeps_limits(plant, ball, np.array([[-0.5, -1.0]])) and not keeps_limits(plant, ball, np.array([[0.0, -5.1]]))


@pytest.mark.slow
def test_where_an_ellipsoid_bounds_the_cost_loosely_gains_that_clip_less_are_tried_too():
    """Not cut into pieces; the last one is never clipped, so that its cost is known."""
    spec = Spec(np.eye(2), [[0.05]], 0.98, Ellipsoid(2.2 * np.eye(2)), Box([-1.0], [1.0]))
    result = synthesize(PLANT, spec, hidden=0, verbose=False)
    assert result.status == "certified"
    assert [one.name for one in result.history] == ["clipped LQR", "halfway gain", "static gain"]
    assert result.chosen.name == "static gain" and result.chosen.of == "halfway gain"
    assert result.cost == pytest.approx(result.linear["best static linear gain"], rel=1e-8) and result.proof
    loose = [isinstance(one.verdict.certificate, EllipsoidalRegion) for one in result.history]
    assert loose == [True, True, False]
    assert float(result.bounds["any controller"]) < result.cost


def test_progress_is_printed_only_when_asked(capsys):
    spec = Spec([[1.0]], [[0.0]], 0.9, Box([-1.0], [1.0]), Box([-1.0], [1.0]))
    synthesize(Plant([[1.5]], [[1.0]]), spec, hidden=0, verbose=False)
    assert capsys.readouterr().out == ""
    synthesize(Plant([[1.5]], [[1.0]]), spec, hidden=0)
    assert "clipped LQR: certified cost" in capsys.readouterr().out


def test_an_interruption_keeps_what_was_finished(monkeypatch):
    def interrupted(task):
        if task.way == TRAINED:
            raise KeyboardInterrupt
        return attempt(task)

    monkeypatch.setattr("synthesis.rounds.attempt", interrupted)
    result = synthesize(PLANT, SPEC, hidden=3, tol=0.0, verbose=False)
    assert result.status == "certified" and any("interrupted after 1 of 3" in note for note in result.notes)


def test_an_interruption_of_the_proof_keeps_the_result(monkeypatch):
    def interrupted(self, seconds=None):
        raise KeyboardInterrupt

    monkeypatch.setattr("inc_casadi.regional_certificate.RegionalCertificate.prove", interrupted)
    result = synthesize(PLANT, SPEC, hidden=0, verbose=False)
    assert result.status == "certified" and result.proof is None
    assert any("while the proof was settled" in note for note in result.notes)


def test_training_beats_the_clipped_lqr_where_it_is_not_optimal():
    """A double integrator with |u| <= 0.5: the trained law is certified below the clipped LQR."""
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]])
    spec = Spec(np.eye(2), [[0.1]], 0.95, Box([-3.0, -1.5], [3.0, 1.5]), Box([-0.5], [0.5]))
    tasks = [task for task in plan(plant, spec, 8, ReLU(), 0.95, 0, 10.0) if task.start == "clipped LQR"]
    start, trained = (attempt(task) for task in tasks)
    assert start.verdict.cost == pytest.approx(14.64605, abs=1e-4)
    assert trained.certified and trained.verdict.cost < 14.61
    assert trained.inc.q == 9 and trained.inc.well_posedness().holds
    assert float(bounds.any_controller(plant, spec)) < trained.verdict.cost


def test_without_limits_the_answer_is_the_lqr():
    spec = Spec(np.eye(2), [[0.05]], 0.98, Box([-0.8, -0.8], [0.8, 0.8]))
    result = synthesize(PLANT, spec, hidden=0, verbose=False)
    assert result.status == "certified" and result.cost == pytest.approx(float(result.bounds["any controller"]), rel=1e-6)


def test_a_gaussian_start_is_certified_by_the_inequality_where_the_plant_is_stable():
    plant = Plant([[0.9, 0.2], [0.0, 0.8]], [[0.0], [1.0]])
    spec = Spec(np.eye(2), [[1.0]], 0.95, Gaussian([0.0, 0.0], 0.1 * np.eye(2)), Box([-1.0], [1.0]))
    result = synthesize(plant, spec, hidden=0, verbose=False)
    assert result.status == "certified" and np.isnan(result.worst)
    assert any("no lower bound for linear controllers" in note for note in result.notes)
    assert result.cost >= float(result.bounds["any controller"])


def test_output_feedback_starts_from_a_static_gain():
    plant = Plant([[1.5, 0.0], [0.0, 0.4]], [[1.0], [0.0]], [[1.0, 0.0]])
    spec = Spec(np.diag([1.0, 0.0]), [[0.0]], 0.9, Box([-1.0, -1.0], [1.0, 1.0]), Box([-1.0], [1.0]))
    result = synthesize(plant, spec, hidden=0, verbose=False)
    assert result.status == "certified"
    assert result.cost <= 1 / (3 * (1 - 0.9 / 4)) + 1e-6


def test_a_plant_that_no_static_gain_stabilizes_is_refused_with_a_reason():
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]])
    spec = Spec(np.eye(2), [[1.0]], 0.95, Box([-1.0, -1.0], [1.0, 1.0]), Box([-5.0], [5.0]))
    result = synthesize(plant, spec, hidden=0, verbose=False)
    assert result.status == "failed" and result.cost == np.inf and not result.estimate.settled
    assert any("does not stabilize: its spectral radius is 1" in why for why in result.chosen.verdict.refusals)
    assert "failed" in str(result) and "do not come to rest" in str(result)
    with pytest.raises(NotCertifiedError, match="does not stabilize"):
        result.require()


@pytest.mark.parametrize(("arguments", "error", "words"), [
    ({"kappa": 1.0}, InvalidInputError, r"kappa = 1 is outside \(0, 1\)"),
    ({"kappa": np.nan}, InvalidInputError, "kappa holds a NaN"),
    ({"hidden": -1}, InvalidInputError, "hidden = -1"),
    ({"hidden": 2.5}, InvalidInputError, "hidden = 2.5"),
    ({"activation": "relu"}, InvalidInputError, "activation must be an Activation"),
])
def test_bad_keywords_name_themselves(arguments, error, words):
    with pytest.raises(error, match=words):
        synthesize(PLANT, SPEC, verbose=False, **arguments)


def test_problems_that_nobody_can_solve_are_refused_at_the_door():
    limited = Box([-1.0], [1.0])
    with pytest.raises(NotStabilizableError, match=r"eigenvalue 1\.3"):
        synthesize(Plant(np.diag([1.3, 0.5]), [[0.0], [1.0]]), SPEC, verbose=False)
    with pytest.raises(InfeasibleError, match="1.5"):
        synthesize(Plant([[1.5]], [[1.0]]), Spec([[1.0]], [[1.0]], 0.9, Box([-3.0], [3.0]), limited), verbose=False)
    with pytest.raises(InvalidInputError, match="discrete time"):
        synthesize(Plant([[1.5]], [[1.0]], dt=0), Spec([[1.0]], [[1.0]], 0.9, Box([-1.0], [1.0]), limited), verbose=False)
    with pytest.raises(DimensionError):
        synthesize(Plant([[1.5]], [[1.0]]), SPEC, verbose=False)
    with pytest.raises(InvalidInputError, match="spec must be a Spec"):
        synthesize(PLANT, {"Q": 1}, verbose=False)  # type: ignore[arg-type]


@pytest.mark.parametrize(("make", "error", "words"), [
    (lambda: Plant([[np.nan]], [[1.0]]), InvalidInputError, "A holds a NaN"),
    (lambda: Plant([[1.0, 0.0]], [[1.0]]), DimensionError, "A has shape"),
    (lambda: Spec([[1, 2], [0, 1]], [[1]], 0.9, Box([-1, -1], [1, 1])), InvalidInputError, "Q is not symmetric"),
    (lambda: Spec([[-1.0]], [[1]], 0.9, Box([-1], [1])), InvalidInputError, "Q must be positive semidefinite"),
    (lambda: Spec([[1.0]], [[1]], 0.0, Box([-1], [1])), InvalidInputError, "discount = 0 is outside"),
    (lambda: Spec([[1.0]], [[1]], 1.1, Box([-1], [1])), InvalidInputError, "discount = 1.1 is outside"),
    (lambda: Box([1.0], [-1.0]), EmptySetError, "lower"),
    (lambda: Polytope([[1.0], [-1.0]], [-1.0, -1.0]), EmptySetError, "."),
])
def test_bad_nouns_are_refused_at_the_door(make, error, words):
    with pytest.raises(error, match=words):
        make()


def test_a_smooth_law_on_an_unstable_plant_is_certified_only_where_an_ellipsoid_holds_all(monkeypatch):
    def smooth_only(task):
        done = attempt(task)
        law = INC(np.zeros((1, 1)), done.inc.U, done.inc.V, done.inc.K, activation=Tanh())
        return replace(done, inc=law, verdict=gate(task.plant, task.spec, law))

    monkeypatch.setattr("synthesis.rounds.attempt", smooth_only)
    wide = Spec(np.eye(2), [[0.05]], 0.98, Box([-1.0, -1.0], [1.0, 1.0]), Box([-1.0], [1.0]))
    result = synthesize(PLANT, wide, hidden=0, rounds=1, verbose=False)
    assert result.status == "simulation evidence" and result.cost == np.inf
    text = str(result)
    assert "CERTIFIED" not in text and "not proved" in text and "not piecewise affine" in text and "ellipsoid" in text


def test_a_proof_without_time_leaves_the_result_in_floating_point():
    spec = Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box([-1], [1]))
    result = synthesize(Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]]), spec, hidden=0, verbose=False, proof_seconds=0.0)
    assert result.status == "certified" and not result.proof and "In floating point" in str(result)
