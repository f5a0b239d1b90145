"""Bounds on activations over intervals: true at dense points, and equal to hand calculations."""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import CenteredLogistic, Identity, LeakyReLU, Logistic, ReLU, Saturation, Tanh
from inc_casadi.activations.base import Activation
from inc_casadi.intervals import lines_on, offsets_on, product, range_on


@dataclass(frozen=True)
class Wave(Activation):
    """sin z, which rises and falls and states nothing but its slopes."""

    def formula(self, z, ops):
        return ops.sin(z)

    def derivative(self, z):
        return np.cos(z)

    @property
    def slopes(self):
        return (-1.0, 1.0)


UNITS = (ReLU(), LeakyReLU(0.3), Saturation(), Identity(), Tanh(), Logistic(), CenteredLogistic(), Wave())


def intervals(rng, N=300):
    middle, half = 3 * rng.normal(size=(N, 1)), 10.0 ** rng.uniform(-6, 0.7, size=(N, 1))
    return middle - half, middle + half


@pytest.mark.parametrize("unit", UNITS, ids=str)
def test_lines_and_ranges_hold_at_dense_points(unit):
    low, high = intervals(np.random.default_rng(0))
    z = low + (high - low) * np.linspace(0, 1, 401)
    z[:, -1] = high[:, 0]
    value = unit(z)
    below, above = range_on((unit,), low, high)
    assert np.all(below <= value) and np.all(value <= above)
    for lines in lines_on((unit,), low, high):
        assert np.all(value <= lines.upper_rise * z + lines.upper_offset + 1e-15 * np.abs(z))
        assert np.all(value >= lines.lower_rise * z + lines.lower_offset - 1e-15 * np.abs(z))


@pytest.mark.parametrize("unit", [Tanh(), Logistic(), CenteredLogistic()], ids=str)
def test_lines_of_smooth_units_close_in_with_the_square_of_the_width(unit):
    gaps = []
    for half in (0.1, 0.01):
        parallel, _ = lines_on((unit,), np.array([[0.7 - half]]), np.array([[0.7 + half]]))
        assert parallel.upper_rise == parallel.lower_rise
        gaps.append((parallel.upper_offset - parallel.lower_offset).item())
    assert gaps[1] < gaps[0] / 80 and gaps[0] < 0.1**2


def test_lines_of_a_saturation_by_hand():
    parallel, close = lines_on((Saturation(),), np.array([[-0.5]]), np.array([[2.0]]))
    # Above: from (-0.5, -0.5) to (1, 1), slope 1, or the chord to (2, 1) moved up to (1, 1). Below: the chord, slope 0.6.
    assert close.lower_rise.item() == pytest.approx(0.6) and close.lower_offset.item() == pytest.approx(-0.2)
    assert parallel.upper_offset.item() - parallel.lower_offset.item() == pytest.approx(0.6)


def test_the_range_of_a_unit_that_turns_within_the_interval():
    below, above = range_on((Wave(),), np.array([[0.0]]), np.array([[np.pi]]))
    assert above.item() >= 1.0 and above.item() < 1.2 and -0.2 < below.item() <= 0.0


def test_offsets_keep_every_slope_that_is_asked_for():
    below, above = offsets_on(ReLU(), np.array([[0.0], [1.0]]), np.array([-1.0]), np.array([3.0]))
    assert below[:, 0] == pytest.approx([0.0, 0.0], abs=1e-14) and above[:, 0] == pytest.approx([3.0, 1.0])


def test_products_hold_in_exact_arithmetic():
    rng = np.random.default_rng(1)
    M = rng.normal(size=(3, 4)) * 10.0 ** rng.integers(-8, 8, size=(3, 4))
    low = rng.normal(size=(20, 4))
    high = low + 10.0 ** rng.uniform(-17, 0, size=(20, 4))
    below, above = product(M, low, high)
    for k in range(20):
        for i in range(3):
            worst = [sum(Fraction(M[i, j]) * Fraction((high if (M[i, j] > 0) == up else low)[k, j]) for j in range(4))
                     for up in (True, False)]
            assert Fraction(above[k, i]) >= worst[0] and Fraction(below[k, i]) <= worst[1]
