"""sec:numerics_implicit: the certified implicit controller, its published figures, and the cost that is really paid."""

import numpy as np
import oracles
import pytest

from inc_casadi import INC, Box, LeakyReLU, Plant, certify, close_loop
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.claims import DiscountedCost
from inc_casadi.multipliers import Sector

PLANT = Plant([[1.2]], [[1.0]])
CLAIM = DiscountedCost([[1.0]], [[0.05]], 0.98, Box([-1.0], [1.0]))
W = np.array([[0.3, 0.2], [0.2, 0.3]])


def controller(W):
    return INC(W, [[1.0], [-1.0]], [[-0.7, 0.7]], [[0.0]], activation=LeakyReLU(0.5))


# The law is linear with slope -g, and the loop multiplies by a = 1.2 - g (the paper prints 1.2174 and 1.05).
GAIN = {"implicit": 28 / 23, "feedforward": 1.05}
LAWS = {"implicit": controller(W), "feedforward": controller(np.zeros((2, 2)))}


def true_cost(name):
    """(1 + 0.05 g^2) / (1 - 0.98 a^2) per unit of x0^2."""
    return (1 + 0.05 * GAIN[name] ** 2) / (1 - 0.98 * (1.2 - GAIN[name]) ** 2)


@pytest.mark.parametrize(("name", "published"), [("implicit", 1.0744), ("feedforward", 1.0789)])
def test_the_true_cost_by_simulation(name, published):
    x0 = np.array([[1.0, -1.0, 0.3]])
    x, u = oracles.roll_out(PLANT, LAWS[name], x0, 60)
    paid = oracles.discounted_cost(x, u, np.eye(1), 0.05 * np.eye(1), 0.98)
    np.testing.assert_allclose(paid, true_cost(name) * x0[0] ** 2, rtol=1e-12)
    assert true_cost(name) == pytest.approx(published, abs=5e-5)


def test_lambda_max_of_the_published_certificate():
    # eq:performance_lmi typed again: F = [1.2, -0.7, 0.7], G = [0, -0.7, 0.7], Z = [U, W], D0 = I / 2, D1 = I.
    F, G = np.array([[1.2, -0.7, 0.7]]), np.array([[0.0, -0.7, 0.7]])
    Z, H, X = np.array([[1.0, 0.3, 0.2], [-1.0, 0.2, 0.3]]), np.eye(2, 3, 1), np.eye(1, 3)
    P, weight = 1.3006, 0.7749
    M = weight * (-Z.T @ Z + 1.5 * (H.T @ Z + Z.T @ H) - 2 * H.T @ H)
    typed = 0.98 * P * F.T @ F - P * X.T @ X + X.T @ X + 0.05 * G.T @ G + M
    loop, values = close_loop(PLANT, LAWS["implicit"]), {"P": np.array([[P]]), "Lambda": np.full(2, weight)}
    graphs = CLAIM.graphs(loop, Sector())
    decrease = CLAIM.conditions(graphs, values, {"decrease": Sector().matrix(graphs["decrease"], values)})["decrease"]
    np.testing.assert_allclose(-decrease, typed, atol=1e-15)
    assert np.linalg.eigvalsh(typed)[-1] == pytest.approx(-2.228e-5, abs=5e-9)
    certificate = MatrixCertificate(PLANT, LAWS["implicit"], CLAIM, "sector", values)
    assert certificate.holds() and certificate.prove()
    assert certificate.bound == pytest.approx(0.4335, abs=5e-5)


@pytest.mark.parametrize(("name", "P"), [("implicit", 1.30056), ("feedforward", 1.35695)])
def test_the_best_sector_bound(name, P):
    certificate = certify(PLANT, LAWS[name], CLAIM, multiplier="sector")
    assert certificate.values["P"].item() == pytest.approx(P, abs=2e-5)
    assert certificate.holds() and certificate.prove()


@pytest.mark.parametrize(("name", "P"), [("implicit", 1.07442), ("feedforward", 1.07892)])
def test_the_relu_multiplier_certifies_the_true_cost(name, P):
    certificate = certify(PLANT, LAWS[name], CLAIM)
    assert certificate.multiplier.name == "relu" and certificate.holds() and certificate.prove()
    assert certificate.values["P"].item() == pytest.approx(P, abs=1e-5)
    assert 0 < certificate.values["P"].item() - true_cost(name) < 1e-5
    assert certificate.bound == pytest.approx(true_cost(name) / 3, abs=1e-5)


def test_well_posedness_of_the_example():
    test = LAWS["implicit"].well_posedness()
    assert test.radius == pytest.approx(0.5) and test.norm == pytest.approx(0.5) and test.holds
