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
