"""The table of the forms of training: quick rows with what the table promises, and forms too large are said to be."""

import numpy as np
import pytest

from benchmarks import speed
from benchmarks.__main__ import main
from benchmarks.speed.training import training, training_table


def test_rows_share_a_start_and_their_times_are_ordered():
    rows = training(("NN2",), (3, 4), seconds=0.5)
    assert [(row.q, row.form) for row in rows] == [
        (3, "shooting"), (3, "lifted"), (3, "projected"), (4, "shooting"), (4, "lifted"), (4, "projected"), (4, "graph")]
    for q in (3, 4):
        group = [row for row in rows if row.q == q]
        assert len({row.start for row in group}) == 1 and all(row.cost <= row.start for row in group)
        least = min(row.cost for row in group)
        for row in group:
            assert (row.cost <= 1.01 * least) == np.isfinite(row.percent)
            assert np.isnan(row.permille) or row.percent <= row.permille
    assert training_table(rows).count("\n") == len(rows)


def test_a_form_that_is_too_large_is_not_run():
    rows = training(("two states",), (40,), seconds=0.2)
    lifted = next(row for row in rows if row.form == "lifted")
    assert lifted.status.startswith("not run: ") and lifted.iterations == 0 and np.isnan(lifted.iteration)
    assert " - " in training_table([lifted])


def test_the_command_has_a_quick_mode(monkeypatch, capsys):
    monkeypatch.setattr(speed, "quick_training", lambda: training(("NN2",), (3,), seconds=0.2))
    assert main(["speed", "training", "--quick"]) == 0
    assert "projected" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["speed", "--quick"])
