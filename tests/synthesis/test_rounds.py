"""The loop: one history whatever computes it, an end when nothing is left to win or the time is over, the best kept."""

import logging
import time
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace

import numpy as np
import pytest

from inc_casadi import INC, Box, Plant, ReLU, Spec
from inc_casadi.errors import DimensionError, InvalidInputError
from synthesis import synthesize
from synthesis.attempts import TRAINED, attempt, plan
from synthesis.causes import Cause
from synthesis.gate import Verdict
from synthesis.progress import Progress
from synthesis.result import Attempt
from synthesis.rounds import Goal, search

PLANT = Plant([[1.2, 0.4], [0.0, 0.7]], [[0.3], [1.0]])
SPEC = Spec(np.diag([1.0, 0.3]), [[0.05]], 0.95, Box([-1.0, -2.0], [1.0, 2.0]), Box([-0.7], [0.9]))
QUIET = Progress(False)
SCALAR = Plant([[1.4]], [[1.0]])
STEEP = Spec([[1.0]], [[0.05]], 0.95, Box([-1.0], [1.0]), Box([-0.7], [0.9]))
FEW = {"hidden": 2, "training_iterations": 3, "tol": 0.0, "rounds": 1, "verbose": False}
MORE = {**FEW, "rounds": 2}


def named(count=3):
    """Random starts told apart by their labels; what becomes of them is up to the test."""
    task = plan(PLANT, SPEC, 2, ReLU(), 0.9, 0, 1.0, starts=("random",))[0]
    return tuple(replace(task, label=f"{i}") for i in range(count))


def judged(task, cost, cause=None):
    """An attempt with a verdict of that cost, no law behind it."""
    verdict = Verdict(object() if np.isfinite(cost) else None, cost, (), (), (cause,) if cause else ())
    return Attempt(task.name, None, verdict, None, 0.0)


def goal(floor=1.0, tol=1e-3, rounds=1, until=np.inf):
    return Goal(floor, tol, rounds, until)


class Backwards(ThreadPoolExecutor):
    """Runs what is submitted in the opposite order, when the first result is asked for."""

    def __init__(self):
        super().__init__(1)
        self.waiting = []

    def submit(self, call, *arguments):
        executor = self

        class Late(Future):
            def result(self, timeout=None):
                for future, work, given in reversed(executor.waiting):
                    if not future.done():
                        future.set_result(work(*given))
                return super().result(timeout)

        future = Late()
        self.waiting.append((future, call, arguments))
        return future


@pytest.fixture(scope="module")
def one_after_another():
    return synthesize(SCALAR, STEEP, **FEW)


@pytest.fixture(scope="module")
def two_rounds():
    return synthesize(SCALAR, STEEP, **MORE)


def signature(result):
    return [(one.name, one.of, one.why, one.verdict and one.verdict.cost) for one in result.history]


def laws(result):
    return [getattr(one.inc, name) for one in result.history if one.inc for name in ("W", "U", "V", "K", "b", "d")]


def test_the_history_has_every_round_with_reasons(two_rounds):
    names = [one.name for one in two_rounds.history]
    assert names[:3] == ["clipped LQR", "clipped LQR, trained", "random, trained"] and len(set(names)) == len(names)
    assert {"MPC", "explicit MPC", "compressed MPC, trained", "random, trained, seed 1"} < set(names)
    widened = next(one for one in two_rounds.history if one.name.startswith("from "))
    assert widened.of in names[:3] and "more units" in widened.why and widened.inner.q == 2
    assert "sector inequality" not in names  # the plant is unstable: it would be refused for sure
    assert "no more than 2 rounds were to be made" in two_rounds.ended
    certified = [one.verdict.cost for one in two_rounds.history if one.certified]
    assert two_rounds.cost == min(certified) and two_rounds.certificate.holds()


@pytest.mark.parametrize("pool", [Backwards, lambda: ThreadPoolExecutor(2), lambda: ProcessPoolExecutor(2)],
                         ids=["backwards", "threads", "processes"])
def test_the_same_seed_gives_the_same_history_whatever_the_executor(one_after_another, pool):
    with pool() as executor:
        result = synthesize(SCALAR, STEEP, executor=executor, **FEW)
    assert signature(result) == signature(one_after_another)
    assert all(np.array_equal(a, b) for a, b in zip(laws(result), laws(one_after_another), strict=True))


