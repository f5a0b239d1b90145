"""Work apart: exceptions are values, a process that dies or does not end costs its own answer only."""

from __future__ import annotations

import os
import time
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children

import pytest

from benchmarks.contest.isolation import FreshProcesses, attempted, words


class Odd(Exception):
    """No error of this toolbox."""


def test_any_exception_is_a_value():
    def fail():
        raise Odd("two\n  lines")
    assert words(attempted(fail)) == "Odd: two lines"
    assert attempted(lambda: 5) == 5


def test_a_process_that_crashes_or_fails_leaves_the_others_alone():
    with FreshProcesses(100.0) as processes:
        crash, error, good = processes.submit(os._exit, 3), processes.submit(int, "x"), processes.submit(os.getpid)
        assert good.result() != os.getpid()
        assert isinstance(crash.exception(), BrokenProcessPool) and isinstance(error.exception(), ValueError)


def test_a_process_that_lasts_too_long_is_ended():
    with FreshProcesses(1.0) as processes, pytest.raises(TimeoutError, match="given up after 1 s"):
        processes.submit(time.sleep, 60).result()


def test_cancelling_ends_what_runs():
    before = set(active_children())
    processes, begun = FreshProcesses(60.0), time.monotonic()
    future = processes.submit(time.sleep, 50)
    processes.shutdown(cancel_futures=True)
    assert isinstance(future.exception(), BrokenProcessPool) and time.monotonic() - begun < 20
    while any(child.is_alive() for child in set(active_children()) - before):  # the pool's thread may be about to reap it
        assert time.monotonic() - begun < 40
        time.sleep(0.05)
