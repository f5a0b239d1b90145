"""Slopes and sectors on intervals: sampled, sharp, and true to the last digit when recomputed with fifty of them."""

from decimal import Decimal, getcontext

import numpy as np
import pytest

from inc_casadi.activations import (
    Activation,
    CenteredLogistic,
    Identity,
    LeakyReLU,
    Logistic,
    ReLU,
    Saturation,
    Tanh,
)
from inc_casadi.activations.stack import sector_on, slopes_on
from inc_casadi.errors import InvalidInputError

ALL = [ReLU(), LeakyReLU(0.3), Saturation(), Tanh(), CenteredLogistic(), Logistic(), Identity()]
getcontext().prec = 50
DIGITS = Decimal(10) ** -40  # what fifty digits leave uncertain, by far


def tanh(z):
    grown = (2 * z).exp()
    return (grown - 1) / (grown + 1)


PRECISE = {
    Tanh(): tanh,
    CenteredLogistic(): lambda z: tanh(z / 2) / 2,
    Logistic(): lambda z: (1 + tanh(z / 2)) / 2,
    ReLU(): lambda z: max(z, Decimal(0)),
    LeakyReLU(0.3): lambda z: max(z, Decimal(0.3) * z),
    Saturation(): lambda z: max(Decimal(-1), min(z, Decimal(1))),
}


class Wave(Activation):
    """sin: neither pieces nor a bell, so it states its global slopes only."""

    def formula(self, z, ops):
        return ops.sin(z)

    def derivative(self, z):
        return np.cos(z)

    @property
    def slopes(self):
        return (-1.0, 1.0)


def intervals(rng, N=60):
    low = rng.normal(size=N) * 10.0 ** rng.uniform(-3, 0.8, size=N)
    high = low + np.abs(rng.normal(size=N)) * 10.0 ** rng.uniform(-4, 0.8, size=N)
    return np.append(low, [-1.0, 0.0, -1.0, 1.0, -3.0]), np.append(high, [1.0, 2.0, -1.0, 1.0, 0.0])


@pytest.mark.parametrize("phi", [*ALL, Wave()], ids=lambda phi: type(phi).__name__)
def test_chords_inside_an_interval_stay_within_its_slopes(phi):
    rng = np.random.default_rng(0)
    low, high = intervals(rng)
    lowest, highest = phi.slopes_on(low, high)
    r, s = (low + (high - low) * rng.random((400, low.size)) for _ in range(2))
    far = np.abs(r - s) > 1e-7
    slope = (phi(r) - phi(s)) / np.where(far, r - s, 1.0)
    assert np.all((slope >= lowest - 1e-8) | ~far) and np.all((slope <= highest + 1e-8) | ~far)
    assert np.all(lowest >= phi.slopes[0]) and np.all(highest <= phi.slopes[1])


@pytest.mark.parametrize("phi", [*ALL, Wave()], ids=lambda phi: type(phi).__name__)
def test_chords_from_a_center_stay_in_its_sector_and_almost_reach_its_ends(phi):
    rng = np.random.default_rng(1)
    low, high = intervals(rng)
    low, high = low[high - low > 1e-3], high[high - low > 1e-3]
    center = low + (high - low) * rng.random(low.size)
    lowest, highest = phi.sector_on(center, low, high)
    z = np.vstack([low, high, low + (high - low) * rng.random((4000, low.size)), center + 1e-6 * (high - low)])
    far = np.abs(z - center) > 1e-7
    slope = np.where(far, (phi(z) - phi(center)) / np.where(far, z - center, 1.0), np.nan)
    assert np.nanmin(slope - lowest) >= -1e-8 and np.nanmax(slope - highest) <= 1e-8
    if not isinstance(phi, Wave):
        assert np.max(np.nanmin(slope, axis=0) - lowest) < 2e-3
        assert np.max(highest - np.nanmax(slope, axis=0)) < 2e-3


@pytest.mark.parametrize("phi", PRECISE, ids=lambda phi: type(phi).__name__)
def test_no_rounding_makes_a_bound_false(phi):
    rng = np.random.default_rng(2)
    low, high = intervals(rng, 150)
    center = np.where(rng.random(low.size) < 0.3, low, low + (high - low) * rng.random(low.size))
    sector, slopes = phi.sector_on(center, low, high), phi.slopes_on(low, high)
    f = PRECISE[phi]
    for i in range(low.size):
        c = Decimal(center[i])
        for end in (low[i], high[i], low[i] + 0.37 * (high[i] - low[i])):
            z = Decimal(float(min(max(end, low[i]), high[i])))
            if z != c:
                slope = (f(z) - f(c)) / (z - c)
                assert Decimal(sector[0][i]) - DIGITS <= slope <= Decimal(sector[1][i]) + DIGITS
                assert Decimal(slopes[0][i]) - DIGITS <= slope <= Decimal(slopes[1][i]) + DIGITS


