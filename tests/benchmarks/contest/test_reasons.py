"""Why nothing is won: each reason from the record that has it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.contest.reasons import reasons, telling, why, why_with_memory
from benchmarks.contest.record import UNSUITED, Entry
from benchmarks.contest.sample import entry, record
from benchmarks.contest.settings import MEMORY, SYNTHESIZED

GAIN, SAT = "best linear gain", "saturated LQR"


def test_a_competitor_that_is_certified_to_cost_less_is_said():
    made = record(1.0, {GAIN: 2.0, SAT: 1.1}, floor=None)
    better = replace(made, entries=(*made.entries, entry("scaled LQR", 0.9), entry("MPC", 0.75, how="upper bound")))
    assert str(why(better)) == "the MPC is certified to cost 25 % less (no lower bound says what is left)"
    doubtful = replace(made, entries=(*made.entries, entry("MPC", 0.75, certified=False), entry("scaled LQR", 0.99995)))
    assert why(doubtful) is None


def test_a_competitor_with_memory_is_not_held_against_a_static_law():
    made = record(1.0, {GAIN: 2.0, SAT: 1.1})
    assert why(replace(made, entries=(*made.entries, entry("LQG", 0.5, order=2)))) is None


@pytest.mark.parametrize(("own", "words"), [
    (entry(MEMORY, 0.5, order=2), None), (entry(MEMORY, 0.7, order=2, gap=0.2), "the LQG is certified to cost 14.2 % less"),
    (entry(MEMORY, 0.6, order=2, gap=0.2), "it costs the same as the LQG (at most 20 % left)"),
    (entry(MEMORY, 0.5, certified=False, reason="too many pieces"), "not certified: too many pieces"),
    (Entry(MEMORY, kind=UNSUITED), None), (Entry(MEMORY, reason="nothing stabilizes"), "not certified: nothing stabilizes")])
def test_with_memory_every_competitor_is_comparable(own: Entry, words: str | None):
    made = record(1.0, {GAIN: 2.0, "MPC": 0.65})
    found = why_with_memory(replace(made, entries=(*made.entries, entry("LQG", 0.6, order=2), own)))
    assert (found is None) == (words is None) and str(found).startswith(str(words))


def test_plants_with_the_same_reason_share_a_line():
    ties = [record(cost, {GAIN: 2.0, SAT: cost}, floor=1.0, plant=name) for name, cost in (("a", 1.2), ("b", 1.125))]
    alone = record(1.0, {GAIN: 0.5, SAT: 2.0}, floor=0.4, plant="c")
    assert reasons([*ties, alone]) == [
        "no static law was found that costs less than the saturated LQR: a (at most 20 % left); b (at most 13 % left)",
        "c: it costs 100 % more than the best linear gain (at most 150 % left)"]


def test_a_contradiction_is_said_with_its_plant():
    made = record(1.0, {GAIN: 2.0, SAT: 1.1}, plant="a", inversions=("below its bound",))
    assert reasons([made]) == ["INCONSISTENT, a: below its bound"]


def test_of_a_long_reason_the_proof_is_said_and_no_advice():
    search = "static gain: no gain u = F y was found, from 6 starts; that is evidence, not proof. Try more starts."
    proof = "no static gain u = f y stabilizes this plant (all f), so no static law does: measure more, or give it memory"
    course = "cut short by a time limit: random; 2 attempts in 1 round; the time is over"
    assert telling(f"{search}; {proof}; {course}") == "no static gain u = f y stabilizes this plant (all f)"
    assert telling(f"{course}; {search}") == "static gain: no gain u = F y was found, from 6 starts"
    assert telling(course) == course and telling("") == "no reason is known"


def test_where_all_is_won_there_is_nothing_to_say():
    assert why(record(1.0, {GAIN: 2.0, SAT: 1.1})) is None


def test_a_regulator_at_the_bound_leaves_nothing_to_win():
    assert str(why(record(1.0000011, {GAIN: 2.0, SAT: 1.0000011}, floor=1.0))) == (
        "nothing left to win, for the saturated LQR is within 0.1 % of the bound on any controller (0.00011 % left)")


def test_a_tie_far_above_the_bound_says_how_much_is_left_at_most():
    assert str(why(record(1.2, {GAIN: 2.0, SAT: 1.2}, floor=1.0))) == (
        "no static law was found that costs less than the saturated LQR (at most 20 % left)")
    assert "no lower bound says" in str(why(record(1.2, {GAIN: 2.0, SAT: 1.2}, floor=None)))


def test_a_defeat_is_said_with_its_size():
    assert str(why(record(1.5, {GAIN: 1.25, SAT: 2.0}, floor=1.0))) == (
        "it costs 20 % more than the best linear gain (at most 50 % left)")


@pytest.mark.parametrize(("own", "words"), [
    (entry(SYNTHESIZED, 1.0, certified=False, reason="too many pieces"), "not certified: too many pieces"),
    (entry(SYNTHESIZED, None, certified=False, reason="InfeasibleError: no"), "not certified: InfeasibleError: no"),
    (Entry("LQG"), "no law was synthesized")])
def test_without_a_certificate_its_reason_is_said(own: Entry, words: str):
    assert str(why(record(None, {}, entries=(own, entry(SAT, 2.0))))) == words


def test_a_failure_is_said():
    assert str(why(record(None, {}, error="KeyError: 'x'"))) == "the measurement failed: KeyError: 'x'"


def test_a_missing_rival_is_said_with_its_reason():
    made = record(1.0, {SAT: 2.0})
    assert "there is no best linear gain: no gain stabilizes" in str(why(
        replace(made, entries=(*made.entries, Entry(GAIN, reason="no gain stabilizes")))))
    assert len(str(why(replace(made, entries=(*made.entries, Entry(GAIN, reason="word " * 500)))))) < 400
