"""Whole lines that say where the search stands, and nothing when it is to be quiet."""

import time

import numpy as np
import pytest

from inc_casadi import Box, Plant, Spec
from synthesis import synthesize
from synthesis.progress import Progress


def test_each_line_says_best_bound_gap_and_time_left(capsys):
    Progress(True, seconds=30.0).trying(["one", "two"], 3.0, 2.0)
    line = capsys.readouterr().out
    assert "trying one; two (best certified 3, none below 2, gap 50 %, 30 s left)" in line and line.endswith("\n")
    Progress(True).trying(["one"], np.inf, -np.inf)
    assert capsys.readouterr().out.strip().endswith("trying one (nothing certified yet)")


def test_a_run_prints_plain_lines_only(capsys):
    plant, spec = Plant([[1.5]], [[1.0]]), Spec([[1.0]], [[0.0]], 0.9, Box([-1.0], [1.0]), Box([-1.0], [1.0]))
    synthesize(plant, spec, hidden=0, seconds=60.0)
    shown = capsys.readouterr()
    assert shown.err == "" and "\r" not in shown.out and "\x1b" not in shown.out and "s left" in shown.out
    assert all(line.startswith("[") for line in shown.out.splitlines())


def test_quiet_is_quiet(capsys):
    quiet = Progress(False)
    quiet.say("nothing")
    quiet.trying(["one"], 1.0, 1.0)
    assert capsys.readouterr().out == ""


def test_a_long_task_is_said_to_go_on_and_a_short_one_is_not(capsys, monkeypatch):
    monkeypatch.setattr("synthesis.progress.SILENCE", 0.05)
    with Progress(True).during("a proof"):
        time.sleep(0.18)
    shown = capsys.readouterr().out.splitlines()
    assert 1 <= len(shown) <= 3 and all("still at it for 0 s: a proof" in line for line in shown)
    with Progress(True).during("nothing"):
        pass
    time.sleep(0.12)
    assert capsys.readouterr().out == ""


def test_whoever_is_quiet_stays_quiet_and_what_goes_wrong_is_passed_on(capsys, monkeypatch):
    monkeypatch.setattr("synthesis.progress.SILENCE", 0.02)
    with Progress(False).during("a proof"):
        time.sleep(0.06)
    assert capsys.readouterr().out == ""
    with pytest.raises(KeyboardInterrupt), Progress(True).during("a proof"):
        raise KeyboardInterrupt
    time.sleep(0.06)
    assert capsys.readouterr().out == ""


def test_a_share_is_never_more_than_what_is_left():
    assert Progress(False, seconds=10.0).share(0.2) == 2.0 and Progress(False).share(0.2) is None
    late = Progress(False, seconds=10.0, began=time.monotonic() - 9.5)
    assert 0.4 < late.share(0.2) < 0.6 and not late.is_late
    assert Progress(False, seconds=10.0, began=time.monotonic() - 11.0).share(0.2) == 0.0
