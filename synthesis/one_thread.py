"""Linear algebra on one thread: attempts that run side by side do not slow each other, and sums come out the same."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import Any


def one_thread() -> AbstractContextManager[Any]:
    """Return a context in which the BLAS libraries of this process use one thread; where threadpoolctl is missing, none.

    The number of threads decides the order in which a product is summed, hence its rounding, and a training amplifies that:
    with the same number everywhere the same attempt ends in the same law in whatever process it is made. The matrices here
    are small, so that nothing is lost.

    >>> with one_thread():
    ...     1 + 1
    2
    """
    try:
        from threadpoolctl import threadpool_limits
    except ImportError:
        return nullcontext()
    limits: AbstractContextManager[Any] = threadpool_limits(limits=1, user_api="blas")
    return limits
