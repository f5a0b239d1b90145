"""Measuring one plant: entries, bounds and reasons; a controller that fails in an odd way does not stop the others."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from math import isfinite

import numpy as np
import pytest

from benchmarks.baselines import saturated_lqr
from benchmarks.contest import entrants, evaluation, judging, measure
from benchmarks.contest import growth as growth_room
from benchmarks.contest.duels import OPEN, saturated_duel
from benchmarks.contest.evaluation import microseconds
from benchmarks.contest.growth import growth, hopeless
from benchmarks.contest.measure import digest_of, measured
from benchmarks.contest.record import UNSUITED, PlantRecord
from benchmarks.contest.settings import MEMORY, QUICK, SYNTHESIZED
from benchmarks.plants import scalar, two_state
from inc_casadi import INC, Box, Gaussian, Plant, Regional, ReLU, Saturation, Spec
from inc_casadi.bounds import any_controller
from inc_casadi.dynamic import certify_dynamic, observer
from inc_casadi.linear import LinearController
from inc_casadi.regional_certificate import certify_region
from synthesis.dynamic_result import DynamicResult
from synthesis.dynamic_storage import load_dynamic_result
from synthesis.storage import load_result

BRIEF = replace(QUICK, hidden=0, search=20.0, training=10.0, pieces=10.0, gains=0.3, cells=300)
BETA = 0.9


class Odd(Exception):
    """What some library might raise."""


def broken(case, seed):
    raise Odd("no such luck")


@pytest.fixture(scope="module")
def found() -> measure.Measured:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(measure, "GROWN", (SYNTHESIZED, "too large"))
        patch.setattr(entrants, "BASELINES", {
            "saturated LQR": lambda case, seed: saturated_lqr(case.plant, case.spec), "odd": broken,
            "no controller": lambda case, seed: object(), "gain": lambda case, seed: INC.linear([[-1.0]]),
            "too large": lambda case, seed: INC.linear([[-1.2]]),
            "dynamic": lambda case, seed: LinearController([[0.0]], [[1.0]], [[0.0]], [[-1.0]])})
        return measured("scalar", scalar(BETA), BRIEF)


@pytest.fixture(scope="module")
def record(found) -> PlantRecord:
    return found.record


def test_costs_are_those_of_the_theorems(record: PlantRecord):
    costs = {one.name: one.cost for one in record.entries}
    assert costs[SYNTHESIZED] == costs["saturated LQR"] == pytest.approx(1 / 3 + BETA / 36, rel=1e-7)
    assert costs["gain"] == pytest.approx(1 / (3 * (1 - BETA / 4)), rel=1e-7)
    assert costs["dynamic"] == pytest.approx(costs["gain"], rel=1e-7)
    assert record.bound("linear") == pytest.approx(1 / 3 + BETA / 12, rel=1e-6)
    own = record.entry(SYNTHESIZED)
    assert own.certified and own.proved and own.how == "exact" and own.beats == ("linear", "static")
    assert own.worst == pytest.approx(1 + BETA / 4, rel=1e-6) and own.units == 1


def test_a_controller_that_fails_in_an_odd_way_is_an_entry_with_the_reason(record: PlantRecord):
    assert record.entry("odd").kind == "not found" and record.entry("odd").reason == "Odd: no such luck"
    assert record.entry("no controller").cost is None and record.entry("no controller").reason
    assert record.error == "" and len(record.entries) == 8


def test_a_gain_that_breaks_the_limits_is_not_certified(record: PlantRecord):
    found = record.entry("too large")
    assert found.limits == "violated" and not found.certified
    assert found.factor is None  # it would hold from a smaller set, which is not asked


def test_times_are_measured(record: PlantRecord):
    for one in record.entries:
        if one.cost is not None:
            assert one.evaluation > 0 and isfinite(one.design) and one.design >= 0
    assert record.processor > record.entry(SYNTHESIZED).design > 0


def test_the_stages_say_where_the_seconds_went(record: PlantRecord):
    stages = {name: seconds for name, seconds in record.stages.items() if not name.endswith("(wall)")}
    assert set(stages) == {"synthesis", "synthesis with memory", "designs", "judging", "bounds", "evaluation", "growth",
                           "in all"}
    parts = sum(stages.values()) - stages["in all"]
    assert 0.6 * stages["in all"] < parts <= stages["in all"]
    assert stages["synthesis"] >= record.entry(SYNTHESIZED).design
    assert stages["judging"] >= sum(one.judged for one in record.entries) > 0


def test_a_law_that_was_judged_already_is_not_judged_again(record: PlantRecord):
    own, same = record.entry(SYNTHESIZED), record.entry("saturated LQR")
    assert judging.SAME in same.reason and same.certified and same.judged < 0.02 + own.judged
    assert (same.cost, same.worst, same.how) == (own.cost, own.worst, own.how)


@pytest.mark.parametrize("other", [[[-1.2]], [[-1.5], [0.0]]])
def test_laws_of_other_numbers_are_others(other):
    law = INC.saturated([[-1.5]], 1.0)
    assert judging.same_law(law, INC.saturated([[-1.5]], 1.0)) and not judging.same_law(law, INC.linear([[-1.5]]))
    assert not judging.same_law(law, INC.saturated([[-1.5]], 2.0)) and not judging.same_law(law, INC.saturated(other, 1.0))
    assert not judging.same_law(law, replace(law, activation=ReLU()))


def remembering(*args, **options):
    """The clipped gain of an observer's estimate, with its certificate."""
    plant, spec = args
    law = observer(plant, [[1.5], [0.5]], INC.saturated([[-0.5, -1.0]], 1.0), spec.initial.mean)
    claim = Regional(spec.initial, spec.inputs, spec.Q, spec.R, spec.discount)
    return DynamicResult(plant, spec, law, certify_dynamic(plant, law, claim), None, None, {}, (), ("made here",), {})


