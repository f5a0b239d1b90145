"""Tables of other commands: kept as they were printed, with their rows as plain values."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks.contest.sheets import SHEETS, read_sheets, write_sheet
from benchmarks.paper.row import Row
from inc_casadi.errors import FormatError


def test_a_sheet_is_read_as_it_was_printed_the_paper_first(tmp_path):
    write_sheet(tmp_path, "speed", "fast")
    write_sheet(tmp_path, "bounds", "low\n  and\nhigh")
    write_sheet(tmp_path, "paper", "P  1.3")
    assert [(one.title, one.text) for one in read_sheets(tmp_path)] == [
        ("paper", "P  1.3"), ("bounds", "low\n  and\nhigh"), ("speed", "fast")]


def test_rows_are_plain_values(tmp_path):
    rows = [Row("P", "1.3006", 1.30061, "sec"), {"x": np.float64(2.0), "y": (np.nan, np.arange(2)), "z": print}]
    path = write_sheet(tmp_path, "paper", "", rows)
    first, second = json.loads(path.read_text())["rows"]
    assert first == {"name": "P", "printed": "1.3006", "computed": 1.30061, "source": "sec", "relation": "="}
    assert second["x"] == 2.0 and second["y"] == [None, [0.0, 1.0]] and "print" in second["z"]


def test_no_sheets_are_no_error_and_a_wrong_one_is(tmp_path):
    assert read_sheets(tmp_path) == []
    (tmp_path / SHEETS).mkdir()
    (tmp_path / SHEETS / "paper.json").write_text('{"title": "paper"}')
    with pytest.raises(FormatError, match="paper.json holds no table"):
        read_sheets(tmp_path)
