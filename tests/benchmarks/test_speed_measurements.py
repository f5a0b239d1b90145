"""Measuring: medians, fresh processes, verdicts. The times themselves are no test: machines differ."""

from __future__ import annotations

import pytest

from benchmarks.speed import evaluation, imports
from benchmarks.speed.measurement import Measurement, in_fresh_process, repeated


def test_repeated_calls_once_more_than_it_counts():
    calls = []
    median, best = repeated(lambda: calls.append(1), 5)
    assert 0 <= best <= median
    assert len(calls) == 6


def test_a_fresh_process_that_fails_says_why():
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        in_fresh_process("1 / 0")


@pytest.mark.parametrize(("value", "target", "verdict"), [(1.0, 2.0, "pass"), (3.0, 2.0, "MISS"), (3.0, None, "-")])
def test_verdict(value: float, target: float | None, verdict: str):
    assert Measurement("", value, "s", target).verdict == verdict


def test_importing_the_toolbox_loads_nothing_heavy():
    [measured] = imports(1)
    assert "loads none of" in measured.note


def test_every_way_to_evaluate_is_measured():
    rows = evaluation((5,))
    assert [row.name for row in rows] == [f"evaluate, q = 5, {way}" for way in ("Newton", "Picard", "CasADi")]
    assert all(row.value > 0 for row in rows)


def test_the_search_for_certificates_is_measured_side_by_side():
    from benchmarks.speed import certification, certification_table, certification_targets
    rows = certification(((3, 5),))
    bounds = {row.bound for row in rows if row.multiplier == "sector"}
    assert len(rows) == 6 and max(bounds) < min(bounds) * (1 + 1e-4)
    ours = [row for row in rows if row.solver == "interior point"]
    assert all(row.proved and row.eigenvalue < 0 for row in ours)
    text = certification_table(rows)
    assert "CVXPY + Clarabel" in text and text.count("\n") == 6
    assert certification_targets(rows) == []