def hidden():
    plant = Plant([[0.9, 1.0], [0.0, 0.5]], [[0.0], [1.0]], [[1.0, 0.0]])
    spec = Spec(np.eye(2), 0.1, BETA, Box([-1.0, -1.0], [1.0, 1.0]), Box(-1, 1))
    return scalar(BETA)._replace(plant=plant, spec=spec)


@pytest.fixture(scope="module")
def blind() -> measure.Measured:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(entrants, "synthesize_dynamic", remembering)
        return measured("hidden", hidden(), replace(BRIEF, only=(MEMORY,)))


def test_the_file_of_a_law_with_memory_holds_its_certificate(blind: measure.Measured, tmp_path):
    path = tmp_path / "law.json"
    path.write_text(blind.memory)
    saved = load_dynamic_result(path)
    assert blind.law == "" and saved.certificate.holds() and saved.certificate.bound == blind.record.entry(MEMORY).cost


def test_what_is_not_measured_raises_the_bound_on_any_controller(blind: measure.Measured):
    case = hidden()
    assert blind.record.bound("any") > 1.001 * float(any_controller(case.plant, case.spec, cells=BRIEF.cells))


def test_a_law_with_memory_is_judged_by_its_own_certificate(blind: measure.Measured):
    [own] = blind.record.entries
    assert own.certified and own.order == 2 and own.how == "exact" and own.units == 1 and own.reason == "made here"
    case = hidden()
    x, xi, total = case.spec.initial.sample(4000, np.random.default_rng(1)), np.zeros((2, 4000)), 0.0
    law = remembering(case.plant, case.spec).dynamic
    for step in range(200):
        u = law.law(np.vstack([case.plant.C @ x, xi]))
        stage = np.sum(x * x, axis=0) + 0.1 * u[0] ** 2
        total = total + BETA**step * stage
        x, xi = case.plant.A @ x + case.plant.B @ u[:1], u[1:]
    assert own.cost == pytest.approx(np.mean(total), rel=0.03) and own.worst >= np.max(total)


def test_where_the_state_is_measured_no_law_with_memory_is_synthesized(record: PlantRecord):
    own = record.entry(MEMORY)
    assert own.kind == UNSUITED and own.cost is None and "measures its full state" in own.reason


def test_a_certificate_that_does_not_hold_certifies_no_law_with_memory(monkeypatch):
    def shaky(*args, **options):
        found = remembering(*args)
        claim = replace(found.certificate.claim, inputs=Box(-1e-3, 1e-3))
        return replace(found, certificate=replace(found.certificate, claim=claim))

    monkeypatch.setattr(entrants, "synthesize_dynamic", shaky)
    monkeypatch.setattr(judging, "floors", lambda case, settings, known: ())
    [own] = measured("hidden", hidden(), replace(BRIEF, only=(MEMORY,))).record.entries
    assert not own.certified


def test_the_set_may_grow_until_the_input_cannot_hold_the_state(record: PlantRecord):
    own = record.entry(SYNTHESIZED)
    assert 1.95 < own.factor < 2.0 <= own.refuted < 2.05  # 1.5 x - 1 = x at x = 2
    assert record.entry("gain").factor is None


def test_the_law_s_file_holds_its_certificate(found, tmp_path):
    path = tmp_path / "law.json"
    path.write_text(found.law)
    saved = load_result(path)
    assert saved.holds() and saved.certificate.bound == found.record.entry(SYNTHESIZED).cost


def test_when_the_time_is_over_nothing_more_is_begun():
    made = measured("scalar", scalar(BETA), replace(BRIEF, limit=1e-9, only=(SYNTHESIZED, "saturated LQR"))).record
    own, other = made.entries
    assert own.certified and own.evaluation is None and own.factor is None
    assert other.cost is None and "time for this plant was over" in other.reason
    assert other.kind == "not tried" and other.design < 0.01 and saturated_duel(made).outcome == OPEN


