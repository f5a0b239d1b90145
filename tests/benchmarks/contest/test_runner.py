"""Running: a plant that fails does not stop the rest, a second run repeats nothing, Ctrl-C keeps what is finished."""

from __future__ import annotations

from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace

import pytest

from benchmarks.contest import runner
from benchmarks.contest.environment import environment
from benchmarks.contest.files import PLANTS, read_records
from benchmarks.contest.measure import Measured, digest_of
from benchmarks.contest.runner import run
from benchmarks.contest.sample import record
from benchmarks.contest.settings import Settings
from benchmarks.plants import Case, scalar
from inc_casadi.errors import InvalidInputError

CASES = {"one": scalar(0.9), "two": scalar(0.8), "three": scalar(0.7)}


class Counted:
    """A measurement that counts its calls and fails where it is told to."""

    def __init__(self, fails: str = "") -> None:
        self.fails, self.calls = fails, []  # type: ignore[var-annotated]

    def __call__(self, name: str, case: Case, settings: Settings) -> Measured:
        self.calls.append(name)
        if name == self.fails:
            raise LookupError("nobody knows")
        return Measured(record(1.0, {"LQG": 2.0}, plant=name, settings=settings, environment=environment(),
                               digest=digest_of(case)), law="{}")


class Here(Executor):
    """Runs at once, in this thread; Ctrl-C at a plant of that name."""

    def __init__(self, interrupted: str = "") -> None:
        self.interrupted, self.ended = interrupted, False

    def submit(self, fn, /, *args, **kwargs):
        if args[0] == self.interrupted:
            raise KeyboardInterrupt
        future: Future = Future()
        future.set_result(fn(*args))
        return future

    def shutdown(self, wait=True, *, cancel_futures=False):
        self.ended = cancel_futures


USUAL = Settings()


def again(folder, measure, cases=CASES, settings=USUAL, **how):
    with ThreadPoolExecutor(2) as executor:
        return run(cases, settings, folder, executor, 2, say=lambda words: None, measure=measure, **how)


def test_a_plant_that_fails_is_a_record_and_the_rest_goes_on(tmp_path):
    found = again(tmp_path, Counted("two"))
    assert [one.plant for one in found.records] == list(CASES)
    assert [one.error for one in found.records] == ["", "LookupError: nobody knows", ""]
    assert read_records(tmp_path, tuple(CASES)) == list(found.records) and not found.interrupted
    assert found.records[1].sizes == (1, 1, 1) and found.records[1].source == "eq:scalar_plant"


def test_a_second_run_measures_nothing(tmp_path):
    first, second, counted = again(tmp_path, Counted()), Counted(), Counted()
    found = again(tmp_path, second)
    assert second.calls == [] and found.skipped == tuple(CASES) and found.records == first.records
    again(tmp_path, counted, fresh=True)
    assert sorted(counted.calls) == sorted(CASES)


def test_a_failed_plant_is_tried_again(tmp_path):
    again(tmp_path, Counted("two"))
    second = Counted()
    assert again(tmp_path, second).records[1].error == "" and second.calls == ["two"]


def test_other_settings_are_measured_anew(tmp_path):
    again(tmp_path, Counted())
    for settings in (Settings(seed=1), Settings(search=1.0), Settings(only=("LQG",))):
        counted = Counted()
        again(tmp_path, counted, settings=settings)
        assert len(counted.calls) == len(CASES)


def test_another_problem_of_the_same_name_is_measured_anew(tmp_path):
    again(tmp_path, Counted())
    counted = Counted()
    again(tmp_path, counted, {**CASES, "two": scalar(0.81)})
    assert counted.calls == ["two"]


def test_other_versions_are_measured_anew(tmp_path, monkeypatch):
    again(tmp_path, Counted())
    now = environment()
    monkeypatch.setattr(runner, "environment", lambda: replace(now, versions={**now.versions, "numpy": "0.1"}))
    counted = Counted()
    again(tmp_path, counted)
    assert len(counted.calls) == len(CASES)


def test_other_source_is_measured_anew(tmp_path, monkeypatch):
    again(tmp_path, Counted())
    now = environment()
    monkeypatch.setattr(runner, "environment", lambda: replace(now, source="edited"))
    counted = Counted()
    again(tmp_path, counted)
    assert len(counted.calls) == len(CASES)


def test_a_damaged_record_is_measured_anew(tmp_path):
    again(tmp_path, Counted())
    (tmp_path / PLANTS / "two.json").write_text("{")
    counted = Counted()
    again(tmp_path, counted)
    assert counted.calls == ["two"]


def test_an_interruption_keeps_what_is_finished(tmp_path):
    executor, said = Here("three"), []
    found = run(CASES, Settings(), tmp_path, executor, 1, say=said.append, measure=Counted())
    assert found.interrupted and executor.ended and [one.plant for one in found.records] == ["one", "two"]
    assert said[-1] == "interrupted: 2 of 3 plants are kept"
    counted = Counted()
    assert len(again(tmp_path, counted).records) == 3 and counted.calls == ["three"]


def test_no_more_plants_are_under_way_than_asked_for(tmp_path):
    class Watched(ThreadPoolExecutor):
        most = 0

        def submit(self, fn, /, *args, **kwargs):
            Watched.most = max(Watched.most, self._work_queue.qsize() + 1)
            return super().submit(fn, *args, **kwargs)

    with Watched(1) as executor:
        run(CASES, Settings(), tmp_path, executor, 1, say=lambda words: None, measure=Counted())
    assert Watched.most == 1


def test_two_plants_that_would_share_a_file_are_refused(tmp_path):
    with pytest.raises(InvalidInputError, match="same file"):
        again(tmp_path, Counted(), {"a b": scalar(), "a, b": scalar()})
