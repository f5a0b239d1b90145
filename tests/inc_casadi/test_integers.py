"""Integer matrices with and without FLINT: the same numbers, by whichever means."""

import sys
from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import integers


def draw(rng, rows, columns, bits):
    return np.array([[int(rng.integers(-(2**31), 2**31)) << bits for _ in range(columns)] for _ in range(rows)],
                    dtype=object).reshape(rows, columns)


@pytest.fixture(params=["python", "flint"])
def arithmetic(request, monkeypatch):
    if request.param == "python":
        monkeypatch.setitem(sys.modules, "flint", None)
    else:
        pytest.importorskip("flint")
    return request.param


def test_floats_fractions_and_integers_over_one_denominator():
    for entries in ([0.1, -2.5, 5e-324, 1e300, 0.0, 3.0], [Fraction(1, 3), Fraction(-5, 7), 4, Fraction(0)],
                    [np.int64(3), 10**40, Fraction(1, 2)]):
        numbers, denominator = integers.over_common_denominator(np.array(entries, dtype=object).reshape(1, -1))
        assert denominator > 0 and all(type(entry) is int for entry in numbers.flat)
        assert [Fraction(entry, denominator) for entry in numbers.flat] == [Fraction(entry) if isinstance(
            entry, float | int | Fraction) else int(entry) for entry in entries]
    assert integers.over_common_denominator(np.float64(0.75))[0].shape == ()
    assert integers.over_common_denominator(np.zeros((0, 2)))[0].shape == (0, 2)
    for entry in (np.nan, np.inf):
        with pytest.raises((ValueError, OverflowError)):
            integers.over_common_denominator(np.array([entry]))


@pytest.mark.parametrize("bits", [0, 200])
def test_products(arithmetic, bits):
    rng = np.random.default_rng(71)
    for shape in ((1, 1, 1), (3, 2, 4), (17, 13, 11), (20, 0, 30)):
        left, right = draw(rng, *shape[:2], bits), draw(rng, *shape[1:], bits)
        found = integers.product(left, right)
        assert found.shape == (shape[0], shape[2]) and found.dtype == object
        for i, j in ((0, 0), (shape[0] - 1, shape[2] - 1), (0, shape[2] - 1)):
            assert found[i, j] == sum(left[i, k] * right[k, j] for k in range(shape[1]))
            assert type(found[i, j]) is int
    vector = draw(rng, 1, 60, bits)[0]
    assert integers.product(draw(rng, 60, 60, bits), vector).shape == (60,)


def test_flint_is_used_where_it_is_installed(arithmetic):
    assert (integers.flint() is None) == (arithmetic == "python")
    assert (integers.characteristic(np.eye(2, dtype=int).astype(object)) is None) == (arithmetic == "python")


def test_the_characteristic_polynomial():
    pytest.importorskip("flint")
    matrix = np.array([[2, 1, 0], [1, 3, 10**20], [0, 10**20, 5]], dtype=object)
    c = integers.characteristic(matrix)
    assert c[3] == 1 and c[2] == -10 and c[1] == 2 * 3 + 2 * 5 + 3 * 5 - 1 - 10**40
    assert c[0] == -(2 * (15 - 10**40) - 5)
