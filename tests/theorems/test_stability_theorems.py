"""thm:dt_stability, thm:ct_stability, thm:performance and thm:incremental_certificate, seen on trajectories and at edges."""

import draws
import numpy as np
import oracles
import pytest

from inc_casadi import INC, Gaussian, LeakyReLU, Logistic, Plant, ReLU, Saturation, Tanh, certify
from inc_casadi.claims import DiscountedCost, Stability

ROUNDING = 1 + 1e-9


def random_loop(seed, dt=1.0, bias=0.0, units=draws.MIXED, radius=0.8):
    rng = np.random.default_rng(seed)
    plant, inc = draws.plant(rng, dt=dt, radius=radius), draws.controller(rng, units=units, gain=0.04, bias=bias)
    return plant, inc, draws.points(rng, plant.n, 300), rng


@pytest.mark.parametrize("multiplier", ["sector", "relu"])
def test_discrete_decrease_at_the_certified_rate(multiplier):
    plant, inc, x0, _ = random_loop(101)
    certificate = certify(plant, inc, Stability(), multiplier=multiplier).require()
    x, _ = oracles.roll_out(plant, inc, x0, 30)
    V = oracles.quadratic(certificate.values["P"], x)
    assert np.all(V[:, 1:] <= certificate.bound**2 * V[:, :-1] * ROUNDING + 1e-300)
    # Not idle: the slowest motion seen is not much faster than what is promised.
    assert np.max(V[1:, 30] / V[1:, 10]) > (0.7 * certificate.bound) ** 40


@pytest.mark.parametrize("multiplier", ["sector", "relu"])
def test_continuous_decrease_at_the_certified_rate(multiplier):
    plant, inc, x0, _ = random_loop(102, dt=0.0)
    certificate = certify(plant, inc, Stability(0.8), multiplier=multiplier).require()
    assert certificate.prove()
    x = oracles.flow(plant, inc, x0[:, :60], 2.0, 200)[..., ::20]
    V = oracles.quadratic(certificate.values["P"], x)
    assert np.all(V <= np.exp(-0.8 * np.linspace(0, 2, 11)) * V[:, :1] * (1 + 1e-6) + 1e-300)


@pytest.mark.parametrize("multiplier", ["sector", "relu"])
def test_every_motion_costs_at_most_its_bound(multiplier):
    plant, inc, x0, rng = random_loop(103)
    root = rng.normal(size=(3, 3))
    initial = Gaussian([0.5, -1.0, 0.2], root @ root.T)
    claim = DiscountedCost(np.diag([1.0, 0.0, 2.0]), np.diag([0.3, 0.1]), 0.97, initial)
    certificate = certify(plant, inc, claim, multiplier=multiplier).require()
    x, u = oracles.roll_out(plant, inc, x0, 120)
    paid = oracles.discounted_cost(x, u, claim.Q, claim.R, claim.discount)
    assert np.all(paid <= oracles.quadratic(certificate.values["P"], x0) * ROUNDING)
    x, u = oracles.roll_out(plant, inc, initial.sample(4000, rng), 120)
    mean = oracles.discounted_cost(x, u, claim.Q, claim.R, claim.discount).mean()
    assert 0.3 * certificate.bound < mean < 1.05 * certificate.bound


@pytest.mark.parametrize("units", [(ReLU(), Logistic(), Tanh(), Saturation(), LeakyReLU(0.2))])
def test_biased_motions_approach_each_other_and_the_only_equilibrium(units):
    plant, inc, x0, _ = random_loop(104, bias=1.0, units=units)
    certificate = certify(plant, inc, Stability(0.9)).require()
    assert "equilibrium x*" in certificate.sentence and certificate.prove()
    x, _ = oracles.roll_out(plant, inc, x0, 250)
    V = oracles.quadratic(certificate.values["P"], x - x[:, ::-1])
    assert np.all(V[:, 1:60] <= 0.81 * V[:, :59] * ROUNDING + 1e-20)
    rest = x[..., -1].mean(axis=1)
    np.testing.assert_allclose(x[..., -1], np.tile(rest[:, None], (1, 300)), atol=1e-9)
    assert np.linalg.norm(rest) > 0.1


