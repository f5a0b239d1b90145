"""What the next attempt is chosen by: why a candidate was refused, in one word of the judge's list."""

from __future__ import annotations

from inc_casadi.judgement import Cause

__all__ = ["Cause", "first_of"]


def first_of(causes: tuple[Cause, ...]) -> Cause | None:
    """Return the first cause that something can be done about, or None.

    >>> first_of((Cause.HOPELESS, Cause.KINK)), first_of((Cause.HOPELESS,))
    (<Cause.KINK: 'rests on kinks where nothing is certified'>, None)
    """
    return next((cause for cause in causes if cause not in (Cause.HOPELESS, Cause.REACH)), None)
