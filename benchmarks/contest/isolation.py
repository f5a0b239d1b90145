"""Work that may fail in any way, kept apart: its exception is a value, and a process of its own bears what it does."""

from __future__ import annotations

import signal
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import active_children, get_context
from multiprocessing.process import BaseProcess
from threading import Event, Thread, Timer
from typing import Any, final


def attempted(work: Callable[[], Any]) -> Any:
    """Return what `work` returns, or the exception that it raises.

    Competitors come from several libraries, each with errors of its own; one that fails must not take the others along.

    >>> attempted(lambda: 1), attempted(lambda: 1 / 0)
    (1, ZeroDivisionError('division by zero'))
    """
    with ThreadPoolExecutor(1) as thread:
        future = thread.submit(work)
    error = future.exception()
    return future.result() if error is None else error


def words(error: BaseException) -> str:
    """Return an exception in one line, its type first.

    >>> words(KeyError("x"))
    "KeyError: 'x'"
    """
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


@final
class FreshProcesses(Executor):
    """Runs each call in a new Python process, which is ended after so many seconds.

    A call that exhausts memory, crashes or never returns costs its own answer only: its future raises TimeoutError or
    BrokenProcessPool. How many run at once is up to who submits. Ctrl-C reaches this process alone.

    seconds : what one call may take

    >>> with FreshProcesses(60.0) as processes:
    ...     processes.submit(abs, -2).result()
    2
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._running: dict[Future[Any], set[BaseProcess]] = {}

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Start a process for fn(*args, **kwargs), which must be picklable, and return its future."""
        answer: Future[Any] = Future()
        before = set(active_children())
        pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_deaf)
        inner = pool.submit(fn, *args, **kwargs)
        children = set(active_children()) - before
        self._running[answer] = children
        expired = Event()
        late = Timer(self._seconds, _expire, (expired, children))
        late.daemon = True
        late.start()
        # In a thread of its own: from Python 3.12 on a broken pool holds its lock while it tells of it.
        inner.add_done_callback(lambda done: Thread(target=self._passed, args=(done, answer, pool, late, expired)).start())
        return answer

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Wait for what runs, or end it when `cancel_futures`."""
        for answer, children in list(self._running.items()):
            if cancel_futures:
                _end(children)
            if wait:
                answer.exception()

    def _passed(self, inner: Future[Any], answer: Future[Any], pool: ProcessPoolExecutor, late: Timer,
                expired: Event) -> None:
        late.cancel()
        pool.shutdown()
        self._running.pop(answer, None)
        error = inner.exception()
        if error is None:
            answer.set_result(inner.result())
        else:
            answer.set_exception(TimeoutError(f"given up after {self._seconds:g} s") if expired.is_set() else error)


def _deaf() -> None:
    """Ctrl-C is for the process that the user sees."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _expire(expired: Event, children: set[BaseProcess]) -> None:
    expired.set()
    _end(children)


def _end(children: set[BaseProcess]) -> None:
    for child in children:
        child.terminate()