def test_biased_continuous_motions_approach_each_other():
    plant, inc, x0, _ = random_loop(105, dt=0.0, bias=1.0, units=(ReLU(), Tanh(), Saturation(), Logistic(), ReLU()))
    certificate = certify(plant, inc, Stability(0.5)).require()
    x = oracles.flow(plant, inc, x0[:, :60], 2.0, 200)
    V = oracles.quadratic(certificate.values["P"], x - x[:, ::-1])
    assert np.all(V[:, -1] <= np.exp(-1.0) * V[:, 0] * (1 + 1e-6) + 1e-20)


def test_the_biased_saturation_of_the_appendix_has_a_certified_cost():
    # u = sat(-1.5 x) by two biased ReLUs: u = 0 at x = 0 exactly, so the incremental bound is the cost itself.
    inc = INC(np.zeros((2, 2)), [[1.5], [1.5]], [[-1.0, 1.0]], [[0.0]], b=[1.0, -1.0], d=[1.0])
    plant = Plant([[0.6]], [[0.2]])
    claim = DiscountedCost([[1.0]], [[0.1]], 1.0, Gaussian([0.0], [[4.0]]))
    certificate = certify(plant, inc, claim).require()
    assert certificate.prove()
    x0 = np.linspace(-5, 5, 41)[None]
    x, u = oracles.roll_out(plant, inc, x0, 200)
    paid = oracles.discounted_cost(x, u, claim.Q, claim.R, 1.0)
    P = certificate.values.get("P_0", certificate.values["P"])
    assert np.all(paid <= P.item() * x0[0] ** 2 * ROUNDING)
    shifted = certify(plant, INC(inc.W, inc.U, inc.V, inc.K, inc.b, [1.1]), claim)
    assert not shifted.holds() and not shifted.prove() and "equilibrium x*" in shifted.reason


@pytest.mark.parametrize("multiplier", ["sector", "relu"])
@pytest.mark.parametrize(("v", "stable"), [(0.499, True), (0.501, False), (-1.499, True), (-1.501, False)])
def test_scalar_relu_loop_on_both_sides_of_its_edges(v, stable, multiplier):
    # x+ = 0.5 x + v relu(x): slope 0.5 for x < 0 and 0.5 + v for x > 0, stable while |0.5 + v| < 1.
    inc = INC([[0.0]], [[1.0]], [[v]], [[0.0]])
    certificate = certify(Plant([[0.5]], [[1.0]]), inc, Stability(), multiplier=multiplier)
    assert certificate.holds() == stable and bool(certificate.prove()) == stable
    if stable:
        assert certificate.bound == pytest.approx(0.999, abs=2e-6)


@pytest.mark.parametrize(("v", "rate"), [(0.6, 0.8), (-3.0, 2.0), (0.999, 0.002), (1.001, None)])
def test_scalar_continuous_loop_by_hand(v, rate):
    # dx/dt = -x + v relu(x): rates 1 and 1 - v on the two sides, so alpha = 2 min(1, 1 - v).
    inc = INC([[0.0]], [[1.0]], [[v]], [[0.0]])
    certificate = certify(Plant([[-1.0]], [[1.0]], dt=0), inc, Stability())
    assert certificate.holds() == (rate is not None) == bool(certificate.prove())
    if rate is not None:
        assert rate * (1 - 3e-4) < certificate.bound <= rate


def test_an_implicit_unit_by_hand():
    # eta = relu(w eta + x) = x / (1 - w) for x > 0, so x+ = (0.5 + v / (1 - w)) x: with w = -0.5 the edge is v = 0.75.
    for v, stable in ((0.749, True), (0.751, False)):
        inc = INC([[-0.5]], [[1.0]], [[v]], [[0.0]])
        assert certify(Plant([[0.5]], [[1.0]]), inc, Stability(0.99999), multiplier="relu").holds() == stable


