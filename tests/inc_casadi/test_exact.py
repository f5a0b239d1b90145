"""Exact verdicts against determinants by hand, on the edge, and where floating point is wrong."""

import sys
import time
from fractions import Fraction
from itertools import permutations

import numpy as np
import pytest

from inc_casadi import exact
from inc_casadi.blocks import exact as fractions
from inc_casadi.errors import InvalidInputError


@pytest.fixture(params=["python", "flint"], autouse=True)
def arithmetic(request, monkeypatch):
    """Every verdict is asked for twice: with python-flint out of reach, and with it where it is installed."""
    if request.param == "python":
        monkeypatch.setitem(sys.modules, "flint", None)
    else:
        pytest.importorskip("flint")
    return request.param


def determinant(rows):
    """Leibniz' formula: slow, and shares nothing with elimination."""
    total = Fraction(0)
    for order in permutations(range(len(rows))):
        sign = (-1) ** sum(order[i] > order[j] for i in range(len(order)) for j in range(i + 1, len(order)))
        term = Fraction(sign)
        for i, j in enumerate(order):
            term *= rows[i][j]
        total += term
    return total


def sylvester(matrix):
    return all(determinant(matrix[:k, :k]) > 0 for k in range(1, len(matrix) + 1))


def test_random_rational_matrices_agree_with_sylvester():
    rng = np.random.default_rng(41)
    verdicts = []
    for _ in range(150):
        size = int(rng.integers(1, 6))
        root = rng.integers(-3, 4, size=(size, size))
        whole = root @ root.T + int(rng.integers(-1, 2)) * np.eye(size, dtype=int)
        matrix = np.array([[Fraction(int(e), 7) for e in row] for row in whole], dtype=object).reshape(size, size)
        verdicts.append(sylvester(matrix))
        assert exact.is_positive_definite(matrix) == verdicts[-1]
    assert 30 < sum(verdicts) < 120


def test_singular_matrices_are_refused_and_a_hair_above_accepted():
    rng = np.random.default_rng(42)
    for size in (2, 5, 9):
        root = rng.integers(-3, 4, size=(size, size - 1)).astype(object)
        singular = root @ root.T
        assert not exact.is_positive_definite(singular)
        hair = singular * 10**40 + np.eye(size, dtype=int).astype(object)
        assert exact.is_positive_definite(hair)
        assert not exact.is_positive_definite(singular * 10**40 - np.diag([0] * (size - 1) + [1]).astype(object))


def test_hilbert_matrix_beyond_double_precision():
    size = 16
    hilbert = np.array([[Fraction(1, i + j + 1) for j in range(size)] for i in range(size)], dtype=object)
    assert np.linalg.eigvalsh(hilbert.astype(float))[0] < 1e-17
    assert exact.is_positive_definite(hilbert)
    less = hilbert.copy()
    less[0, 0] -= Fraction(1, 10**2)
    assert not exact.is_positive_definite(less)


def test_entries_of_wild_size():
    assert exact.is_positive_definite(fractions(np.diag([1e-300, 1e300, 1.0])))
    assert not exact.is_positive_definite(fractions(np.array([[1e-300, 1e10], [1e10, 1e300]])))
    assert not exact.is_positive_definite(fractions(np.diag([1.0, 0.0])))
    assert exact.is_positive_definite(np.zeros((0, 0), dtype=object))


def test_each_way_to_a_verdict_is_right_by_itself():
    whole = np.array([[4, 2, 0], [2, 5, 1], [0, 1, 3]], dtype=object)
    for decide in (exact._bareiss, exact._signs_decide):
        assert decide(whole) and not decide(whole - 2 * np.eye(3, dtype=int).astype(object)) and not decide(-whole)
        assert not decide(np.array([[1, 1], [1, 1]], dtype=object)) and not decide(-np.eye(2, dtype=int).astype(object))
    factor = np.linalg.cholesky(whole.astype(float) - 0.5 * np.eye(3))
    assert exact._dominant_remainder(whole, 1, factor)
    assert not exact._dominant_remainder(whole, 1, 1.2 * factor)
    indefinite = np.array([[1, 2], [2, 1]], dtype=object)
    assert not exact._dominant_remainder(indefinite, 1, np.zeros((2, 2)))
    assert exact._dominant_remainder(np.array([[3, 2], [2, 3]], dtype=object), 1, np.zeros((2, 2)))
    assert not exact._is_descent(whole, np.array([1.0, 0.0, 0.0]))
    assert exact._is_descent(-whole, np.array([1.0, 0.0, 0.0]))
    assert not exact._is_descent(-whole, np.zeros(3))


