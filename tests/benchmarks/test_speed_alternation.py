"""The table of the BMI loop: one quick case, with everything in it that the table promises."""

import numpy as np
import pytest

from benchmarks import speed
from benchmarks.__main__ import main
from benchmarks.speed.alternation import alternation, alternation_table, cases


def test_row_shows_a_bound_that_falls_is_proved_and_lies_above_the_simulated_cost():
    (row,) = alternation(("joint",), multiplier="sector", chosen=cases()[:1], max_rounds=2)
    assert row.after < 0.6 * row.before and row.rises == 0.0 and row.proved
    assert row.floor * (1 - 1e-6) <= row.after and row.simulated <= row.after * (1 + 1e-6)
    assert row.error < 1e-3 and row.rounds == 2
    assert "2 states, ReLU" in alternation_table([row])


def test_the_command_prints_the_table(monkeypatch, capsys):
    rows = alternation(("joint",), multiplier="sector", chosen=cases()[:1], max_rounds=1)
    monkeypatch.setattr(speed, "alternation", lambda: rows)
    assert main(["speed", "alternation"]) == 0 and alternation_table(rows) in capsys.readouterr().out


@pytest.mark.slow
def test_plants_of_the_suite_are_stable_and_their_laws_have_a_bound_to_lower():
    for case in cases()[-2:]:
        assert case.plant.n == 4 and np.max(np.abs(np.linalg.eigvals(case.plant.A))) < 1.0 and case.inc.W.any()
        (row,) = alternation(("joint",), multiplier="sector", chosen=[case], max_rounds=1)
        assert row.after < row.before < np.inf and row.way == "joint"