def lure(num, den, k, activation):
    """Negative feedback of num / den with k phi, phi of slope in [0, 1], in controllable form."""
    n = len(den) - 1
    A = np.vstack([-np.array(den[1:]), np.eye(n - 1, n)])
    B, C = np.eye(n, 1), np.array([[0.0] * (n - len(num)) + list(num)])
    return Plant(A, B, C), INC([[0.0]], [[1.0]], [[-k]], [[0.0]], activation=activation)


@pytest.mark.parametrize(("num", "den", "circle"), [
    ([0.1, 0.0], [1, -1.8, 0.81], 0.79331), ([-1, 1.95, -0.9, -0.05], [1, -2.8, 3.5, -2.412, 0.7209], 0.13787),
    ([-0.5, 0.1], [1, -0.9, 0.79, 0.089], 1.02718),
])
def test_the_sector_multiplier_is_the_circle_criterion(num, den, circle):
    # Largest slopes of the circle criterion for examples 1, 3, 5 of Carrasco et al., IEEE TAC 65(11), 2020, Table II.
    for factor, expected in ((0.998, True), (1.002, False)):
        plant, inc = lure(num, den, factor * circle, Tanh())
        certificate = certify(plant, inc, Stability(0.99999), multiplier="sector")
        assert certificate.holds() == expected and bool(certificate.prove()) == expected


def test_a_known_unstable_relu_loop_is_refused_by_every_multiplier():
    # Example 5 of the same table beyond its Nyquist value 2.4475: a growing motion exists for ReLU.
    plant, inc = lure([-0.5, 0.1], [1, -0.9, 0.79, 0.089], 2.46, ReLU())
    x, _ = oracles.roll_out(plant, inc, np.array([[1.0, -1.0], [1.0, 1.0], [1.0, -1.0]]), 4000)
    assert np.max(np.abs(x[..., -1])) > np.max(np.abs(x[..., 0]))
    for multiplier in ("sector", "relu"):
        certificate = certify(plant, inc, Stability(0.999999), multiplier=multiplier)
        assert not certificate.holds() and not certificate.prove()


def test_published_slopes_for_repeated_relu():
    # Turner, Kerr, Sofrony, IJRNC 2015, example 19, as in Richardson et al., L4DC 2024: x+ = Ad x + alpha Bd relu(C x),
    # sampled at 0.01 s. Circle 0.19, circle-like 0.39, Nyquist 0.82; static quadratic constraints of ReLU reach 0.4845.
    A = [[-5.4966, -1.7013, -1.7006, -1.0871, -0.3885, -0.256], [8, 0, 0, 0, 0, 0], [0, 2, 0, 0, 0, 0],
         [0, 0, 2, 0, 0, 0], [0, 0, 0, 2, 0, 0], [0, 0, 0, 0, 0.5, 0]]
    B = [[-0.1747, 0.1242, -0.1618, -0.4348], [0.1069, -0.4609, 0.3498, 0.2012], [-0.2069, -0.2954, -0.1913, 0.5389],
         [-0.3018, 0.4648, 0.6416, 0.3872], [-0.3921, -0.0244, 0.4655, -0.5162], [-0.8676, -0.6227, 0.1863, 0.2499]]
    C = [[-0.0874, -0.438, 0.2355, -0.1751, -0.3313, -0.0954], [-0.5379, 0.0904, -0.0862, 0.0422, 0.077, -0.2257],
         [-0.3988, 0.1378, -0.1092, 0.2767, 0.1642, -0.2763], [0.0327, -0.4871, -0.4322, 0.2185, -0.8372, 0.2476]]
    plant = Plant(A, B, C, dt=0).sampled(0.01)
    for alpha, multiplier, expected in ((0.193, "sector", True), (0.197, "sector", False),
                                        (0.47, "relu", True), (0.49, "relu", False)):
        inc = INC(np.zeros((4, 4)), np.eye(4), alpha * np.eye(4), np.zeros((4, 4)))
        certificate = certify(plant, inc, Stability(1 - 1e-7), multiplier=multiplier)
        assert certificate.holds() == expected and bool(certificate.prove()) == expected, (alpha, multiplier)