@pytest.mark.parametrize("phi", ALL, ids=lambda phi: type(phi).__name__)
def test_a_spread_center_is_covered_wherever_it_is(phi):
    rng = np.random.default_rng(3)
    low, high = intervals(rng)
    center, spread = low + (high - low) * rng.random(low.size), 0.2 * (high - low)
    lowest, highest = phi.sector_on(center, low, high, spread)
    for share in np.linspace(-1, 1, 9):
        c = center + share * spread
        inner = phi.sector_on(c, np.minimum(low, c), np.maximum(high, c))
        assert np.all(inner[0] >= lowest - 1e-9) and np.all(inner[1] <= highest + 1e-4)
        z = low + (high - low) * rng.random((200, low.size))
        far = np.abs(z - c) > 1e-6
        slope = (phi(z) - phi(c)) / np.where(far, z - c, 1.0)
        assert np.all((slope >= lowest - 1e-8) | ~far) and np.all((slope <= highest + 1e-8) | ~far)


def test_known_sectors():
    assert Saturation().sector_on(0.5, -1.0, 1.0)[0] == 1.0                       # inside the linear piece: exactly one
    np.testing.assert_allclose(Saturation().sector_on(0.5, -3.0, 3.0), [0.2, 1.0], atol=1e-13)   # (1 - 1/2) / (3 - 1/2)
    # From c = -2 the chord to the kink at 1 is the steepest, and it lies inside the interval.
    np.testing.assert_allclose(Saturation().sector_on(-2.0, -3.0, 5.0), [0.0, 2 / 3], atol=1e-13)
    np.testing.assert_allclose(ReLU().sector_on(-1.0, -3.0, 1.0), [0.0, 0.5], atol=1e-13)
    np.testing.assert_allclose(Tanh().sector_on(0.0, -0.6, 0.6), [np.tanh(0.6) / 0.6, 1.0], atol=1e-13)
    # From c = 1 the steepest chord touches tanh where its derivative is the chord's slope.
    z = np.linspace(-5.0, 0.9, 100_001)
    steepest = np.max((np.tanh(1.0) - np.tanh(z)) / (1.0 - z))
    assert 0.0 < Tanh().sector_on(1.0, -5.0, 1.0)[1] - steepest < 1e-5
    assert np.all(Tanh().slopes_on(2.0, 3.0)[1] < 0.0707)


def test_an_activation_without_pieces_states_its_global_slopes():
    low, high = Wave().sector_on(np.zeros(2), -np.ones(2), np.ones(2))
    assert low.tolist() == [-1.0, -1.0] and high.tolist() == [1.0, 1.0]


def test_a_column_of_units_takes_each_by_its_own_statement():
    units = (Tanh(), Saturation(), Tanh())
    low, high = np.array([-1.0, -2.0, 0.5]), np.array([1.0, 2.0, 2.0])
    ends = slopes_on(units, low, high)
    for i, unit in enumerate(units):
        assert (ends[0][i], ends[1][i]) == tuple(float(end) for end in unit.slopes_on(low[i], high[i]))
    ends = sector_on(units, np.zeros(3), -np.ones(3), np.ones(3), np.zeros(3))
    assert ends[0][0] == ends[0][2] < ends[0][1] == 1.0


@pytest.mark.parametrize("low, high, message", [(1.0, 0.0, r"\[1, 0\] is not an interval"), (0.0, np.inf, "finite ends"),
                                                (np.nan, 1.0, "finite ends")])
def test_what_is_no_interval_is_refused(low, high, message):
    for phi in (Tanh(), ReLU()):
        with pytest.raises(InvalidInputError, match=message):
            phi.slopes_on(low, high)
        with pytest.raises(InvalidInputError, match=message):
            phi.sector_on(0.0, low, high)


def test_a_negative_spread_is_refused():
    with pytest.raises(InvalidInputError, match="spread = -1 is negative"):
        Tanh().sector_on(0.0, -1.0, 1.0, -1.0)
