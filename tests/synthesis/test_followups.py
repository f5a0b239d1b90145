"""Each cause of a refusal leads to the retry that helps against it, and no attempt is made twice."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from inc_casadi import INC, Box, Ellipsoid, Gaussian, Plant, ReLU, Spec, Tanh
from synthesis.attempts import AS_IT_IS, CERTIFIED, TRAINED, Task, attempt, plan
from synthesis.causes import Cause
from synthesis.followups import Done, best_certified, explorations, improvements, repairs
from synthesis.gate import Verdict
from synthesis.result import Attempt

PLANT = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]], [[1.0, 1.0]])
SPEC = Spec(np.eye(2), [[0.05]], 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box([-1.0], [1.0]))
TASK = Task("random", TRAINED, PLANT, SPEC, 6, ReLU(), 0.9, 3, 1.0)


def refused(task, *causes, inc=None):
    return Done(task, Attempt(task.name, inc, Verdict(None, np.inf, (), (), causes), None, 0.0, inner=inc))


def accepted(task, cost, inner=None):
    return Done(task, Attempt(task.name, inner, Verdict(object(), cost, (), ()), None, 0.0, inner=inner))


@pytest.mark.parametrize(("cause", "task", "expected"), [
    (Cause.ILL_POSED, TASK, {"kappa": pytest.approx(0.72)}),
    (Cause.UNSTABLE, TASK, {"start": "stabilizing gain", "way": TRAINED}),
    (Cause.LOST, TASK, {"horizon": 30, "start": "random"}),
    (Cause.LOST, replace(TASK, start="clipped gain", way=AS_IT_IS), {"start": "halfway gain", "way": AS_IT_IS}),
    (Cause.LOST, replace(TASK, start="halfway gain", way=AS_IT_IS), {"start": "certified linear"}),
    (Cause.PIECES, TASK, {"hidden": 3, "kappa": pytest.approx(0.72)}),
    (Cause.TIME, replace(TASK, start="clipped gain", way=AS_IT_IS), {"start": "halfway gain"}),
    (Cause.LIMITS, TASK, {"shrunk": True}),
    (Cause.KINK, TASK, {"seed": 4}),
    (Cause.SMOOTH, replace(TASK, activation=Tanh()), {"activation": ReLU()}),
], ids=lambda value: value.name if isinstance(value, Cause) else "")
def test_each_cause_has_its_remedy(cause, task, expected):
    one = refused(task, cause, Cause.HOPELESS)
    (retry,) = repairs([one], [one])
    assert {name: getattr(retry, name) for name in expected} == expected
    assert (retry.of, retry.why) == (task.name, cause.value) and retry.name != task.name


def test_the_first_cause_that_something_helps_against_counts():
    one = refused(TASK, Cause.HOPELESS, Cause.KINK)
    assert repairs([one], [one])[0].why == Cause.KINK.value


@pytest.mark.parametrize("task, cause", [
    (TASK, Cause.HOPELESS), (replace(TASK, hidden=1), Cause.PIECES), (TASK, Cause.SMOOTH),
    (replace(TASK, shrunk=True), Cause.LIMITS), (replace(TASK, way=AS_IT_IS, start="static gain"), Cause.LOST)])
def test_where_nothing_helps_nothing_is_tried(task, cause):
    one = refused(task, cause)
    assert repairs([one], [one]) == ()


def test_what_was_accepted_or_made_before_is_not_tried_again():
    first, second = refused(TASK, Cause.KINK), refused(replace(TASK, seed=4, label="seed 4"), Cause.KINK)
    assert repairs([first, second], [first]) == ()
    assert repairs([accepted(TASK, 1.0)], [accepted(TASK, 1.0)]) == ()


def test_motions_that_are_lost_begin_again_at_the_best_certified_law():
    best = accepted(replace(TASK, start="static gain", way=AS_IT_IS), 2.0, INC.linear([[-2.0]]))
    lost = refused(TASK, Cause.LOST)
    (retry,) = repairs([best, lost], [lost])
    assert retry.law.q == 6 and retry.law([0.3]).item() == pytest.approx(-0.6) and retry.horizon == 30
    assert best_certified([best, lost]) is best


def test_shrunk_limits_are_what_training_sees():
    box = attempt(replace(TASK, shrunk=True, iterations=1)).inc
    assert np.max(np.abs(box(np.linspace(-9, 9, 50)[None]))) <= 0.98 + 1e-12


def test_a_refused_inequality_is_followed_by_the_certificate_and_a_bound_by_the_bmi_loop():
    spec = replace(SPEC, initial=Gaussian([0.0, 0.0], np.eye(2)), inputs=None)
    task = replace(TASK, plant=Plant(0.8 * PLANT.A, PLANT.B, PLANT.C), spec=spec, start="static gain", way=AS_IT_IS)
    law = INC([[0.1]], [[1.0]], [[0.3]], [[-0.2]])
    no = refused(task, Cause.HOPELESS, Cause.UNCERTIFIED, inc=law)
    (retry,) = repairs([no], [no])
    assert retry.way == CERTIFIED and retry.law is law
    yes = Done(task, attempt(task))
    (better,) = improvements([yes])
    assert better.way == CERTIFIED and better.of == task.name
    assert improvements([accepted(TASK, 1.0)]) == () == improvements([no])


def test_a_law_whose_limits_are_not_built_in_is_not_retrained_with_a_certificate():
    no = refused(TASK, Cause.UNCERTIFIED, inc=INC.linear([[-1.0]]))
    assert repairs([no], [no]) == ()


def test_explorations_bring_other_starts_first_and_then_seeds_and_units():
    best = accepted(TASK, 2.0, INC.linear([[-2.0, -0.5]]))
    state = replace(TASK, start="", plant=Plant(0.8 * PLANT.A, PLANT.B))
    first = explorations([best], state, 1)
    assert [task.name for task in first[:4]] == ["MPC", "sector inequality", "explicit MPC", "compressed MPC, trained"]
    assert first[4].seed == 4 and first[5].law.q == 6 and first[5].of == TASK.name
    later = explorations([best], state, 2)
    assert [task.seed for task in later] == [5, 5]
    assert not any(task.way == TRAINED for task in explorations([best], replace(state, hidden=0), 1))


@pytest.mark.parametrize("change", [
    {"plant": PLANT},  # measured output
    {"spec": replace(SPEC, inputs=None)}, {"spec": replace(SPEC, R=[[0.0]])}])
def test_a_start_that_is_sure_to_be_refused_is_no_attempt(change):
    task = replace(TASK, start="", plant=Plant(0.8 * PLANT.A, PLANT.B))
    names = [one.start for one in explorations([], replace(task, **change), 1)]
    assert "random" in names and not any("MPC" in name for name in names)


def test_the_sector_inequality_is_tried_just_where_the_open_loop_has_a_cost():
    for share in (0.8, 1.0):  # PLANT is unstable
        task = replace(TASK, start="", plant=Plant(share * PLANT.A, PLANT.B))
        assert ("sector inequality" in [one.start for one in explorations([], task, 1)]) == (share < 1)


def test_a_law_that_grew_twice_is_named_after_its_root():
    best = accepted(TASK, 2.0, INC.linear([[-2.0]]))
    grown = explorations([best], replace(TASK, start=""), 1)[-1]
    again = explorations([accepted(grown, 1.5, grown.law)], replace(TASK, start=""), 2)[-1]
    assert grown.start == again.start == f"from ({TASK.name})" and again.of == grown.name != again.name


def test_a_seldom_clipped_gain_is_tried_where_pieces_give_no_expected_cost():
    ball = replace(TASK, start="", spec=replace(SPEC, initial=Ellipsoid(4 * np.eye(2))))
    assert explorations([], ball, 1)[0].name == "seldom clipped gain"
    many = Plant(0.8 * np.eye(9), np.ones((9, 1)))
    spec = Spec(np.eye(9), 1.0, 0.95, Box(-np.ones(9), np.ones(9)), Box(-1, 1))
    names = [task.name for task in plan(many, spec, 0, ReLU(), 0.9, 0, 1.0)]
    assert names == ["seldom clipped gain", "clipped LQR"]
    assert "seldom clipped gain" not in [task.name for task in plan(PLANT, SPEC, 0, ReLU(), 0.9, 0, 1.0)]


def test_a_largest_cost_is_no_end_of_the_search():
    """With nine states exact pieces state the largest cost only, so a gain that is clipped less often is tried."""
    loose = SimpleNamespace(accepted=True, settled=False)
    one = Done(replace(TASK, start="static gain", way=AS_IT_IS), SimpleNamespace(verdict=loose, certified=True))
    (retry,) = repairs([], [one])
    assert retry.start == "seldom clipped gain" and "loosely" in retry.why
