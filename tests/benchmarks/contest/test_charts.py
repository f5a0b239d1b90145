"""The charts: marks where the records have them, all certified ones full, bars that count every plant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.contest.charts import SMALLEST, cost_chart, time_chart, wins_chart
from benchmarks.contest.record import Entry
from benchmarks.contest.sample import entry, record
from benchmarks.contest.settings import MEMORY, SYNTHESIZED

RECORDS = [
    record(1.5, {"LQG": 2.0}, plant="first"),
    record(1.0, {"LQG": 1.0}, plant="second"),
    record(None, {}, plant="third", entries=(entry(SYNTHESIZED, 3.0, certified=False, how="simulated"),
                                             entry("LQG", 9.0, limits="violated", certified=False))),
    record(1.0, {"LQG": 2.0}, floor=None, plant="fourth"),
]


def marks(axes) -> list[tuple[float, float, bool]]:
    return [(float(x), float(y), len(one.get_facecolor()) > 0) for one in axes.collections for x, y in one.get_offsets()]


def test_marks_stand_at_the_share_above_the_bound():
    [axes] = cost_chart(RECORDS).axes
    found = sorted((round(y), x, full) for x, y, full in marks(axes))
    shares = [(row, pytest.approx(x), full) for row, x, full in
              ((0, 50.0, True), (0, 100.0, True), (1, 100 * SMALLEST, True), (1, 100 * SMALLEST, True), (2, 200.0, False))]
    assert found == shares  # none that breaks the limits, none without a bound
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["first", "second", "third", "fourth"]


def test_every_controller_is_in_the_legend_once():
    [legend] = cost_chart(RECORDS).legends
    assert [text.get_text() for text in legend.get_texts()] == [SYNTHESIZED, "LQG"]


def test_without_any_bound_the_chart_says_so():
    [axes] = cost_chart([RECORDS[3]]).axes
    assert "no cost beside a lower bound" in axes.texts[0].get_text()


def test_bars_count_every_plant_once():
    missing = record(None, {}, plant="fifth", entries=(entry(SYNTHESIZED, 1.0), Entry("LQG", reason="none")))
    [axes] = wins_chart([*RECORDS, missing]).axes
    widths = [patch.get_width() for patch in axes.patches]
    assert widths == [2, 1, 0, 1, 1] and sum(widths) == 5


def test_laws_with_memory_have_bars_of_their_own():
    blind = record(1.5, {"LQG": 1.2}, entries=(entry(SYNTHESIZED, 1.5), entry(MEMORY, 1.0, order=2), entry("LQG", 1.2)))
    left, right = wins_chart([blind, RECORDS[1], replace(blind, sizes=(1, 1, 1))]).axes
    assert [text.get_text() for text in left.get_yticklabels()] == ["LQG"]
    assert [patch.get_width() for patch in left.patches] == [0, 1, 2, 0, 0]
    assert [patch.get_width() for patch in right.patches] == [1, 0, 0, 0, 0]


def test_times_have_a_bar_at_their_median():
    records = [replace(one, entries=tuple(replace(e, design=t) for e in one.entries))
               for one, t in zip(RECORDS, (1.0, 2.0, 4.0, 100.0), strict=True)]
    left, right = time_chart(records).axes
    assert {float(line.get_xdata()[0]) for line in left.lines} == {3.0}
    assert np.allclose([line.get_xdata()[0] for line in right.lines], 50.0)
    assert left.get_xlabel() == "time to design, s"


def test_nothing_is_drawn_of_nothing():
    for chart in (cost_chart, time_chart, wins_chart):
        assert chart([]).axes


def test_equal_costs_and_times_are_drawn_all_the_same():
    alone = record(1.0, {}, plant="alone")
    [axes] = cost_chart([alone]).axes
    low, high = axes.get_xlim()
    assert low < 100 * SMALLEST < high
    assert all(axes.get_xlim()[0] < axes.get_xlim()[1] for axes in time_chart([alone]).axes)
