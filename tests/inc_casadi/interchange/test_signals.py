"""Tensors that are affine in measurements and units: NumPy's rules for products, and what rounding is judged by."""

import numpy as np
import pytest

from inc_casadi import Box, ReLU, Tanh
from inc_casadi.interchange.signals import Signal, Stack


def test_products_from_both_sides_are_numpys():
    rng = np.random.default_rng(9)
    for shape, left, right in (((3,), (2, 3), (3, 2)), ((2, 3), (4, 2), (3, 5)), ((2, 2, 3), (4, 2), (3, 5)),
                               ((3,), (5, 2, 3), (5, 3, 2)), ((2, 3), (5, 4, 2), (5, 3, 2)), ((3,), (3,), (3,)),
                               ((2, 3), (2,), (3,)), ((4, 2, 3), (2,), (4, 3, 5))):
        y = rng.normal(size=shape)
        signal, row = Signal.measurement(shape), np.concatenate([[1.0], y.ravel()])
        for operand in (left, right):
            M = rng.normal(size=operand)
            found, expected = (signal.rmatmul(M), M @ y) if operand is left else (signal.matmul(M), y @ M)
            np.testing.assert_allclose(found.coefficients @ row, expected, rtol=1e-12, atol=1e-12)


def test_sizes_remember_what_cancelled():
    y = Signal.measurement((1,))
    gone = y.times(np.array(3.0)).minus(y.times(np.array(3.0))).plus(np.array([5.0])).minus(np.array([5.0]))
    assert not gone.coefficients.any() and gone.sizes.tolist() == [[10.0, 6.0]]


def test_a_stack_is_an_inc():
    stack = Stack(2)
    h = stack.activated(Signal.measurement((2,)), ReLU())
    law = stack.controller(stack.activated(h.matmul(np.ones((2, 1))), Tanh()))
    assert law.q == 3 and law([1.0, 2.0]).tolist() == pytest.approx([np.tanh(3.0)])
    assert Box([-1.0], [1.0]).contains(law([9.0, 9.0]))
