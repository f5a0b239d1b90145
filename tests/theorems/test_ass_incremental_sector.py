"""ass:incremental_sector: the sector condition on differences, with the slopes that each activation states."""

import numpy as np
import oracles
import pytest

from inc_casadi import INC, CenteredLogistic, Identity, LeakyReLU, Logistic, Plant, ReLU, Saturation, Tanh, close_loop

SLOPES = [(ReLU(), 0.0, 1.0), (LeakyReLU(0.3), 0.3, 1.0), (Saturation(), 0.0, 1.0), (Tanh(), 0.0, 1.0),
          (CenteredLogistic(), 0.0, 0.25), (Logistic(), 0.0, 0.25), (Identity(), 1.0, 1.0)]


def differences(unit):
    rng = np.random.default_rng(13)
    r, s = (np.concatenate([2 * rng.normal(size=3000), 20 * rng.normal(size=1000)]) for _ in range(2))
    r, s = np.concatenate([r, s + 1e-3, [0.5, -0.5, 9.0, -9.0]]), np.concatenate([s, s, [0.25, -0.25, 8.0, -8.0]])
    return r - s, oracles.phi(unit, r) - oracles.phi(unit, s)


@pytest.mark.parametrize(("unit", "low", "high"), SLOPES, ids=lambda value: type(value).__name__)
def test_differences_lie_between_the_stated_slopes(unit, low, high):
    assert unit.slopes == pytest.approx((low, high))
    step, change = differences(unit)
    assert np.all((change - low * step) * (high * step - change) >= -1e-12 * step**2)
    chord = change / step
    assert chord.min() == pytest.approx(low, abs=1e-3) and chord.max() == pytest.approx(high, abs=1e-3)


def test_a_function_in_the_sector_need_not_satisfy_it():
    # phi(z) = z on [-1, 1] and sign(z) / |z| beyond lies in the sector [0, 1] and falls from 1 on: slopes below 0.
    z = np.array([0.5, 1.0, 2.0])
    value = np.where(np.abs(z) <= 1, z, np.sign(z) / np.abs(z))
    assert np.all(value * (z - value) >= 0) and np.diff(value)[1] < 0


def test_a_biased_loop_is_judged_by_slopes_and_an_unbiased_one_by_sectors():
    zero = np.zeros((1, 1))
    at_origin = close_loop(Plant(0.5, 1.0), INC(zero, [[1.0]], [[1.0]], zero, activation=ReLU()))
    biased = close_loop(Plant(0.5, 1.0), INC(zero, [[1.0]], [[1.0]], zero, b=[1.0], activation=Logistic()))
    assert (at_origin.about, biased.about) == ("origin", "difference")
    assert biased.lower.tolist() == [0.0] and biased.upper.tolist() == [0.25]
