"""ass:sector: phi(0) = 0 and (phi(z) - m z)(M z - phi(z)) >= 0, with the ends m, M that each activation states."""

import numpy as np
import oracles
import pytest

from inc_casadi import INC, CenteredLogistic, Identity, LeakyReLU, Logistic, Plant, ReLU, Saturation, Tanh, close_loop

Z = np.concatenate([np.linspace(-3, 3, 601), np.geomspace(1e-3, 600, 60), -np.geomspace(1e-3, 600, 60)])
SECTORS = [(ReLU(), 0.0, 1.0), (LeakyReLU(0.3), 0.3, 1.0), (Saturation(), 0.0, 1.0), (Tanh(), 0.0, 1.0),
           (CenteredLogistic(), 0.0, 0.25), (Identity(), 1.0, 1.0)]


@pytest.mark.parametrize(("unit", "low", "high"), SECTORS, ids=lambda value: type(value).__name__)
def test_the_graph_lies_in_the_stated_sector_and_touches_both_ends(unit, low, high):
    assert unit.sector == pytest.approx((low, high))
    value = oracles.phi(unit, Z)
    assert oracles.phi(unit, 0.0) == 0.0
    assert np.all((value - low * Z) * (high * Z - value) >= -1e-12 * Z**2)
    slope = value[Z != 0] / Z[Z != 0]
    assert slope.min() == pytest.approx(low, abs=3e-3) and slope.max() == pytest.approx(high, abs=3e-3)


def test_the_logistic_function_has_no_sector():
    assert Logistic().sector is None and oracles.phi(Logistic(), 0.0) != 0.0


def test_the_loop_takes_its_ends_from_the_units():
    units = (ReLU(), LeakyReLU(0.3), CenteredLogistic())
    inc = INC(np.zeros((3, 3)), np.ones((3, 1)), np.ones((1, 3)), [[0.0]], activation=units)
    loop = close_loop(Plant(0.5, 1.0), inc)
    np.testing.assert_allclose(loop.lower, [0.0, 0.3, 0.0])
    np.testing.assert_allclose(loop.upper, [1.0, 1.0, 0.25])


def test_the_quadratic_constraint_of_the_paper_is_nonnegative_on_the_graph():
    # eq:iqc_nonnegative typed again: 2 (eta - D0 z)' Lambda (D1 z - eta) for eta = phi(z), any Lambda >= 0.
    rng = np.random.default_rng(12)
    units = [unit for unit, _, _ in SECTORS]
    D0, D1 = (np.array([ends[side] for ends in SECTORS]) for side in (1, 2))
    z = rng.normal(size=(len(units), 500)) * 10.0 ** rng.uniform(-2, 2, size=500)
    eta = np.array([oracles.phi(unit, row) for unit, row in zip(units, z, strict=True)])
    Lambda = rng.uniform(0, 3, size=len(units))
    form = 2 * np.einsum("q,qn,qn->n", Lambda, eta - D0[:, None] * z, D1[:, None] * z - eta)
    assert np.all(form >= -1e-12 * np.sum(z**2, axis=0))
