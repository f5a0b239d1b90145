"""The table of pieces: every loop certified, agreeing with its samples, and caps said to be caps."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

from benchmarks import speed
from benchmarks.__main__ import main
from benchmarks.speed.pieces_cases import cases, clipped, implicit, masses, network
from inc_casadi.pieces.walk import Budget

module = importlib.import_module("benchmarks.speed.pieces")  # the package's `pieces` is the function


@pytest.mark.slow
def test_small_loops_are_measured_and_agree_with_their_samples():
    which = [clipped(1, 1), clipped(3, 2, 1), network(2, (3,)), implicit(2, 1, 2)]
    rows = speed.pieces(which)
    assert [(row.n, row.m, row.q) for row in rows] == [(1, 1, 1), (3, 2, 2), (2, 1, 3), (2, 1, 2)]
    for row in rows:
        assert not row.ended and row.pieces > 1 and row.steps > 1 and row.proved.startswith("256 binary places")
        assert min(row.walk, row.cost, row.proof, row.memory, row.sampling, row.simplices_seconds) > 0
        assert abs(row.off) < 4 and row.sampling > 10 * (row.walk + row.cost) and row.simplices > 1
    text = speed.pieces_table(rows)
    assert text.count("\n") == 4 + 5 and "implicit, W != 0" in text and "!" not in text.split("\n\n")[0].replace("!=", "")


def test_caps_are_said(monkeypatch):
    monkeypatch.setattr(module, "WALK", Budget(pieces=2))
    monkeypatch.setattr(module, "SIMPLICES", Budget(pieces=5))
    [row] = speed.pieces([clipped(2, 1)])
    assert "more than 2 pieces" in row.ended and row.capped and np.isnan(row.proof) and not row.proved
    line = speed.pieces_table([row]).splitlines()[1]
    assert f"{row.pieces}*" in line and f">{row.simplices}" in line and " - " in line


def test_long_proofs_are_not_tried(monkeypatch):
    monkeypatch.setattr(module, "MOST_PROVED", 3)
    [row] = speed.pieces([clipped(2, 1)])
    assert np.isnan(row.proof) and not row.ended


def test_the_default_run_covers_the_sizes_of_the_issue():
    sizes = np.array([(case.plant.n, case.plant.m, case.inc.q) for case in cases()])
    assert set(sizes[:, 0]) == set(range(1, 7)) and set(sizes[:, 1]) == {1, 2, 3}
    assert sizes[:, 2].min() == 1 and sizes[:, 2].max() == 30
    assert any(np.any(case.inc.W) and case.inc.well_posedness().radius > 0.1 for case in cases())


def test_masses_are_pulled_at_both_ends():
    plant = masses(3, 1.0).plant
    pushed = plant.B @ np.array([1.0, 0.0])
    np.testing.assert_allclose(plant.B @ np.array([0.0, 1.0]), pushed[[2, 1, 0, 5, 4, 3]], atol=1e-12)
    assert np.max(np.abs(np.linalg.eigvals(plant.A))) == pytest.approx(1.0)  # springs without friction


def test_the_command_prints_the_table(monkeypatch, capsys):
    monkeypatch.setattr(speed, "pieces", lambda: [])
    assert main(["speed", "pieces"]) == 0
    assert "sampling / ours" in capsys.readouterr().out
