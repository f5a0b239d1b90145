"""Why nothing is won: each reason from the record that has it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.contest.reasons import why
from benchmarks.contest.record import Entry
from benchmarks.contest.sample import entry, record
from benchmarks.contest.settings import SYNTHESIZED

GAIN, SAT = "best linear gain", "saturated LQR"


def test_a_competitor_that_is_certified_to_cost_less_is_said():
    made = record(1.0, {GAIN: 2.0, SAT: 1.1})
    better = replace(made, entries=(*made.entries, entry("LQG", 0.9), entry("MPC", 0.75, order=2, how="upper bound")))
    assert why(better) == "the MPC, which has a state of its own, is certified to cost 25 % less"
    doubtful = replace(made, entries=(*made.entries, entry("MPC", 0.75, certified=False), entry("LQG", 0.99995)))
    assert why(doubtful) == ""


def test_where_all_is_won_there_is_nothing_to_say():
    assert why(record(1.0, {GAIN: 2.0, SAT: 1.1})) == ""


def test_a_regulator_at_the_bound_leaves_nothing_to_win():
    assert why(record(1.0000011, {GAIN: 2.0, SAT: 1.0000011}, floor=1.0)) == (
        "the saturated LQR is within 0.00011 % of the bound on any controller: nothing left to win")


def test_a_tie_far_above_the_bound_says_how_much_is_left_at_most():
    assert why(record(1.2, {GAIN: 2.0, SAT: 1.2}, floor=1.0)) == (
        "no law was found that costs less than the saturated LQR; at most 20 % is left to win")
    assert "no lower bound says" in why(record(1.2, {GAIN: 2.0, SAT: 1.2}, floor=None))


def test_a_defeat_is_said_with_its_size():
    assert why(record(1.5, {GAIN: 1.25, SAT: 2.0}, floor=1.0)) == (
        "it costs 20 % more than the best linear gain; at most 50 % is left to win; "
        "the best linear gain is certified to cost 16.6 % less")


@pytest.mark.parametrize(("own", "words"), [
    (entry(SYNTHESIZED, 1.0, certified=False, reason="too many pieces"), "not certified: too many pieces"),
    (entry(SYNTHESIZED, None, certified=False, reason="InfeasibleError: no"), "not certified: InfeasibleError: no"),
    (Entry("LQG"), "no law was synthesized")])
def test_without_a_certificate_its_reason_is_said(own: Entry, words: str):
    assert why(record(None, {}, entries=(own, entry(SAT, 2.0)))) == words


def test_a_failure_is_said():
    assert why(record(None, {}, error="KeyError: 'x'")) == "the measurement failed: KeyError: 'x'"


def test_a_missing_rival_is_said_with_its_reason():
    made = record(1.0, {SAT: 2.0})
    assert "there is no best linear gain: no gain stabilizes" in why(
        replace(made, entries=(*made.entries, Entry(GAIN, reason="no gain stabilizes"))))
    assert len(why(replace(made, entries=(*made.entries, Entry(GAIN, reason="word " * 500))))) < 400
