"""Arrays of whole numbers that stand for multiples of 2^-256: sums are exact, a matrix product is rounded down once."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

from .fixed import PLACES, Fixed

Places = np.ndarray  # object arrays of Python integers n, each meaning n 2^-256


def _place(value: Any) -> int:
    if isinstance(value, Fixed):
        return value.n
    fraction = Fraction(value)
    return (fraction.numerator << PLACES) // fraction.denominator


_placed: Callable[[Any], Any] = np.frompyfunc(_place, 1, 1)
_shifted: Callable[[Any, Any], Any] = np.frompyfunc(lambda n, by: n << by if by >= 0 else n >> -by, 2, 1)


def placed(array: Any) -> Places:
    """Return floats, Fractions or Fixed numbers as multiples of 2^-256, rounded down; floats must be finite.

    >>> int(placed(np.array([1.5]))[0]) == 3 << 255
    True
    """
    array = np.asarray(array)
    if array.dtype == float and np.all(np.isfinite(array)):
        return shifted(array, PLACES)
    return np.asarray(_placed(array), dtype=object)


def shifted(array: np.ndarray, places: int) -> Places:
    """Return finite floats as multiples of 2^-places, rounded down.

    A float is a whole number of at most 53 binary digits times a power of two, so only that power is shifted.

    >>> shifted(np.array([0.75, -0.75]), 1).tolist()
    [1, -2]
    """
    digits, power = np.frexp(array)
    whole = np.ldexp(digits, 53).astype(np.int64).astype(object)
    return np.asarray(_shifted(whole, (power + (places - 53)).astype(object)), dtype=object)


def floats(array: Places) -> np.ndarray:
    """Return the nearest floats.

    >>> floats(placed(np.array([[0.1]]))).tolist()
    [[0.1]]
    """
    return np.ldexp(np.asarray(array).astype(float), -PLACES)


def times(left: Places, right: Places) -> Places:
    """Return the matrix product (stacks of matrices allowed), each entry rounded down once: off by less than 2^-256.

    >>> floats(times(placed(np.array([[0.5]])), placed(np.array([[0.25]])))).tolist()
    [[0.125]]
    """
    return (left @ right) >> PLACES


def scaled(left: Places, right: Places) -> Places:
    """Return the product entry by entry, rounded down.

    >>> float(floats(scaled(placed(np.array(0.5)), placed(np.array(3.0)))))
    1.5
    """
    return (left * right) >> PLACES


def determinants(matrices: Places) -> Places:
    """Return the determinants (S,) of (S, n, n), expanded along rows over all sets of columns.

    With entries of magnitude at most M >= 1, a product is rounded once for each row, so each is off by at most
    n n! M^(n - 1) 2^-256.

    >>> floats(determinants(placed(np.array([[[1.0, 2.0], [3.0, 4.0]]])))).tolist()
    [-2.0]
    """
    n = matrices.shape[1]
    minors: dict[int, Places] = {0: np.full(len(matrices), 1 << PLACES, dtype=object)}
    for row in range(n):
        grown: dict[int, Places] = {}
        for columns, minor in minors.items():
            for j in range(n):
                if not columns >> j & 1:
                    sign = -1 if bin(columns >> (j + 1)).count("1") % 2 else 1
                    term = sign * scaled(matrices[:, row, j], minor)
                    chosen = columns | 1 << j
                    grown[chosen] = grown[chosen] + term if chosen in grown else term
        minors = grown
    return minors[(1 << n) - 1]
