"""Files: what is written is read again, the CSV says the same as the JSON, an interruption leaves no half of a file."""

from __future__ import annotations

import csv
import json
import os

import pytest

from benchmarks.contest.files import COLUMNS, csv_rows, read_record, read_records, slug, write_record, write_tables
from benchmarks.contest.record import from_plain
from benchmarks.contest.sample import entry, record
from benchmarks.plants import suite
from inc_casadi.errors import FormatError

RECORDS = [record(1.0 / 3.0, {"LQG": 2.5}, plant="two lags, output"),
           record(None, {}, None, "car", error='X: lost, "all"\nof it')]


def test_records_are_read_in_the_order_of_the_suite(tmp_path):
    for one in RECORDS:
        write_record(tmp_path, one, law="{}")
    assert read_records(tmp_path, tuple(suite())) == RECORDS
    assert read_records(tmp_path, ("car",)) == RECORDS[::-1]


def test_all_records_together_are_the_same_as_one_by_one(tmp_path):
    together, _ = write_tables(tmp_path, RECORDS)
    assert [from_plain(one) for one in json.loads(together.read_text())] == RECORDS


def test_the_csv_gives_back_every_figure(tmp_path):
    _, path = write_tables(tmp_path, RECORDS)
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert rows == [{key: str(value) for key, value in row.items()} for row in csv_rows(RECORDS)]
    assert list(rows[0]) == list(COLUMNS) and [row["name"] for row in rows] == ["synthesized INC", "LQG", ""]
    assert float(rows[0]["cost"]) == 1.0 / 3.0 and float(rows[0]["any"]) == 1.0 and rows[0]["linear"] == ""
    assert rows[2]["failure"] == RECORDS[1].error and rows[0]["certified"] == "True"


def test_classes_that_are_beaten_stand_in_one_cell():
    [row] = csv_rows([record(None, {}, entries=(entry("LQG", 1.0, beats=("linear", "static")),))])
    assert row["beats"] == "linear static"


def test_the_law_of_a_former_run_does_not_stay_beside_a_new_record(tmp_path):
    path = write_record(tmp_path, RECORDS[0], law="{}", memory="[]")
    static, memory = (path.with_name(f"two-lags-output{suffix}") for suffix in (".law.json", ".memory.json"))
    assert static.read_text() == "{}" and memory.read_text() == "[]"
    assert read_records(tmp_path) == RECORDS[:1]
    write_record(tmp_path, RECORDS[0], law="{}")
    assert static.exists() and not memory.exists()
    write_record(tmp_path, RECORDS[0])
    assert not static.exists()


def test_the_csv_says_where_the_seconds_went():
    stages = {"judging": 0.5, "in all": 2.0, "x (wall)": 3.0}
    [row] = csv_rows([record(None, {}, entries=(entry("LQG", 1.0),), stages=stages)])
    assert row["s, judging"] == "0.5" and row["s, in all"] == "2.0" and row["s, growth"] == ""


def test_an_interrupted_write_leaves_the_former_record(tmp_path, monkeypatch):
    path = write_record(tmp_path, RECORDS[0])
    monkeypatch.setattr(os, "replace", lambda old, new: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        write_record(tmp_path, record(9.0, {}, plant="two lags, output"))
    assert read_record(path) == RECORDS[0]


def test_a_folder_without_records_is_named_with_the_command_that_makes_them(tmp_path):
    with pytest.raises(FormatError, match="python -m benchmarks suite"):
        read_records(tmp_path)


@pytest.mark.parametrize("text", ["", "[]", "{", '{"version": 1}'])
def test_a_damaged_record_is_refused_by_its_path(tmp_path, text: str):
    path = tmp_path / "car.json"
    path.write_text(text)
    with pytest.raises(FormatError, match="car.json holds no record"):
        read_record(path)


def test_no_two_plants_of_the_suite_share_a_file():
    assert len({slug(name) for name in suite()}) == len(suite())
