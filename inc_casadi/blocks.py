"""Stacking and diagonals for four kinds of matrices: NumPy floats, NumPy objects (Fractions), CVXPY and CasADi.

A matrix inequality is written once with `@ + * .T` and these functions; the kind of its arguments decides whether it is
measured, searched with, differentiated or proved. Foreign kinds are recognized by the name of their module, so that
whoever only checks a certificate needs NumPy alone.
"""

from __future__ import annotations

import sys
from fractions import Fraction
from typing import Any

import numpy as np


def kind(*values: Any) -> str:
    """Return "cvxpy", "casadi" or "numpy": the first foreign kind among the values, else NumPy.

    >>> kind(np.eye(2), 1.0)
    'numpy'
    """
    for value in values:
        root = type(value).__module__.partition(".")[0]
        if root in ("cvxpy", "casadi"):
            return root
    return "numpy"


def hstack(*values: Any) -> Any:
    """Stack matrices side by side.

    >>> hstack(np.eye(1), np.zeros((1, 1)))
    array([[1., 0.]])
    """
    if kind(*values) == "cvxpy":
        return sys.modules["cvxpy"].hstack(values)
    if kind(*values) == "casadi":
        return sys.modules["casadi"].horzcat(*values)
    return np.hstack(values)


def vstack(*values: Any) -> Any:
    """Stack matrices one above the other.

    >>> vstack(np.eye(1), np.zeros((1, 1))).shape
    (2, 1)
    """
    if kind(*values) == "cvxpy":
        return sys.modules["cvxpy"].vstack(values)
    if kind(*values) == "casadi":
        return sys.modules["casadi"].vertcat(*values)
    return np.vstack(values)


def diag(entries: Any) -> Any:
    """Return the diagonal matrix of a vector of any of the four kinds.

    >>> diag(np.array([1.0, 2.0])).tolist()
    [[1.0, 0.0], [0.0, 2.0]]
    """
    if kind(entries) in ("cvxpy", "casadi"):
        return sys.modules[kind(entries)].diag(entries)
    return np.diag(entries)


def he(value: Any) -> Any:
    """Return He(Y) = Y + Y'.

    >>> he(np.array([[0.0, 1.0], [0.0, 0.0]])).tolist()
    [[0.0, 1.0], [1.0, 0.0]]
    """
    return value + value.T


def exact(value: Any) -> np.ndarray:
    """Return the numbers of a float array as Fractions, each exactly the stored double.

    >>> exact(np.array([0.5])).tolist()
    [Fraction(1, 2)]
    """
    array = np.asarray(value)
    if array.dtype == object:
        return array
    out = np.empty(array.shape, dtype=object)
    out.ravel()[:] = [Fraction(float(entry)) for entry in array.flat]
    return out
