"""One evaluation at a time: every way is measured, and the program that times C times it. The times are no test."""

from __future__ import annotations

import pytest

from benchmarks.speed import compiled
from benchmarks.speed.single_evaluation import single_evaluation, single_table


@pytest.mark.slow
def test_every_way_is_measured_in_one_run(monkeypatch):
    if compiled.compiler() is None:
        pytest.skip("no C compiler is installed")
    monkeypatch.setattr(compiled, "LEAST_SECONDS", 1e-3)
    monkeypatch.setattr(compiled, "FLAGS", ("-std=c99", "-O1"))
    monkeypatch.setattr(compiled, "NATIVE", ())
    rows = single_evaluation((4,), (0.5,))
    loop = [row.way for row in rows if row.norm > 0]
    assert loop == ["NumPy, one call", "CasADi, one call", "CasADi's C", "C, as to_c chooses", "C, contraction", "C, Newton",
                    "C, last pattern kept", "C, single precision"]
    assert [row.way for row in rows if row.norm == 0][-2:] == ["C, one pass", "C, single precision"]
    assert all((row.native is None) == (row.size is None) for row in rows)
    assert all(row.microseconds > 0 and (row.size is None or row.size > 500) for row in rows)
    assert single_table(rows).count("\n") == len(rows)
