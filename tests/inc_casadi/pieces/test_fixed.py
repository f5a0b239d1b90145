"""Numbers of 256 places against Fractions."""

from fractions import Fraction

import numpy as np
import pytest

from inc_casadi.blocks import exact
from inc_casadi.pieces.fixed import PLACES, Fixed, rounded

STEP = Fraction(1, 2**PLACES)


def test_sums_are_exact_and_products_and_quotients_round_down_by_less_than_a_step():
    rng = np.random.default_rng(0)
    for _ in range(200):
        a, b = (Fixed(int(rng.integers(-2**62, 2**62)) * 2**200 + int(rng.integers(2**62))) for _ in range(2))
        x, y = a.fraction(), b.fraction()
        assert (a + b).fraction() == x + y and (a - b).fraction() == x - y and (-a).fraction() == -x
        assert 0 <= x * y - (a * b).fraction() < STEP
        assert 0 <= x / y - (a / b).fraction() < STEP
        assert (3 * a).fraction() == 3 * x and (1 - a).fraction() == 1 - x and (a + 2).fraction() == x + 2
        assert 0 <= x / 3 - (a / 3).fraction() < STEP
        assert (a < b) == (x < y) and (a >= b) == (x >= y) and (abs(a) > 0) == (x != 0)
        assert float(a) == float(x)


def test_matrices_of_them_multiply_and_sort_like_fractions():
    rng = np.random.default_rng(1)
    left, right = rng.standard_normal((3, 4)), rng.standard_normal((4, 2))
    gap = exact(left) @ exact(right) - np.vectorize(Fixed.fraction, otypes=[object])(rounded(left) @ rounded(right))
    assert all(0 <= entry < 4 * STEP for entry in gap.flat)
    entries = rounded(rng.standard_normal(20))
    assert float(entries.max()) == max(map(float, entries)) and int(entries.argmin()) == int(entries.astype(float).argmin())


def test_infinities_are_compared_and_finite_floats_refused():
    low, one = rounded(np.array([-np.inf, 1.0]))
    assert low < one < np.inf and one - low == np.inf and low - one == -np.inf and not one > np.inf
    assert one > 0.5 and one <= 1.0
    with pytest.raises(TypeError, match="must be rounded to a Fixed"):
        one + 0.5
    with pytest.raises(TypeError):
        one * 0.5


def test_rounding_is_downwards():
    third = rounded(np.array([Fraction(1, 3), Fraction(-1, 3)], dtype=object))
    assert 0 < Fraction(1, 3) - third[0].fraction() < STEP and 0 < Fraction(-1, 3) - third[1].fraction() < STEP