def test_without_a_proposal_the_signs_decide(monkeypatch):
    monkeypatch.setattr(exact, "_float_eigenvectors", lambda numbers, scale: None)
    rng = np.random.default_rng(45)
    verdicts = []
    for _ in range(60):
        size = int(rng.integers(1, 6))
        root = rng.integers(-3, 4, size=(size, size)).astype(object)
        matrix = root @ root.T - int(rng.integers(0, 2)) * np.diag(np.arange(size)).astype(object)
        verdicts.append(sylvester(matrix))
        assert exact.is_positive_definite(matrix) == verdicts[-1]
    assert 10 < sum(verdicts) < 50


def test_the_scaled_integers_are_the_matrix_up_to_a_congruence(arithmetic):
    rng = np.random.default_rng(46)
    root = rng.normal(size=(5, 5)) * 10.0 ** rng.uniform(-100, 100, size=5)[:, None]
    matrix = fractions(np.tril(root @ root.T) + np.tril(root @ root.T, -1).T)
    for shifted in (matrix, matrix * Fraction(2) ** 3000, matrix / Fraction(2) ** 3000, matrix / Fraction(7) ** 50, -matrix):
        numbers, scale = exact._integers(shifted)
        for i in range(5):
            ratio = Fraction(numbers[i, i], scale) / shifted[i, i]
            power = ratio.numerator.bit_length() - ratio.denominator.bit_length()
            assert ratio == Fraction(2) ** power and (shifted[i, i] < 0 or Fraction(1, 8) < numbers[i, i] / scale < 8)
            for j in range(5):
                other = Fraction(numbers[i, j], scale) / shifted[i, j]
                assert other**2 == ratio * Fraction(numbers[j, j], scale) / shifted[j, j]
    assert exact._integers(fractions(np.diag([8.0, 2.0])))[1] == 1  # no common power of two is carried along


def test_a_float_or_an_asymmetric_matrix_is_an_error():
    with pytest.raises(InvalidInputError, match="a float slipped in"):
        exact.is_positive_definite(np.array([[1, 0.5], [0.5, 1]], dtype=object))
    with pytest.raises(InvalidInputError, match="symmetric"):
        exact.is_positive_definite(np.array([[1, 0], [1, 1]], dtype=object))
    with pytest.raises(InvalidInputError, match="square"):
        exact.is_positive_definite(np.ones((2, 3), dtype=int).astype(object))
    with pytest.raises(InvalidInputError, match="a float slipped in"):
        exact.is_nonnegative(np.array([0.0]))


def test_nonnegative():
    assert exact.is_nonnegative(fractions(np.array([0.0, -0.0, 5e-324])))
    assert not exact.is_nonnegative(fractions(np.array([[1.0, -5e-324]])))


def test_contraction_on_both_sides_of_the_edge():
    W, slope = np.array([[0.0, -2.0], [0.5, 0.0]]), np.array([1.0, 0.75])
    assert exact.contracts(slope, W, np.array([2.5, 1.0]))
    assert not exact.contracts(slope, W, np.array([2.0, 1.0]))  # equality in the first row
    assert not exact.contracts(np.ones(2), W, np.array([2.5, 1.0]) * [1, 0])
    assert not exact.contracts(np.ones(1), np.array([[0.5]]), np.array([np.nan]))
    assert not exact.contracts(np.ones(1), np.array([[2.0]]), np.array([-1.0]))  # -2 < -1, but no norm
    assert exact.contracts(np.ones(0), np.zeros((0, 0)), np.ones(0))


def test_solve():
    A = fractions(np.array([[0.0, 2.0], [3.0, 1.0]]))
    b = fractions(np.array([1.0, 0.1]))
    x = exact.solve(A, b)
    assert (A @ x - b).tolist() == [0, 0]
    assert exact.solve(fractions(np.array([[1.0, 2.0], [2.0, 4.0]])), b) is None


def test_fast_enough_to_be_asked_often():
    rng = np.random.default_rng(43)
    for size, seconds in ((10, 0.02), (40, 1.0)):
        root = rng.normal(size=(size, size))
        matrix = fractions((root @ root.T + (root @ root.T).T) / 2 + 0.1 * np.eye(size))
        best = np.inf
        for _ in range(3):
            start = time.perf_counter()
            assert exact.is_positive_definite(matrix)
            best = min(best, time.perf_counter() - start)
        assert best < seconds
