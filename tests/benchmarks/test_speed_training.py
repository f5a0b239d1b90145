"""The table of the forms of training: quick rows with what the table promises, and forms too large are left out."""

import numpy as np
import pytest

from benchmarks import speed
from benchmarks.__main__ import main
from benchmarks.speed.training import Run, rows, runs, training, training_table


@pytest.mark.slow
def test_runs_share_seeds_and_keep_to_their_cpu_time():
    measured = runs("NN2", 3, 0.3, (0, 1), ("shooting", "projected"))
    assert [(run.seed, run.form) for run in measured] == [
        (0, "shooting"), (0, "projected"), (1, "shooting"), (1, "projected")]
    for run in measured:
        assert np.isfinite(run.cost) and 0 < run.step < 0.3 and run.steps > 3
        assert run.status == "time" or run.step * run.steps < 0.4


def test_medians_and_shares_are_counted_seed_by_seed():
    costs = {"shooting": [1.0, 2.0, 5.0], "projected": [1.0005, 1.9, 5.1]}
    measured = [Run("NN2", 4, form, seed, cost, 10, 0.1, "solved") for form, several in costs.items()
                for seed, cost in enumerate(several)]
    first, second = rows(measured, "NN2", 4)
    assert (first.cost, first.worst, first.permille, first.percent) == (2.0, 5.0, 2, 2)
    assert (second.cost, second.worst, second.permille, second.percent) == (1.9, 5.1, 2, 2)
    assert first.chosen and not second.chosen and training_table([first, second]).count("*") == 1
    assert "2.0000  1.053" in training_table([first, second]) and "1.9000      1 " in training_table([first, second])


@pytest.mark.slow
def test_a_form_that_is_too_large_is_left_out():
    assert [row.form for row in training(("NN2",), (9,), 0.05, (0,))] == ["shooting", "projected"]
    assert [row.form for row in training(("NN2",), (3,), 0.05, (0,))] == ["shooting", "projected", "lifted"]


def test_the_command_has_a_quick_mode(monkeypatch, capsys):
    monkeypatch.setattr(speed, "quick_training", lambda: training(("NN2",), (3,), 0.1, (0,)))
    assert main(["speed", "training", "--quick"]) == 0
    assert "projected" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["speed", "--quick"])
