"""Matrices of Python integers, for exact arithmetic; the FLINT library takes the heavy parts over where it is installed.

python-flint (the extra `exact`) is an accelerator only: every function gives the same result without it.
"""

from __future__ import annotations

from math import lcm
from types import ModuleType
from typing import Any

import numpy as np

WORTH_CONVERTING = 2000  # multiplications from which FLINT saves more than it costs to hand the entries over


def over_common_denominator(value: Any) -> tuple[np.ndarray, int]:
    """Return (N, c) with value = N / c exactly: an object array of integers, and one positive denominator.

    value: an array of floats, each taken as exactly the stored double, or of Fractions or integers.

    >>> over_common_denominator(np.array([0.5, 3.0]))
    (array([1, 6], dtype=object), 2)
    """
    array = np.asarray(value)
    ratios = [_ratio(entry) for entry in array.ravel().tolist()]
    denominator = lcm(*(below for _, below in ratios))
    numbers = np.empty(array.shape, dtype=object)
    numbers.ravel()[:] = [above * (denominator // below) for above, below in ratios]
    return numbers, denominator


def product(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return left @ right.

    left, right: object arrays of Python integers that `@` accepts; pairs of matrices are what FLINT may be asked for.

    >>> product(np.array([[1, 2]], dtype=object), np.array([[3], [10**30]], dtype=object)).tolist()
    [[2000000000000000000000000000003]]
    """
    is_heavy = left.ndim == right.ndim == 2 and left.size * right.shape[1] >= WORTH_CONVERTING
    library = flint() if is_heavy else None
    if library is None:
        return np.asarray(left @ right, dtype=object)
    found = library.fmpz_mat(left.tolist()) * library.fmpz_mat(right.tolist())
    out = np.empty((left.shape[0], right.shape[1]), dtype=object)
    out.ravel()[:] = [int(entry) for entry in found.entries()]
    return out


def characteristic(numbers: np.ndarray) -> list[int] | None:
    """Return the coefficients c_0 ... c_N of det(t I - M) for an (N, N) matrix of integers, or None without FLINT.

    FLINT finds them modulo enough primes that a bound on their size leaves one possibility.

    >>> characteristic(np.array([[2, 1], [1, 3]], dtype=object)) in ([5, -5, 1], None)
    True
    """
    library = flint()
    return None if library is None else [int(entry) for entry in library.fmpz_mat(numbers.tolist()).charpoly().coeffs()]


def flint() -> ModuleType | None:
    """Return the module of python-flint, or None when it is not installed.

    >>> getattr(flint(), "__name__", "flint")
    'flint'
    """
    try:
        import flint as library
    except ImportError:
        return None
    return library


def _ratio(entry: Any) -> tuple[int, int]:
    """Return numerator and positive denominator of a float, an integer or a Fraction, exactly."""
    return (int(entry), 1) if isinstance(entry, np.integer) else entry.as_integer_ratio()
