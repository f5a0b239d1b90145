"""Validate what comes through the door and freeze it: finite read-only float arrays of the right shape."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import DimensionError, InvalidInputError

Array = NDArray[Any]
"""An array of floats, or of Fractions where exact arithmetic reads the same formula."""


def matrix(name: str, value: ArrayLike, shape: tuple[int | None, int | None] = (None, None)) -> Array:
    """Return `value` as a read-only finite (rows, columns) array; `None` in `shape` leaves a size free.

    A scalar becomes 1 x 1; a vector is refused unless one size of `shape` is 1, so that no row is taken for a column.

    >>> matrix("A", 2.0, (1, 1))
    array([[2.]])
    """
    array = _finite(name, value)
    if array.ndim == 0:
        array = array.reshape(1, 1)
    if array.ndim == 1 and shape[0] == 1:
        array = array.reshape(1, -1)
    if array.ndim == 1 and shape[1] == 1:
        array = array.reshape(-1, 1)
    fits = array.ndim == 2 and all(s is None or s == t for s, t in zip(shape, array.shape, strict=True))
    if not fits:
        wanted = " x ".join("any" if s is None else str(s) for s in shape)
        raise DimensionError(f"{name} has shape {array.shape}, but must be a matrix of {wanted}")
    return frozen(array)


def vector(name: str, value: ArrayLike, size: int | None = None) -> Array:
    """Return `value` as a read-only finite (size,) array; a scalar is repeated only when `size` is 1.

    >>> vector("b", [1, 2])
    array([1., 2.])
    """
    array = np.atleast_1d(_finite(name, value))
    if array.ndim != 1 or (size is not None and array.size != size):
        wanted = "any size" if size is None else f"size {size}"
        raise DimensionError(f"{name} has shape {array.shape}, but must be a vector of {wanted}")
    return frozen(array)


def columns(name: str, value: ArrayLike, rows: int) -> tuple[Array, bool]:
    """Return points as columns (rows, N), and whether a single point (rows,) was given.

    >>> columns("y", [1.0, 2.0], 2)[0].shape
    (2, 1)
    """
    array = _finite(name, value)
    if array.ndim == 0 and rows == 1:
        array = array.reshape(1)
    if array.ndim not in (1, 2) or array.shape[0] != rows:
        raise DimensionError(f"{name} has shape {array.shape}, but must be ({rows},) or ({rows}, N)")
    single = array.ndim == 1
    return (array.reshape(rows, 1) if single else array), single


def symmetric(name: str, value: ArrayLike, size: int | None = None, definite: str = "no") -> Array:
    """Return a symmetric (size, size) array; `definite` is "no", "semi" (>= 0) or "strict" (> 0).

    Asymmetry beyond 1e-9 of the largest entry is an error, less is averaged away; an eigenvalue below
    -1e-12 of the largest one contradicts "semi".

    >>> symmetric("Q", [[1, 0], [0, 0]], definite="semi").shape
    (2, 2)
    """
    array = matrix(name, value, (size, size))
    if array.shape[0] != array.shape[1]:
        raise DimensionError(f"{name} has shape {array.shape}, but must be square")
    scale = float(np.max(np.abs(array), initial=0.0))
    gap = float(np.max(np.abs(array - array.T), initial=0.0))
    if gap > 1e-9 * scale:
        raise InvalidInputError(f"{name} is not symmetric: entries differ from their mirror image by up to {gap:.3g}")
    array = (array + array.T) / 2
    if definite != "no" and array.size:
        smallest = float(np.linalg.eigvalsh(array)[0])
        if smallest < -1e-12 * scale or (definite == "strict" and smallest <= 1e-14 * scale):
            kind = "positive definite" if definite == "strict" else "positive semidefinite"
            raise InvalidInputError(f"{name} must be {kind}, but its smallest eigenvalue is {smallest:.6g}")
    return frozen(array)


def number(name: str, value: float, low: float = -np.inf, high: float = np.inf, *, open_low: bool = False,
           open_high: bool = False) -> float:
    """Return a finite float within [low, high]; `open_low` and `open_high` leave the ends out.

    >>> number("discount", 1, 0, 1, open_low=True)
    1.0
    """
    array = _finite(name, value)
    if array.ndim != 0:
        raise InvalidInputError(f"{name} must be one number, but has shape {array.shape}")
    result = float(array)
    below = result <= low if open_low else result < low
    above = result >= high if open_high else result > high
    if below or above:
        left, right = "(" if open_low else "[", ")" if open_high else "]"
        raise InvalidInputError(f"{name} = {result:g} is outside {left}{low:g}, {high:g}{right}")
    return result


def _finite(name: str, value: ArrayLike) -> Array:
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"{name} is not an array of real numbers: {error}") from error
    if not np.all(np.isfinite(array)):
        raise InvalidInputError(f"{name} holds a NaN or an infinity")
    return array


def frozen(array: Array) -> Array:
    """Return the array made read-only.

    >>> frozen(np.zeros(2)).flags.writeable
    False
    """
    array.setflags(write=False)
    return array
