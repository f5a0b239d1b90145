"""The sector at the plant input: its form on gains, its disk, its phase, its words."""

import numpy as np
import pytest

from inc_casadi import INC, InputSector, Plant, close_loop
from inc_casadi.errors import InvalidInputError


def form(sector, u, w, tau):
    """s'N s of the stack (x, w) with x = u, one column per pair."""
    m = len(u)
    loop = close_loop(Plant(np.eye(m), np.eye(m)), INC.linear(np.eye(m))).with_inputs(np.eye(m))
    N = sector.matrix(loop, np.eye(2 * m)[m:], {"tau": tau})
    s = np.vstack([u, w])
    return np.einsum("ik,ij,jk->k", s, N, s)


@pytest.mark.parametrize(("low", "high"), [(0.5, 2.0), (0.0, 1.0), (1.0, 1.0), (0.9, 7.0)])
def test_nonnegative_exactly_for_the_gains_of_the_sector(low, high):
    rng = np.random.default_rng(3)
    sector, tau, u = InputSector(low, high), np.array([0.3, 2.0]), rng.normal(size=(2, 500))
    inside = rng.uniform(low, high, size=(2, 500))
    np.testing.assert_allclose(form(sector, u, (inside - 1) * u, tau),
                               2 * tau @ ((inside - low) * (high - inside) * u**2), atol=1e-12)
    assert np.all(form(sector, u, (inside - 1) * u, tau) >= -1e-12)
    for outside in (low - 0.1, high + 0.1):
        assert np.all(form(sector, u, (outside - 1) * u, tau) < 0)


def test_a_linear_system_in_the_disk_has_nonnegative_sums():
    # psi = center + r (1 - p z)/(z - p), started at rest; each term alone may well be negative.
    rng = np.random.default_rng(4)
    sector, negative = InputSector(0.5, 2.0), 0
    for p in (-0.9, 0.0, 0.3, 0.95):
        u, memory, w = rng.normal(size=(1, 300)), 0.0, np.zeros((1, 300))
        u = np.cumsum(u)[None] if p > 0.9 else u
        for k in range(300):
            passed, memory = (1 - p * p) * memory - p * u[0, k], p * memory + u[0, k]
            w[0, k] = 1.25 * u[0, k] + 0.75 * passed - u[0, k]
        terms = form(sector, u, w, np.ones(1))
        assert np.all(np.cumsum(terms) >= -1e-9 * np.sum(np.abs(terms)))
        negative += np.sum(terms < -1e-6)
    assert negative > 100


def test_the_phase_is_where_the_disk_leaves_the_unit_circle():
    for sector in (InputSector(0.5, 2.0), InputSector(0.0, 1.5), InputSector(0.9, 1.05), InputSector.disk(1.9)):
        center, r = (sector.low + sector.high) / 2, (sector.high - sector.low) / 2
        inside, outside = (np.exp(1j * np.radians(sector.phase + step)) for step in (-1e-4, 1e-4))
        assert abs(inside - center) < r < abs(outside - center)
    for none in (InputSector(0.0, 1.0), InputSector(1.0, 1.0), InputSector(0.5, 1.0), InputSector(1.0, 3.0)):
        assert none.phase == 0.0


def test_the_phase_of_a_narrow_sector_keeps_its_digits():
    for alpha in 10.0 ** -np.arange(1, 14.0):
        sector = InputSector.disk(alpha)
        low, high = 1 - sector.low, sector.high - 1  # what rounding has left of the ends, exactly
        assert np.radians(sector.phase) == pytest.approx(np.sqrt(low * high), rel=alpha**2 + 1e-12)


@pytest.mark.parametrize("alpha", [0.0, 0.1, 0.75, 1.9])
def test_the_symmetric_disk(alpha):
    sector = InputSector.disk(alpha)
    assert sector.low * sector.high == pytest.approx(1.0) and sector.low == pytest.approx((2 - alpha) / (2 + alpha))
    assert sector.phase == pytest.approx(np.degrees(2 * np.arctan(alpha / 2)), abs=1e-5)


def test_words_and_refusals():
    static = InputSector(0.5, 2.0).words(False)
    assert "gain between 0.5 and 2 " in static and "phase" not in static
    assert "every phase lag up to 36.8698" in InputSector(0.5, 2.0).words(True)
    third = InputSector(1 / 3, 4 / 3)
    assert "between 0.3333334 and 1.333333 " in third.words(False)  # rounded to the side on which it stays true
    for low, high in ((0.5, 0.9), (1.1, 2.0), (2.0, 0.5)):
        with pytest.raises(InvalidInputError, match="must contain the gain 1"):
            InputSector(low, high)
    with pytest.raises(InvalidInputError, match="low = -0.1"):
        InputSector(-0.1, 2.0)
    with pytest.raises(InvalidInputError, match="alpha = 2 "):
        InputSector.disk(2.0)
    plant = Plant(np.eye(3), np.arange(6.0).reshape(3, 2))
    assert InputSector(0.5, 2.0).entry(plant) is plant.B and InputSector(0.5, 2.0).unknowns(plant)[0].shape == (2,)
