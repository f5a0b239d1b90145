"""Whole numbers scattered over 64 bits, so that sums of them tell sets and rows apart."""

from __future__ import annotations

import numpy as np


def scattered(numbers: np.ndarray) -> np.ndarray:
    """Return 64-bit numbers for whole numbers >= 0, each bit depending on all bits (the finalizer of SplitMix64).

    Sums of them tell rows apart with near certainty only: whoever uses them checks.

    >>> len(set(scattered(np.arange(1000)).tolist()))
    1000
    """
    z = numbers.astype(np.uint64) + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def distinct_rows(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of first occurrences of the distinct rows (N, q), in no special order, and which each row is.

    Rows are told apart by 64-bit sums; that equal sums stand for equal rows is checked, and sorted out where they do not.

    >>> first, which = distinct_rows(np.array([[1, 2], [3, 4], [1, 2]]))
    >>> sorted(first.tolist()), bool(which[0] == which[2] != which[1])
    ([0, 1], True)
    """
    if rows.size == 0:
        return np.zeros(min(len(rows), 1), dtype=int), np.zeros(len(rows), dtype=int)
    keys = (rows.astype(np.uint64) + np.uint64(1)) @ scattered(np.arange(rows.shape[1]))
    _, first, which = np.unique(keys, return_index=True, return_inverse=True)
    if not np.array_equal(rows[first[which.reshape(-1)]], rows):
        _, first, which = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return first, which.reshape(-1)
