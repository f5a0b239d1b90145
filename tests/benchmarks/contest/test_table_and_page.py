"""Table and page are made from the same records, and say the same."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.contest.charts import draw_charts
from benchmarks.contest.page import page, write_page
from benchmarks.contest.reasons import why
from benchmarks.contest.record import UNSUITED, Entry
from benchmarks.contest.sample import NOWHERE, entry, record
from benchmarks.contest.settings import MEMORY, QUICK, SYNTHESIZED
from benchmarks.contest.sheets import Sheet
from benchmarks.contest.summary import sentences, summary
from benchmarks.contest.table import (
    HEADINGS,
    MEMORY_TITLE,
    WITH_MEMORY,
    cells,
    cost,
    memory_cells,
    progress_line,
    remembering,
    table,
)

GAIN, SAT = "best linear gain", "saturated LQR"
RECORDS = [
    record(1.2345678, {GAIN: 2.0, SAT: 1.2345678}, floor=1.1, plant="first"),
    record(None, {}, None, "second", entries=(entry(SYNTHESIZED, 3.0, certified=False, how="simulated", reason="pieces"),
                                             entry(GAIN, 4.0, limits="violated", certified=False),
                                             Entry(SAT, reason="a | b"), entry("clipped gain", 5.0))),
    record(None, {}, None, "third", entries=(), bounds=(), error="KeyError: 'x'"),
]


def rows_of_page(text: str) -> list[list[str]]:
    body = text[text.index("## Plants"):].splitlines()[4:]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in body[: len(RECORDS)]]


def test_table_and_page_have_the_same_cells():
    shown = table(RECORDS).splitlines()
    for record_, line, row in zip(RECORDS, shown[1:], rows_of_page(page(RECORDS)), strict=False):
        assert row == list(cells(record_)) and len(row) == len(HEADINGS)
        assert [part.strip() for part in line.split("  ") if part.strip()] == [cell for cell in cells(record_) if cell]


def test_table_and_page_have_the_same_sentences_and_reasons():
    shown, text = table(RECORDS), page(RECORDS)
    for one in sentences(summary(RECORDS)):
        assert one in shown and one in text
    for one in RECORDS:
        assert f"{one.plant}: {why(one)}" in shown and f"- {one.plant}: {why(one)}." in text


def test_the_page_begins_with_what_the_run_comes_to():
    assert page(RECORDS).splitlines()[:3] == ["# Results", "", f"- {sentences(summary(RECORDS))[0]}"]


def test_a_controller_that_does_not_apply_is_not_on_the_page_and_one_that_was_not_found_has_a_line():
    made = record(1.0, {GAIN: 2.0}, plant="x")
    text = page([replace(made, entries=(*made.entries, Entry("LQG", kind=UNSUITED, reason="sees all"),
                                        Entry("MPC", reason="no box"), Entry("clipped gain", reason="no box. Try one."),
                                        entry("scaled LQR", 3.0, certified=False, how="simulated", reason="too slow")))])
    details = text[text.index("### x"):]
    assert "LQG" not in details and "- MPC, clipped gain: no box" in details and "| MPC |" not in details
    assert "| scaled LQR |" in details and "- scaled LQR: too slow" in details


def test_laws_with_memory_have_a_table_of_their_own():
    made = record(2.0, {"MPC": 1.6}, floor=1.0, plant="blind")
    both = [replace(made, entries=(*made.entries, entry(MEMORY, 1.5, order=2, gap=0.5))), replace(made, sizes=(1, 1, 1))]
    assert remembering(both) == both[:1]
    row = memory_cells(both[0])
    assert len(row) == len(WITH_MEMORY) and row[WITH_MEMORY.index("MPC"):][:2] == ("1.6", "6.25 %")
    assert "| " + " | ".join(row) + " |" in page(both) and MEMORY_TITLE in table(both)
    assert MEMORY_TITLE not in page(RECORDS[:1])


def test_the_page_says_where_the_seconds_went():
    stages = {"judging": 3.0, "bounds": 4.0, "synthesis, in all (wall)": 9.0, "in all": 8.0}
    text = page([replace(RECORDS[0], stages=stages)] * 2)
    assert "16 s for all plants together: bounds 8, judging 6." in text


def test_the_page_says_versions_machine_date_and_budgets():
    text = page([*RECORDS, replace(RECORDS[0], settings=QUICK, environment=replace(NOWHERE, cores=64))])
    for words in ("numpy 2.0.0", "commit abc", "2 cores, 8 GiB", "64 cores", "2000-01-01 00:00 UTC", "Seed 0; 8 hidden",
                  "Seed 0; 4 hidden", "12 s for all plants together."):
        assert words in text


@pytest.mark.parametrize(("known", "shown"), [
    ({}, "1.234566"), ({"how": "simulated", "certified": False}, "~1.2346"), ({"certified": False}, "?1.234566"),
    ({"limits": "violated", "certified": False}, "!1.2346")])
def test_costs_are_marked_by_how_they_are_known(known, shown: str):
    assert cost(entry("x", 1.23456555, **known)).startswith(shown)


def test_a_certified_cost_is_rounded_up_and_a_bound_down():
    row = cells(record(1.23456711, {}, floor=1.23456789))
    assert row[3] == "1.234568" and row[2] == "1.234567"


def test_words_of_a_reason_do_not_break_the_page():
    assert "a \\| b" in page(RECORDS)


def test_sheets_of_other_commands_are_shown_as_they_were_printed():
    text = page(RECORDS, [Sheet("paper", "figure  printed\nP  1.3006", replace(NOWHERE, date="2001-02-03"))])
    assert "## `python -m benchmarks paper`" in text and "2001-02-03" in text
    assert "```\nfigure  printed\nP  1.3006\n```" in text


def test_pictures_are_linked_from_where_the_page_is(tmp_path):
    draw_charts(RECORDS, tmp_path / "out")
    text = write_page(tmp_path / "docs" / "RESULTS.md", RECORDS, (), tmp_path / "out").read_text()
    for name in ("costs.png", "wins.png", "times.png"):
        assert f"](../out/{name})" in text and (tmp_path / "out" / name).stat().st_size > 5_000
    assert "](" not in write_page(tmp_path / "alone.md", RECORDS, (), tmp_path / "nowhere").read_text()


def test_a_progress_line_says_what_failed():
    assert progress_line(RECORDS[2], 3, 3) == "[3/3] third: FAILED, KeyError: 'x'; 3.0 s"
    assert "not certified, simulated" in progress_line(RECORDS[1], 2, 3)
