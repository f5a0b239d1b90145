"""Who beats whom: only certified costs against costs that are known exactly decide."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.contest.duels import ABSENT, LOSES, OPEN, TIES, WINS, duel, gain_duel, saturated_duel
from benchmarks.contest.record import Entry, PlantRecord
from benchmarks.contest.sample import entry, record
from benchmarks.contest.settings import SYNTHESIZED


def against(cost: float, rival: Entry) -> PlantRecord:
    return record(None, {}, entries=(entry(SYNTHESIZED, cost), rival))


@pytest.mark.parametrize(("cost", "outcome"), [
    (1.9, WINS), (1.9997, WINS), (1.9999, TIES), (2.0, TIES), (2.0001, TIES), (2.0003, LOSES), (5.0, LOSES)])
def test_a_difference_below_a_hundredth_of_a_per_cent_is_none(cost: float, outcome: str):
    assert duel(record(cost, {"LQG": 2.0}), "LQG").outcome == outcome


def test_the_share_is_that_of_the_rival_s_cost():
    assert duel(record(1.5, {"LQG": 2.0}), "LQG").share == pytest.approx(0.25)


@pytest.mark.parametrize(("known", "reason"), [
    ({"how": "upper bound"}, "only an upper bound"), ({"certified": False}, "no certified cost"),
    ({"how": "simulated", "certified": False}, "no certified cost"),
    ({"limits": "violated", "certified": False}, "breaks the input limits")])
def test_a_rival_whose_cost_is_not_known_from_below_decides_nothing(known, reason: str):
    found = duel(against(1.0, entry("LQG", 2.0, **known)), "LQG")
    assert found.outcome == OPEN and found.share is None and reason in found.reason


def test_a_lyapunov_cost_is_an_exact_one():
    assert duel(against(1.0, entry("LQG", 2.0, how="Lyapunov")), "LQG").outcome == WINS


def test_an_upper_bound_on_the_own_cost_is_enough_to_win():
    made = record(None, {}, entries=(entry(SYNTHESIZED, 1.0, how="upper bound"), entry("LQG", 2.0)))
    assert duel(made, "LQG").outcome == WINS


def test_without_a_certificate_of_its_own_nothing_is_won():
    made = record(1.0, {"LQG": 2.0})
    doubtful = replace(made, entries=(replace(made.entries[0], certified=False, how="simulated"), made.entries[1]))
    assert duel(doubtful, "LQG").outcome == OPEN
    assert duel(replace(made, entries=made.entries[1:]), "LQG").outcome == OPEN
    assert duel(replace(made, error="lost"), "LQG").reason == "lost"


def test_a_controller_that_there_is_not_is_absent_and_one_not_judged_is_open():
    assert duel(against(1.0, Entry("LQG", reason="all states are measured")), "LQG").outcome == ABSENT
    assert duel(against(1.0, Entry("LQG", "neural, 3 units", reason="too late")), "LQG").outcome == OPEN


def test_the_clipped_gain_stands_in_where_there_is_no_saturated_regulator():
    made = record(None, {}, entries=(entry(SYNTHESIZED, 1.0), Entry("saturated LQR", reason="outputs"),
                                     entry("clipped gain", 2.0)))
    assert saturated_duel(made).rival == "clipped gain" and saturated_duel(made).outcome == WINS
    both = record(1.0, {"clipped gain": 0.5, "saturated LQR": 2.0})
    assert saturated_duel(both).rival == "saturated LQR" and saturated_duel(both).outcome == WINS


def test_a_clipped_gain_that_was_not_judged_is_open_and_not_absent():
    own, none = entry(SYNTHESIZED, 1.0), Entry("saturated LQR", reason="outputs")
    found = saturated_duel(record(None, {}, entries=(own, none, Entry("clipped gain", "INC", reason="too late"))))
    assert found.outcome == OPEN and found.rival == "clipped gain" and "too late" in found.reason
    both = saturated_duel(record(None, {}, entries=(own, none, Entry("clipped gain", reason="no gain stabilizes"))))
    assert both.outcome == ABSENT and "outputs" in both.reason and "no gain stabilizes" in both.reason


def test_the_gain_is_the_best_linear_one():
    assert gain_duel(record(1.0, {"saturated LQR": 0.5, "best linear gain": 2.0})).outcome == WINS
