"""The stored numbers of a certificate: those that well-posedness asks for, and any of them as its unknown wants it."""

from __future__ import annotations

from typing import Any

import numpy as np

from .arrays import Array, matrix, symmetric, vector
from .errors import InvalidInputError
from .inc import INC
from .multipliers.base import Unknown


def posed_unknowns(inc: INC) -> tuple[Unknown, ...]:
    """Return T (q,) when Perron-Frobenius does not prove the controller well posed, so that a certificate carries it."""
    return () if inc.contraction.contracts else (Unknown("T", (inc.q,), "nonnegative"),)


def posed_values(inc: INC) -> dict[str, Array]:
    """Return T of the controller's own test where a certificate carries it: zeros when none was found."""
    if inc.contraction.contracts:
        return {}
    T = inc.well_posedness().T
    return {"T": np.zeros(inc.q) if T is None else T}


def checked_value(unknown: Unknown, value: Any) -> Array:
    """Return a value as its unknown wants it: of its shape, symmetric, zero where it must be."""
    if unknown.is_symmetric:
        array = symmetric(unknown.name, value, unknown.shape[0])
    elif len(unknown.shape) == 2:
        array = matrix(unknown.name, value, (unknown.shape[0], unknown.shape[1]))
    else:
        array = vector(unknown.name, value, unknown.shape[0])
    if np.any(array[~unknown.free]):
        raise InvalidInputError(f"{unknown.name} has an entry that must be zero: a product that the multiplier may not use")
    return array
