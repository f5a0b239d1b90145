"""The two readings against each other: the exact result lies within the rounding bound, and the bound is not idle."""

from fractions import Fraction

import numpy as np
import pytest

from inc_casadi.blocks import diag, he, hstack, vstack
from inc_casadi.readings import Rational, Rounded


def expression(A, B, c, v):
    """A bit of everything that an inequality may use."""
    stacked = vstack(hstack(A, B), hstack(B.T, c * (B.T @ B)))
    return he(stacked @ stacked.T) - 3 * (stacked @ diag(v) @ stacked.T) + (-stacked[[0, 1, 2, 3, 4], :]).T * 0.1


def draw(seed):
    rng = np.random.default_rng(seed)
    A, B, v = rng.normal(size=(3, 3)), rng.normal(size=(3, 2)), rng.normal(size=5)
    return A + A.T, B, np.float64(0.1), v


@pytest.mark.parametrize("seed", range(4))
def test_the_exact_result_is_within_the_bound(seed):
    A, B, c, v = draw(seed)
    rounded = expression(Rounded.lift(A), Rounded.lift(B), c, Rounded.lift(v))
    rational = expression(Rational.lift(A), Rational.lift(B), c, Rational.lift(v))
    np.testing.assert_allclose(rounded.value, expression(A, B, c, v), rtol=1e-13, atol=1e-13)
    exact = rational.fractions()
    gap = np.array([[abs(Fraction(float(x)) - y) for x, y in zip(*rows, strict=True)]
                    for rows in zip(rounded.value, exact, strict=True)], dtype=float)
    assert gap.max() > 0  # floating point did round
    assert np.all(gap <= rounded.error)
    assert rounded.error.max() < 1e-12


def test_cancellation_leaves_the_bound_where_it_was():
    big = Rounded.lift(np.array([[1e16]]))
    left = big + 1.0 - big
    assert left.error.item() >= abs(left.value.item() - 1.0)


def gap_within(rounded, exact):
    """Whether the exact Fractions lie within the bound, compared without rounding."""
    return all(abs(Fraction(float(v)) - x) <= Fraction(float(e)) for v, e, x in
               zip(rounded.value.flat, np.broadcast_to(rounded.error, rounded.shape).flat, exact.flat, strict=True))


@pytest.mark.parametrize("unit", [1e-60, 1e-110, 1e-155, 1e-200, 5e-324])
def test_underflow_is_within_the_bound(unit):
    A, B, c, v = draw(5)
    A, B = unit * A, unit * B
    for grown in (1.0, 1e100, 1e150):
        # What has been lost in the products is blown up afterwards, where the relative bound sees nothing of it.
        rounded = grown * (grown * (expression(Rounded.lift(A), Rounded.lift(B), c, Rounded.lift(v))))
        rational = grown * (grown * (expression(Rational.lift(A), Rational.lift(B), c, Rational.lift(v))))
        assert gap_within(rounded, rational.fractions())


def test_a_product_that_vanishes_keeps_a_bound():
    small = Rounded.lift(np.array([[1e-200]]))
    square = small @ small
    assert square.value.item() == 0 and 0 < square.error.item() < 1e-300
    back = (square * 1e200) * 1e200
    assert back.value.item() == 0 and back.error.item() >= 1.0
    assert (small * 3.0).error.item() < 1e-214  # where nothing underflows, the bound stays relative


def flushed(product):
    """The product of a processor that reads and stores numbers below 2^-1022 as zero."""
    def flush(array):
        return np.where(np.abs(array) < 2.0**-1022, 0.0, array)
    return lambda left, right: flush(product(flush(left), flush(right)))


def test_flushing_to_zero_is_within_the_bound():
    rng = np.random.default_rng(44)
    for _ in range(50):
        A, B = (rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-320, -100, size=(3, 3)) for _ in range(2))
        C = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(0, 150, size=(3, 3))
        product = Rounded.lift(A).times(Rounded.lift(B), flushed(np.multiply), 1)
        product = product.times(Rounded.lift(C), flushed(np.matmul), 3)
        exact = Rational.lift(A).times(Rational.lift(B), np.multiply, 1) @ C
        assert gap_within(product, exact.fractions())
        assert gap_within(Rounded.lift(C).times(Rounded.lift(A), flushed(np.matmul), 3),
                          (Rational.lift(C) @ A).fractions())


def test_an_exact_zero_keeps_its_bound_until_something_may_underflow():
    zero, one = Rounded.lift(np.zeros((2, 2))), Rounded.lift(np.array([[1.0, 0.0], [1e-100, 3.0]]))
    for result in (zero + zero, one @ one - 0.0, 2.0 * one, zero @ one, -one, one.T * Rounded.lift(np.full((2, 2), 1e-150))):
        assert result.lost == 0 and np.all(result.error[result.size == 0] == 0)
    assert np.all((one @ one).error[(one @ one).size > 0] > 0)
    for result in (one * 1e-180, Rounded.lift(np.array([[5e-324]])) + 1.0, Rounded.lift(np.array([[1e-290]])) + 1e-290,
                   Rounded(np.array([[1.0]]), np.array([[1e-300]]), 1) * 1.0):
        assert result.lost > 0


