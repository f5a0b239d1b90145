"""Shares as per cent, rounded to the side on which what is said stays true."""

from __future__ import annotations

from inc_casadi.figures import at_least, at_most

FINEST = 1e-4  # per cent


def won(share: float) -> str:
    """Return a share by which a cost is lower, rounded down to three digits.

    >>> won(0.334567), won(0.2), won(-0.0123456)
    ('33.4 %', '20 %', '-1.24 %')
    """
    return f"{float(at_least(round(100 * share, 9), 3)):g} %"


def above(gap: float) -> str:
    """Return a share by which a cost may be higher, rounded up to two digits, and to a ten-thousandth of one per cent.

    >>> above(0.00012187), above(1e-13), above(1.0), above(2.512)
    ('0.013 %', '0.0001 %', '100 %', '260 %')
    """
    return f"{float(at_most(max(round(100 * gap, 9), FINEST), 2)):g} %"
