"""sec:separation, as bounds: linear controllers cost at least what the paper says, and the saturated law costs less."""

import numpy as np
import pytest

from inc_casadi import Box, Plant, Spec
from inc_casadi.bounds import affine_moves, any_controller, first_move
from inc_casadi.linear.best_dynamic import best_dynamic_linear
from inc_casadi.linear.static_gain import best_static_gain

SCALAR = Plant(1.5, 1.0)
BETAS = [0.05, 0.5, 0.98, 1.0]
INTERVAL, LIMITS = Box(-1, 1), Box(-1, 1)


def scalar_spec(beta, r=0.0):
    return Spec(1.0, r, beta, INTERVAL, LIMITS)


def saturated_cost(beta, r):
    """E cost of u = -sat(1.5 x) by Gauss-Legendre on the pieces where it is a polynomial of degree 2."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    total = 0.0
    for low, high in ((-1, -2 / 3), (-2 / 3, 2 / 3), (2 / 3, 1)):
        x = (low + high) / 2 + (high - low) / 2 * nodes
        for k in range(6):
            u = -np.clip(1.5 * x, -1, 1)
            total += beta**k * (high - low) / 4 * weights @ (x**2 + r * u**2)
            x = 1.5 * x + u
    return total


@pytest.mark.parametrize("beta", BETAS)
def test_longrun_dyn(beta):
    linear, everyone = first_move(SCALAR, scalar_spec(beta)), any_controller(SCALAR, scalar_spec(beta))
    network = saturated_cost(beta, 0.0)
    assert linear.value == pytest.approx(1 / 3 + beta / 12, abs=1e-7) and linear.value <= 1 / 3 + beta / 12
    assert network == pytest.approx(1 / 3 + beta / 36, rel=1e-12)
    assert linear.value - network > beta / 18 - 1e-7
    assert everyone.value <= network < linear.value and linear.holds() and everyone.holds()


@pytest.mark.parametrize("beta", BETAS)
def test_input_penalty_sep(beta):
    for r in (beta / 2, 0.99 * 8 * beta / (32 + 9 * beta), 0.1 * beta):
        linear, network = first_move(SCALAR, scalar_spec(beta, r)), saturated_cost(beta, r)
        assert linear.value == pytest.approx(1 / 3 + r / 3 + beta / 12, abs=1e-7)
        assert network == pytest.approx(1 / 3 + beta / 36 + r * (5 / 9 + beta / 16), rel=1e-12)
        assert (network < linear.value) == (r < 8 * beta / (32 + 9 * beta))
        assert any_controller(SCALAR, scalar_spec(beta, r), cells=400).value <= network


def test_the_penalty_beyond_the_theorem_makes_the_best_first_move_smaller():
    beta, r = 0.9, 0.9
    kappa = -1.5 * beta / (r + beta)
    true = (1 + r * kappa**2 + beta * (1.5 + kappa) ** 2) / 3
    assert first_move(SCALAR, scalar_spec(beta, r)).value == pytest.approx(true, abs=1e-7)


@pytest.mark.parametrize("beta", BETAS)
def test_lsof_sep(beta):
    gain = best_static_gain(SCALAR, scalar_spec(beta))
    assert gain.admissible and gain.F[0, 0] == pytest.approx(-1, abs=1e-7)
    assert gain.cost == pytest.approx(1 / (3 * (1 - beta / 4)), rel=1e-7)
    dynamic = affine_moves(SCALAR, scalar_spec(beta), 20)
    # A linear controller with memory can bring x_2 to zero, so thm:longrun_dyn is tight, and a static gain is not best.
    assert dynamic.value == pytest.approx(1 / 3 + beta / 12, abs=1e-7) and dynamic.value < gain.cost


def dynamic_limit(beta, r):
    """The infimum over admissible linear controllers of any order, for r <= beta/2, and the gain K that they end with.

    After the first move no limit matters: the rest costs at least beta P E x_1^2, P = 1 + 2.25 beta P r / (r + beta P) the
    Riccati root. So J >= (1 + r D^2 + beta P (1.5 + D)^2) / 3 with |D| <= 1, least at D = -1 as r <= beta P / 2. There
    x_1 = x_0 / 2, and u_k = -K x_k, K = 1.5 beta P / (r + beta P) <= 1.5, keeps the limits from then on:
    |u_1| <= 0.75 and 0 <= 1.5 - K <= 1/2. With r = 0, P = 1: thm:longrun_dyn is tight.
    """
    half = (beta + 2.25 * beta * r - r) / 2
    P = (half + np.sqrt(half**2 + beta * r)) / beta
    return (1 + r + beta * P / 4) / 3, 1.5 * beta * P / (r + beta * P)


@pytest.mark.parametrize("beta", BETAS)
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5])
def test_affine_moves_reach_the_infimum_over_dynamic_linear_controllers(beta, share):
    spec = scalar_spec(beta, share * beta)
    true, _ = dynamic_limit(beta, share * beta)
    bound = affine_moves(SCALAR, spec)
    assert bound.holds() and true - 1e-7 < bound.value <= true
    assert bound.exact_value() <= true + 1e-15


@pytest.mark.parametrize("beta", BETAS)
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5])
def test_the_infimum_is_attained_by_a_controller_of_order_one(beta, share):
    r = share * beta
    true, K = dynamic_limit(beta, r)
    x, xi, total = np.array([-1.0, 1.0]), np.zeros(2), 0.0
    for k in range(200):
        u = (1 - K) / 2 * xi - x
        assert np.max(np.abs(u)) <= 1
        total += beta**k * np.mean(x**2 + r * u**2) / 3  # every x_k is a multiple of x_0, and E x_0^2 = 1/3
        x, xi = 1.5 * x + u, (1 - K) * xi + x
    assert total == pytest.approx(true, rel=1e-12)


@pytest.mark.parametrize("beta, r, gain", [(1.0, 0.0, 0.0), (0.5, 0.0, 0.0), (1.0, 0.1, 0.017316), (1.0, 0.5, 0.074134),
                                           (0.5, 0.05, 0.004298), (0.5, 0.25, 0.017320)])
def test_by_how_much_the_paper_s_bound_can_be_raised(beta, r, gain):
    # beta (P - 1) / 12 over 1/3 + r/3 + beta/12: nothing without an input penalty; 11 % at r = beta/2 = 1/2.
    raised = affine_moves(SCALAR, scalar_spec(beta, r)).value - first_move(SCALAR, scalar_spec(beta, r)).value
    assert raised == pytest.approx(gain, abs=6e-7)
    assert raised == pytest.approx(dynamic_limit(beta, r)[0] - (1 / 3 + r / 3 + beta / 12), abs=1e-7)


@pytest.mark.parametrize("alpha", [-0.7, 0.3])
def test_genuine_of(alpha):
    plant = Plant([[1.5, 0.0], [0.0, alpha]], [[1.0], [0.0]], C=[[1.0, 0.0]])
    spec = Spec(np.diag([1.0, 0.0]), 0.0, 0.9, Box([-1, -2], [1, 3]), LIMITS)
    assert first_move(plant, spec).value == pytest.approx(1 / 3 + 0.9 / 12, abs=1e-6)
    dynamic = affine_moves(plant, spec, 12)  # the moves of time-invariant controllers, for the second state is not measured
    assert dynamic.ties is not None and dynamic.prove() and dynamic.value == pytest.approx(1 / 3 + 0.9 / 12, abs=1e-6)
    assert saturated_cost(0.9, 0.0) < dynamic.value < best_dynamic_linear(plant, spec).bound < dynamic.value + 1e-6
    assert best_static_gain(plant, spec).cost == pytest.approx(1 / (3 * (1 - 0.9 / 4)), rel=1e-6)
    assert any_controller(plant, spec).value <= saturated_cost(0.9, 0.0)


def test_general_certificate_on_the_two_state_plant():
    plant = Plant([[1.10, 1.00], [0.0, 1.02]], [[0.20], [0.50]])
    spec = Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8]), LIMITS)
    gain = best_static_gain(plant, spec)
    linear, everyone = affine_moves(plant, spec, 20), any_controller(plant, spec)
    network = 1.3649619  # exact expected cost of the saturated regulator, eq:two_state_saturated_lqr
    assert first_move(plant, spec).value < network < linear.value < gain.cost
    assert network * (1 - 1e-3) < everyone.value < network  # within 0.1 % of the best there can be


def test_the_last_input_of_the_bound_is_the_paper_s_state_only_index():
    # eq:Jlin_star with R = 0 by its own formula: E|x0|^2 + beta min E|A x0 + B (D x0 + d)|^2 over 0.8 |D|_1 + |d| <= 1.
    A, B, beta = np.array([[1.10, 1.00], [0.0, 1.02]]), np.array([[0.20], [0.50]]), 0.98
    spec = Spec(np.eye(2), 0.0, beta, Box([-0.8, -0.8], [0.8, 0.8]), LIMITS)
    S0 = 0.64 / 3
    share = np.linspace(-1.25, 0, 200_001)
    gains = np.stack([share, -(1.25 + share)])  # the edge of the diamond where the minimum is
    after = A[:, :, None] + B[:, :, None] * gains[None]
    true = S0 * (2 + beta * np.min(np.sum(after**2, axis=(0, 1))))
    assert first_move(Plant(A, B), spec).value == pytest.approx(true, abs=1e-7)