def on_dask(plant, spec, processes, **keywords):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=processes, dashboard_address=None,
                                  silence_logs=logging.CRITICAL) as cluster, distributed.Client(cluster) as client:
        return synthesize(plant, spec, executor=client.get_executor(), **keywords)


def test_a_dask_cluster_gives_the_same_history(one_after_another):
    assert signature(on_dask(SCALAR, STEEP, False, **FEW)) == signature(one_after_another)


@pytest.mark.slow
def test_long_trainings_end_in_the_same_numbers_in_processes_and_on_dask():
    """8 units, two rounds: where rounding decides on iterations, so that a sum in another order would show."""
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]])
    spec = Spec(np.eye(2), [[0.1]], 0.95, Box([-3.0, -1.5], [3.0, 1.5]), Box([-0.5], [0.5]))
    more = {"hidden": 8, "rounds": 2, "tol": 0.0, "training_seconds": 100.0, "verbose": False}
    here = synthesize(plant, spec, **more)
    with ProcessPoolExecutor(2) as executor:
        assert signature(synthesize(plant, spec, executor=executor, **more)) == signature(here)
    assert signature(on_dask(plant, spec, True, **more)) == signature(here)


def test_attempts_use_one_thread_of_linear_algebra_and_leave_the_setting_as_it_was(monkeypatch):
    threadpoolctl = pytest.importorskip("threadpoolctl")

    def threads():
        return {one["num_threads"] for one in threadpoolctl.threadpool_info() if one["user_api"] == "blas"}

    seen = []
    monkeypatch.setattr("synthesis.rounds.attempt", lambda task: seen.append(threads()) or judged(task, 5.0))
    with threadpoolctl.threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        search(named(1), goal(), None, QUIET)
        assert seen == [{1}] and 2 in before == threads()


def test_another_seed_gives_other_laws(one_after_another):
    other = synthesize(SCALAR, STEEP, seed=5, **FEW)
    assert not np.array_equal(other.history[2].inc.U, one_after_another.history[2].inc.U)


@pytest.mark.parametrize("executor", [None, Backwards()])
def test_the_first_that_reaches_the_goal_ends_the_search_and_later_ones_are_dropped(monkeypatch, executor):
    costs = {"0": 5.0, "1": 1.0005, "2": 1.0}
    monkeypatch.setattr("synthesis.rounds.attempt", lambda task: judged(task, costs[task.label]))
    found = search(named(), goal(rounds=None), executor, QUIET)
    assert [one.attempt.verdict.cost for one in found.history] == [5.0, 1.0005]
    assert "within 0.1 % of what no controller can go below" in found.ended


def test_a_gap_above_tol_or_no_bound_goes_on():
    assert goal(2.0).reached(2.002) and not goal(2.0).reached(2.0021)
    assert not goal(-np.inf).reached(1.0) and not goal(1.0).reached(np.inf)
    assert goal(0.0).reached(0.0) and not goal(2.0, tol=0.0).reached(2.0001)


def test_the_time_is_over_after_the_first_attempt_at_the_earliest(monkeypatch):
    monkeypatch.setattr("synthesis.rounds.attempt", lambda task: judged(task, 5.0))
    found = search(named(), goal(until=time.time() - 1), None, QUIET)
    assert len(found.history) == 1 and found.ended == "the time is over"


def test_a_worker_that_hangs_is_not_waited_for(monkeypatch):
    monkeypatch.setattr("synthesis.rounds.GRACE", 0.0)
    monkeypatch.setattr("synthesis.rounds.attempt", lambda task: time.sleep(0.6) or judged(task, 5.0))
    with ThreadPoolExecutor(1) as executor:
        began = time.monotonic()
        found = search(named(), goal(until=time.time() + 0.1), executor, QUIET)
        assert time.monotonic() - began < 0.5 and found.history == () and found.ended == "the time is over"


