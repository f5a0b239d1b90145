"""What a run comes to, counted on records made by hand."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.contest.record import UNSUITED, Entry
from benchmarks.contest.sample import entry, record
from benchmarks.contest.settings import MEMORY, SYNTHESIZED
from benchmarks.contest.shares import above, won
from benchmarks.contest.summary import sentences, summary

GAIN, SAT = "best linear gain", "saturated LQR"
RECORDS = [
    record(1.0, {GAIN: 2.0, SAT: 1.0}, plant="a"),                       # 50 %, the same
    record(None, {}, plant="b", entries=(entry(SYNTHESIZED, 0.9, beats=("static",)), entry(GAIN, 1.0),
                                         entry(SAT, 1.2))),             # 10 %, 25 %
    record(0.8, {GAIN: 1.0, SAT: 0.7}, plant="c"),                       # 20 %, costs more
    record(None, {}, plant="d", entries=(entry(SYNTHESIZED, 1.0, certified=False, how="simulated"),
                                         entry(GAIN, 9.0))),             # no saturated law
    record(None, {}, plant="e", entries=(entry(SYNTHESIZED, 1.0, proved=True, beats=("linear", "static")),
                                         Entry(GAIN, reason="no gain stabilizes"), entry(SAT, 2.0, how="upper bound"))),
    record(None, {}, plant="f", entries=(), error="TimeoutError: given up"),
]


def test_counts():
    found = summary(RECORDS)
    assert (found.plants, found.certified, found.proved, found.linear, found.failed) == (6, 4, 1, 1, 1)
    gain, saturated = found.gain, found.saturated
    assert (gain.won, gain.same, gain.lost, gain.open, gain.absent, gain.decided) == (3, 0, 0, 2, 1, 3)
    assert (saturated.won, saturated.same, saturated.lost, saturated.open, saturated.absent) == (1, 1, 1, 2, 1)
    assert found.static == ((SAT, 1),) and found.remembering == () and found.memory is None
    assert gain.shares == pytest.approx((0.5, 0.1, 0.2)) and saturated.shares == pytest.approx((0.25,))


def test_sentences_say_the_counts_median_and_most():
    said = sentences(summary(RECORDS))
    assert said[0] == "The synthesized INC, a static law, is certified on 4 of 6 plants (1 settled rigorously)."
    assert said[1].endswith("on 3 of 3 plants, by 20 % in the median and 50 % at most.")
    assert said[2].endswith("on 1 of 3 plants, by 25 % in the median and 25 % at most, the same on 1, more on 1.")
    assert said[3] == "A static competitor is certified to cost less than it on 1: the saturated LQR on 1."
    assert said[4].startswith("On 1 it is proved") and "Nothing is known of 1" in said[6]


def test_laws_with_memory_are_counted_apart():
    def blind(own: Entry, **rivals: float):
        made = record(1.0, {GAIN: 2.0, SAT: 1.1})
        others = [entry(name.replace("_", " "), cost, order=2) for name, cost in rivals.items()]
        return replace(made, entries=(*made.entries, own, *others))

    records = [blind(entry(MEMORY, 0.5, order=2, proved=True), saturated_LQG=1.0, MPC=0.5),
               blind(entry(MEMORY, 0.9, order=2), saturated_LQG=0.6, MPC=0.8),
               blind(entry(MEMORY, 0.9, certified=False, how="simulated")),
               blind(Entry(MEMORY, kind=UNSUITED))]
    records[3] = replace(records[3], sizes=(1, 1, 1))
    found = summary(records)
    memory = found.memory
    assert (memory.plants, memory.certified, memory.proved) == (3, 2, 1) and memory.stronger == (("saturated LQG", 1),)
    counts = {name: (one.won, one.same, one.lost) for name, one in memory.duels}
    assert counts == {"saturated LQG": (1, 0, 1), "MPC": (0, 1, 1), "best dynamic linear": (0, 0, 0), SYNTHESIZED: (2, 0, 0)}
    assert found.static == () and found.remembering == (("MPC", 1), ("saturated LQG", 1))
    said = sentences(found)
    assert said[6] == ("The synthesized INC with memory is certified on 2 of 3 plants whose state is not wholly measured "
                       "(1 settled rigorously).")
    assert said[7].startswith("It costs less than the saturated LQG on 1 of 2 plants, by 50 % in the median")
    assert said[7].endswith("than the static INC on 2 of 2 plants, by 30 % in the median and 50 % at most.")
    assert said[8] == "A competitor is certified to cost less than it on 1: the saturated LQG on 1."


def test_a_contradiction_is_loud():
    assert not any("INCONSISTENT" in one for one in sentences(summary(RECORDS)))
    wrong = [replace(RECORDS[0], inversions=("a cost below a bound",)), *RECORDS[1:]]
    assert sentences(summary(wrong))[-1].startswith("INCONSISTENT: 1")


def test_the_empty_run_has_sentences():
    assert sentences(summary([]))[0].startswith("The synthesized INC, a static law, is certified on 0 of 0 plants")


def test_what_is_won_is_rounded_down_and_what_is_left_up():
    assert won(0.19999) == "19.9 %" and won(1 - 2 / 2.5) == "20 %" and won(-0.5) == "-50 %"
    assert above(0.1201) == "13 %" and above(1.0) == "100 %" and above(12.0) == "1200 %"
