"""The unit with two slopes: its facts sampled on both sides of the kink, whatever the signs of the slopes."""

import casadi
import numpy as np
import pytest

from inc_casadi.activations import ReLU, TwoSlopes
from inc_casadi.errors import InvalidInputError

GRID = np.concatenate([np.linspace(-3, 3, 61), [1e-300, -1e-300]])


@pytest.mark.parametrize("left, right", [(0.0, 1.0), (1.0, 0.0), (0.3, 0.3), (-0.5, 2.0), (0.7, -1.0), (-1.0, -2.0)])
def test_every_fact_is_true_on_its_graph(left, right):
    phi = TwoSlopes(left, right)
    value = phi(GRID)
    np.testing.assert_array_equal(value, np.where(GRID < 0, left * GRID, right * GRID))
    z = casadi.SX.sym("z")
    np.testing.assert_array_equal([float(casadi.Function("f", [z], [phi.formula(z, casadi)])(r)) for r in GRID], value)
    low, high = phi.slopes
    r, s = np.meshgrid(GRID, GRID)
    quotient = ((phi(r) - phi(s))[r - s > 0.05] / (r - s)[r - s > 0.05])
    assert quotient.min() == pytest.approx(low) and quotient.max() == pytest.approx(high)
    assert phi.bounds[0] <= value.min() and value.max() <= phi.bounds[1]
    assert np.isinf(phi.bounds[0]) == (value.min() < 0) and np.isinf(phi.bounds[1]) == (value.max() > 0)
    assert phi.odd == np.array_equal(phi(-GRID), -value)
    assert phi.homogeneous == (left, right)
    np.testing.assert_array_equal(phi.derivative([-2.0, 0.0, 3.0]), [left, right, right])
    np.testing.assert_array_equal(phi.pieces.slopes[phi.pieces.index(GRID)] * GRID, value)


def test_it_is_the_relu_when_it_should_be_and_refuses_what_is_not_finite():
    np.testing.assert_array_equal(TwoSlopes(0.0, 1.0)(GRID), ReLU()(GRID))
    assert TwoSlopes(0.0, 1.0) == TwoSlopes(0.0, 1.0) != TwoSlopes(1.0, 0.0)
    with pytest.raises(InvalidInputError, match="right slope"):
        TwoSlopes(0.0, np.nan)