def test_a_broken_pool_keeps_what_was_finished(monkeypatch):
    class Breaking(Backwards):
        def submit(self, call, *arguments):
            future = super().submit(call, *arguments)
            if len(self.waiting) == 2:
                future.set_exception(BrokenProcessPool("a child process died"))
            return future

    monkeypatch.setattr("synthesis.rounds.attempt", lambda task: judged(task, 5.0))
    found = search(named(), goal(), Breaking(), QUIET)
    assert len(found.history) == 1 and "broke after 1 of 3 attempts: a child process died" in found.ended


def test_a_training_that_was_interrupted_ends_the_search(monkeypatch):
    def interrupted(task):
        return Attempt(task.name, None, Verdict(None, np.inf, (), ()), None, 0.0, "interrupted")

    monkeypatch.setattr("synthesis.rounds.attempt", interrupted)
    found = search(named(), goal(), None, QUIET)
    assert len(found.history) == 1 and found.ended.startswith("interrupted after 1 of 3")


def test_retries_end_after_two_rounds_when_nothing_helps(monkeypatch):
    monkeypatch.setattr("synthesis.rounds.attempt", lambda task: judged(task, np.inf, Cause.KINK))
    found = search(named(1), goal(rounds=None), None, QUIET)
    assert [one.task.seed for one in found.history] == [0, 1, 2]
    assert found.history[1].task.of == "random, trained, 0" and found.history[1].task.why == Cause.KINK.value


@pytest.mark.slow
def test_seconds_bound_the_search():
    began = time.monotonic()
    result = synthesize(PLANT, SPEC, hidden=2, tol=0.0, seconds=2.0, training_iterations=10, verbose=False)
    assert time.monotonic() - began < 8.0  # attempts end at the limit, gate and simulation come on top
    assert result.status == "certified" and result.ended.endswith("the time is over")


def test_a_given_law_is_judged_and_trained(one_after_another):
    best = one_after_another.inc
    few = {"hidden": 2, "training_iterations": 2, "tol": 0.0, "verbose": False}
    result = synthesize(SCALAR, STEEP, start=best, starts=["random"], **few)
    names = [one.name for one in result.history]
    assert names[:3] == ["given 1", "given 1, trained", "random, trained"]
    assert result.history[0].verdict.cost == pytest.approx(one_after_another.cost, rel=1e-9)
    assert result.cost <= one_after_another.cost * (1 + 1e-9)


def test_starts_and_laws_that_do_not_fit_are_refused_at_the_door():
    with pytest.raises(InvalidInputError, match="clipped LQR, static gain"):
        synthesize(PLANT, SPEC, starts=["LQR"], verbose=False)
    with pytest.raises(InvalidInputError, match="start must be an INC"):
        synthesize(PLANT, SPEC, start=[[1.0]], verbose=False)
    with pytest.raises(DimensionError, match="start maps 1 measurements"):
        synthesize(PLANT, SPEC, start=INC.linear([[1.0]]), verbose=False)
    with pytest.raises(InvalidInputError, match="nothing to try"):
        synthesize(PLANT, SPEC, starts=[], verbose=False)
    with pytest.raises(InvalidInputError, match="rounds"):
        synthesize(PLANT, SPEC, rounds=0, verbose=False)
    with pytest.raises(InvalidInputError, match="frozen"):
        synthesize(PLANT, SPEC, frozen="W", verbose=False)
    with pytest.raises(InvalidInputError, match="tol"):
        synthesize(PLANT, SPEC, tol=-1.0, verbose=False)


def test_random_starts_without_units_leave_nothing_to_try():
    result = synthesize(SCALAR, STEEP, hidden=0, starts=["random"], verbose=False)
    assert result.status == "failed" and result.history == () and "need hidden units" in str(result)


def test_a_time_limit_that_cut_an_attempt_short_is_said():
    result = synthesize(SCALAR, STEEP, hidden=4, tol=0.0, rounds=1, training_seconds=0.0, verbose=False)
    assert all(one.timed for one in result.history)
    assert any(note.startswith("cut short by a time limit") and "trained" in note for note in result.notes)


def test_an_attempt_is_made_the_same_way_alone(one_after_another):
    task = next(task for task in plan(SCALAR, STEEP, 2, ReLU(), 0.95, 0, 10.0, 3) if task.way == TRAINED)
    alone = attempt(task)
    assert np.array_equal(alone.inc.U, one_after_another.history[1].inc.U) and alone.name == "clipped LQR, trained"
