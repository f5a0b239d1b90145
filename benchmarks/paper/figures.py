"""Every figure of sec:numerics and of the separation theorems, computed and set beside what is printed."""

from __future__ import annotations

from collections.abc import Sequence

from . import implicit, scalar_figure, separation, two_states
from .row import Row, table


def all_rows() -> list[Row]:
    """Return the figures of the implicit example, of the separation theorems and their figure, of the two-state example."""
    return [*implicit.rows(), *separation.rows(), *scalar_figure.rows(), *two_states.rows()]


def report(rows: Sequence[Row]) -> str:
    """Return the table with a last line that counts.

    >>> print(report([Row("gain", "-1.2174", -1.21739, "sec:numerics")]).splitlines()[-1])
    1 of 1 figures agree with what is printed.
    """
    agree = sum(row.agrees for row in rows)
    return f"{table(rows)}\n{agree} of {len(rows)} figures agree with what is printed."
