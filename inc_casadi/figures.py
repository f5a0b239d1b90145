"""Numbers in sentences, rounded to the side on which the sentence stays true."""

from __future__ import annotations

from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from math import isfinite

DIGITS, LONG = 7, 16  # significant digits; numbers of so many places are written with an exponent


def at_least(value: float, digits: int = DIGITS) -> str:
    """Return a lower bound rounded down.

    >>> at_least(2.11676399), at_least(0.0), at_least(-1.00000001), at_least(3.40867499e51)
    ('2.116763', '0', '-1.000001', '3.408674e+51')
    """
    return _rounded(value, ROUND_FLOOR, digits)


def at_most(value: float, digits: int = DIGITS) -> str:
    """Return an upper bound rounded up; a number of few digits is printed as it was written.

    >>> at_most(1.36496190), at_most(0.9), at_most(100.0, 2)
    ('1.364962', '0.9', '100')
    """
    return _rounded(value, ROUND_CEILING, digits)


def _rounded(value: float, rounding: str, digits: int) -> str:
    if value == 0 or not isfinite(value) or float(f"{value:.{digits}g}") == value:
        short = f"{value:.{digits}g}"
        return f"{value:.0f}" if "e+" in short and abs(value) < 10.0**LONG else short
    rounded = Context(prec=digits, rounding=rounding).create_decimal_from_float(float(value)).normalize()
    return f"{rounded:f}" if abs(rounded.adjusted()) < LONG else f"{rounded:e}"
