"""Ranges of controllers by hand, decided without rounding."""

import numpy as np
import pytest

from inc_casadi import INC, Box, LeakyReLU, Polytope, ReLU, Saturation
from inc_casadi.output_range import output_range, within_limits


@pytest.mark.parametrize(("inc", "low", "high"), [
    (INC.saturated([[2.0, 1.0]], 3.0), [-3.0], [3.0]),
    (INC.linear([[1.0]]), [-np.inf], [np.inf]),
    (INC(np.zeros((2, 2)), [[1.0], [1.0]], [[-1.0, 2.0]], [[0.0]], d=[1.0], activation=[ReLU(), Saturation()]),
     [-np.inf], [3.0]),
    (INC(np.zeros((1, 1)), [[1.0]], [[0.0]], [[0.0]], d=[0.5], activation=LeakyReLU()), [0.5], [0.5]),
])
def test_output_ranges_by_hand(inc, low, high):
    found = [(float(below), float(above)) for below, above in output_range(inc)]
    assert found == list(zip(low, high, strict=True))


def test_limits_are_met_to_the_last_bit_or_not_at_all():
    law = INC.saturated([[2.0]], 0.3)
    assert within_limits(law, Box([-0.3], [0.3]))
    assert not within_limits(law, Box([-0.3], [np.nextafter(0.3, 0)]))
    pair = INC.saturated([[2.0], [1.0]], [0.5, 0.5])
    assert within_limits(pair, Polytope([[1, 1], [-1, -1], [1, -1], [-1, 1]], [1.0] * 4))
    assert not within_limits(pair, Polytope([[1, 1], [-1, -1], [1, -1], [-1, 1]], [0.99] * 4))
