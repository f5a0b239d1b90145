"""The log of a training's phases: times run on, limits are passed on, and the best ending is chosen."""

import time

import numpy as np
import pytest

from inc_casadi import INC, Box
from synthesis.outcome import Outcome
from synthesis.phase_log import PhaseLog
from synthesis.rollout import Parameters
from synthesis.training import ended

NONE = np.zeros(0)


def law(V):
    return Parameters(np.zeros((1, 1)), np.ones((1, 1)), np.array([[V]]), np.zeros((1, 1)), np.zeros(1), np.zeros(1))


def test_phases_run_on_in_one_history():
    heard, log = [], PhaseLog(time.perf_counter() - 100.0, 160.0, None)
    log.progress = heard.append

    def solve(progress, time_limit):
        assert 59.0 < time_limit <= 60.0  # of 160 seconds 100 are gone
        progress(0, 3.0, 0.5)
        return Outcome(law(1.0), "solved", ((0, 3.0, 0.5), (1, 2.0, 0.75)))

    assert log.entered("coarse", solve).V == 1.0
    log.entered("fine", solve)
    assert [row["phase"] for row in log.history] == ["coarse", "coarse", "fine", "fine"]
    assert log.history[1]["seconds"] == pytest.approx(100.75, abs=0.5) and log.iterations == 2
    assert heard[0] == log.history[0] and [row["phase"] for row in heard] == ["coarse", "fine"]


def test_no_limit_is_passed_on_as_none():
    seen = []
    log = PhaseLog(time.perf_counter(), np.inf, None)
    log.entered("coarse", lambda progress, time_limit: seen.append(time_limit) or Outcome(law(0.0), "interrupted", ()))
    assert seen == [None] and log.status == "interrupted" and log.is_over


def test_it_is_over_when_the_time_is():
    assert PhaseLog(time.perf_counter() - 5.0, 4.0, None).is_over and not PhaseLog(time.perf_counter(), 400.0, None).is_over


@pytest.mark.parametrize(("judged", "best"), [
    ([(2.0, NONE, NONE), (1.0, NONE, NONE), (1.5, NONE, NONE)], 1),
    ([(2.0, NONE, NONE), (2.0 - 1e-9, NONE, NONE), (3.0, NONE, NONE)], 0),        # the start must be undercut by its share
    ([(2.0, NONE, NONE), (1.0, np.array([0.3, -1.0]), NONE), (1.9, np.array([-0.1, -1.0]), NONE)], 2),
    ([(2.0, NONE, np.array([0.2])), (1.0, NONE, np.array([0.1])), (0.5, np.array([0.4]), NONE)], 1),
    ([(2.0, np.array([0.5]), NONE), (1.0, np.array([0.3]), NONE), (0.9, np.array([0.4]), NONE)], 1),
    ([(np.inf, NONE, NONE), (np.inf, NONE, NONE), (7.0, NONE, NONE)], 2),
])
def test_the_ending_that_leaves_the_sets_least_is_chosen_and_then_the_cheapest(judged, best):
    laws, log = [law(0.1), law(0.2), law(0.3)], PhaseLog(time.perf_counter(), np.inf, None, "solved")
    found = ended(log, laws, judged, lambda parts: INC(*parts), Box([-1.0], [1.0]), gain=1e-6, form="lifted")
    cost, inputs, states = judged[best]
    assert found.inner.V == laws[best].V and found.inc.q == 2 and found.cost == cost and found.start_cost == judged[0][0]
    assert found.violation == max([0.0, *inputs]) and found.state_violation == max([0.0, *states])
    assert found.status == ("solved" if best else "the start is kept (solved)") and found.form == "lifted"