def test_what_is_not_wanted_is_not_measured():
    made = measured("scalar", scalar(BETA), replace(BRIEF, only=("saturated LQR",))).record
    assert [one.name for one in made.entries] == ["saturated LQR"]
    assert made.bound("any") is not None and made.entries[0].gap < 1e-3


def test_the_digest_tells_problems_apart():
    case = scalar(BETA)
    assert digest_of(case) == digest_of(scalar(BETA)) != digest_of(case._replace(spec=replace(case.spec, R=[[0.2]])))


def test_growth_is_unknown_for_controllers_with_memory_and_for_unbounded_sets():
    case = two_state()
    memory = LinearController([[0.0]], [[1.0, 0.0]], [[0.0]], [[-1.0, -2.0]])
    assert growth(case, memory, 1.0) == (None, None)
    unbounded = case._replace(spec=replace(case.spec, initial=Gaussian([0, 0], [[1, 0], [0, 1]]), inputs=None))
    assert growth(unbounded, INC.linear([[-1.0, -2.0]]), 1.0) == (None, None)


def test_a_set_that_may_grow_without_end_is_refuted_nowhere():
    case = scalar(BETA)._replace(plant=Plant(0.5, 1.0))
    assert growth(case, INC.saturated([[-0.1]], 1.0), 5.0) == (256.0, None)


def test_a_gain_on_a_plant_of_many_states_has_its_exact_cost(monkeypatch):
    n, lags = 9, np.linspace(0.1, 0.5, 9)
    spec = Spec(np.eye(n), 0.1, 0.9, Box(-np.ones(n), np.ones(n)), Box(-1, 1))
    case = scalar(BETA)._replace(plant=Plant(np.diag(lags), np.zeros((n, 1))), spec=spec)
    monkeypatch.setattr(entrants, "BASELINES", {"gain": lambda case, seed: INC.linear([[-0.01] * n])})
    monkeypatch.setattr(judging, "floors", lambda case, settings, known: ())
    [entry] = measured("lags", case, replace(BRIEF, only=("gain",), region=0.0)).record.entries
    state, input_ = np.sum(1 / (1 - BETA * lags**2)) / 3, 0.1 * 0.01**2 * np.sum(1 / (1 - BETA * lags**2)) / 3
    assert entry.certified and entry.how == "Lyapunov" and entry.cost == pytest.approx(state + input_, rel=1e-7)


@pytest.mark.parametrize(("refuted", "said"), [(1.5, 1.5), (0.9, None), (np.inf, None)])
def test_a_motion_from_within_the_certified_set_refutes_nothing(monkeypatch, refuted: float, said: float | None):
    witness = None if np.isinf(refuted) else np.array([1.0])
    found = Namespace(factor=0.1, refuted=refuted, witness=witness)
    monkeypatch.setattr(growth_room, "largest_scale", lambda *a, **k: found)
    assert growth(scalar(BETA), INC.linear([[-1.0]]), 1.0) == (1.0, said)  # it is certified from the set itself


def test_a_law_that_rests_elsewhere_fails_only_where_its_motions_part():
    law = INC([[0.0]], [[-1.4]], [[1.0]], [[0.0]], [0.05], activation=Saturation())  # rests where 1.5 x + u = x, x = -2 u
    factor, refuted = growth(scalar(BETA), law, 1.0)
    assert 1.9 < factor < 2.0 <= refuted < 2.05


def test_growth_is_not_tried_where_the_set_itself_takes_many_pieces(monkeypatch):
    plant, spec, _ = scalar(BETA)
    found = certify_region(plant, INC.saturated([[-1.5]], 1.0), Regional(spec.initial, spec.inputs, spec.Q, spec.R))
    assert hopeless(found) == "" and hopeless(object())
    monkeypatch.setattr(growth_room, "MANY", 1)
    assert hopeless(found) == f"the set itself takes {len(found.walk.arrived)} pieces, more than 1"


@pytest.mark.parametrize("law", [INC.saturated([[-1.0, -2.0]], 1.0),
                                 LinearController([[0.0]], [[1.0, 0.0]], [[0.0]], [[-1.0, -2.0]])])
def test_the_time_of_one_input_is_that_of_a_round_over_its_inputs(law, monkeypatch):
    seen = []

    def timed(work, times):
        work()
        return 1.0, 2e-3

    def spied(controller):
        given = as_it_is(controller)
        return lambda y: (seen.append(np.shape(y)), given(y))

    as_it_is = evaluation._law
    monkeypatch.setattr(evaluation, "repeated", timed)
    monkeypatch.setattr(evaluation, "_law", spied)
    plant, spec, _ = two_state()
    assert microseconds(plant, spec, law) == pytest.approx(100.0)  # 2 ms over 20 inputs
    assert seen == [(2,)] * evaluation.POINTS
