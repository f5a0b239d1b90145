"""Whole lines that say where the search stands, and nothing when it is to be quiet."""

import numpy as np

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