@pytest.mark.parametrize("power", range(-1074, -840, 13))
def test_no_power_of_two_slips_through(power):
    rng = np.random.default_rng(46)
    for _ in range(20):
        A, B = rng.normal(size=(2, 2)), rng.normal(size=(2, 2))
        split = int(rng.integers(-300, 300))
        A, B = np.ldexp(A, power // 2 + split), np.ldexp(B, power - power // 2 - split)
        product = Rounded.lift(A).times(Rounded.lift(B), flushed(np.matmul), 2)
        total = product.plus(Rounded.lift(np.where(np.abs(A) < 2.0**-1022, 0.0, A)))
        grown = total * 2.0**900
        rational = (Rational.lift(A) @ B + np.where(np.abs(A) < 2.0**-1022, 0.0, A)) * 2.0**900
        assert gap_within(grown, rational.fractions())


def test_every_operation_passes_on_what_was_lost():
    lost = Rounded(np.zeros((1, 1)), np.zeros((1, 1)), 1, 1.0)
    for result in (lost + 0.0, 0.0 - lost, lost.T, lost[[0]], hstack(np.ones((1, 1)), lost), vstack(lost, np.eye(1)),
                   lost + lost, 1.0 * lost, lost @ np.eye(1), np.eye(1) @ lost, diag(lost[0])):
        assert result.lost >= 1.0 and np.all(result.error >= 2.0)
    assert (lost * 5.0).lost >= 5.0 and (np.full((1, 2), 3.0) @ vstack(lost, lost)).lost >= 6.0


def test_the_bound_ends_where_gamma_is_not_small():
    power = Rounded.lift(np.eye(1))
    for _ in range(39):
        power = power * power
    assert np.isfinite(power.error.item())
    assert (power * power * power).error.item() == np.inf


def test_numbers_that_are_read_as_they_stand_have_no_error():
    assert Rounded.lift(np.array([0.1, 1e-310])).error.tolist() == [0.0, 0.0]


def test_fractions_are_read_as_the_nearest_floats():
    entries = [Fraction(1, 3), Fraction(-2, 7), Fraction(5), Fraction(1, 10**320), Fraction(1, 10**400), 10**30, Fraction(0)]
    array = np.array(entries, dtype=object)
    rounded = Rounded.lift(array)
    assert rounded.steps == 1 and rounded.value[0] == 1 / 3 and rounded.value[4] == 0
    assert gap_within(rounded, array)
    assert np.all(rounded.error[:3] < 1e-14) and np.all(rounded.error[4:] > 0)
    assert Rational.lift(array).fractions().tolist() == entries
    third = Rounded.lift(Fraction(1, 3)) * 3 - 1
    assert third.shape == () and abs(third.value) <= third.error


def test_a_fraction_too_large_for_a_float_is_infinite():
    rounded = Rounded.lift(np.array([Fraction(10**400), Fraction(-(10**400)), -(10**400)], dtype=object))
    assert rounded.value.tolist() == [np.inf, -np.inf, -np.inf] and np.all(rounded.error == np.inf)


def test_products_of_fractions_agree_with_those_of_rationals():
    rng = np.random.default_rng(45)
    parts = rng.integers(1, 10**9, size=(3, 4, 2)).tolist()
    A = np.array([[Fraction(above, below) for above, below in row] for row in parts], dtype=object)
    rounded, rational = (kind.lift(A) @ kind.lift(A).T - kind.lift(A[:, :3]) * Fraction(1, 7)
                         for kind in (Rounded, Rational))
    assert gap_within(rounded, rational.fractions()) and rounded.error.max() < 1e-5 * abs(rounded.value).max()


def test_plain_arrays_are_lifted_on_either_side():
    R = Rational.lift(np.array([[0.1, 0.2]]))
    for result in (np.eye(1) @ R, R @ np.eye(2), R + np.zeros((1, 2)), np.zeros((1, 2)) + R, R - 0.0, 0.0 - (-R), 1.0 * R):
        assert result.fractions().tolist() == [[Fraction(0.1), Fraction(0.2)]]
    assert (np.ones((1, 2)) - R).fractions().tolist() == [[1 - Fraction(0.1), 1 - Fraction(0.2)]]
    with pytest.raises(TypeError):
        np.linalg.norm(R)


def test_empty_matrices():
    for kind in (Rounded, Rational):
        empty = kind.lift(np.zeros((2, 0)))
        product = empty @ empty.T
        assert product.shape == (2, 2)
        assert (product + np.eye(2)).shape == (2, 2)
        assert diag(kind.lift(np.zeros(0))).shape == (0, 0)
