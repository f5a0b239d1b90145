"""Costs that the paper states, found again by exact subdivision of the initial set."""

from fractions import Fraction

import numpy as np
import oracles
import pytest

from inc_casadi import INC, Box, Plant, Saturation
from inc_casadi.claims.regional import Regional
from inc_casadi.regional_certificate import certify_region

SCALAR = Plant([[1.5]], [[1.0]])
TWO_STATE = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
K_LQR = np.array([[-1.37488222, -2.64897412]])
UNIT = Box([-1.0], [1.0])


def scalar_claim(discount, r=0.0, half=1.0):
    return Regional(Box([-half], [half]), UNIT, [[1.0]], [[r]], discount)


def two_state_claim():
    return Regional(Box([-0.8, -0.8], [0.8, 0.8]), UNIT, np.eye(2), [[0.05]], 0.98)


def two_relu_law():
    """u = 1 - relu(1.5 x + 1) + relu(1.5 x - 1): eq:relu_sat_controller."""
    return INC(np.zeros((2, 2)), [[1.5], [1.5]], [[-1.0, 1.0]], [[0.0]], [1.0, -1.0], [1.0])


@pytest.mark.parametrize("beta", [1.0, 0.98, 0.7, 0.1])
@pytest.mark.parametrize("r", [0.0, 0.1, 8 / 41, 3.0])
def test_longrun_dyn_and_input_penalty_sep(beta, r):
    certificate = certify_region(SCALAR, two_relu_law(), scalar_claim(beta, r)).require()
    assert certificate.expected == pytest.approx(1 / 3 + beta / 36 + r * (5 / 9 + beta / 16), rel=1e-12)
    # By hand: from |x0| = 1 the motion is 1, 1/2, 0 with inputs 1 and 3/4.
    assert certificate.worst[0] == pytest.approx(1 + beta / 4 + r * (1 + beta * 9 / 16), rel=1e-12)
    assert abs(certificate.worst[1][0]) == 1.0 and certificate.margins()["inputs"] == 0.0


def test_longrun_dyn_is_proved_and_beats_every_dynamic_linear_controller():
    certificate = certify_region(SCALAR, two_relu_law(), scalar_claim(1.0))
    assert certificate.prove().succeeded
    assert Fraction(certificate.bound) < Fraction(1, 3) + Fraction(1, 12)


@pytest.mark.parametrize("beta", [1.0, 0.9, 0.25])
def test_lsof_sep(beta):
    certificate = certify_region(SCALAR, INC.linear([[-1.0]]), scalar_claim(beta)).require()
    assert certificate.expected == pytest.approx(1 / (3 * (1 - beta / 4)), rel=1e-12)
    assert certificate.margins()["inputs"] == 0.0
    proof = certificate.prove()
    assert proof.succeeded, proof.reason


def test_two_state_figure():
    certificate = certify_region(TWO_STATE, INC.saturated(K_LQR, 1.0), two_state_claim()).require()
    assert certificate.expected == pytest.approx(1.36496190, abs=1e-8)
    assert len(certificate.walk.done) <= 20
    # The paper's sample, 1.3579 with two standard errors of 0.0071.
    assert abs(certificate.expected - 1.3579) < 2 * 0.0071
    proof = certificate.prove()
    assert proof.succeeded, proof.reason


def test_two_state_figure_against_a_quadrature_of_trajectories():
    # Midpoint rule on a fine grid: its error is of second order, with kinks inside cells.
    ticks = (np.arange(400) + 0.5) / 400 * 1.6 - 0.8
    grid = np.stack(np.meshgrid(ticks, ticks)).reshape(2, -1)
    x, u = oracles.roll_out(TWO_STATE, INC.saturated(K_LQR, 1.0), grid, 60)
    cost = oracles.discounted_cost(x, u, np.eye(2), np.array([[0.05]]), 0.98).mean()
    assert cost == pytest.approx(1.36496190, abs=2e-5)


def test_saturation_relu_realization_has_the_same_cost():
    # app:saturation_relu: sat(v) = relu(v + 1) - relu(v - 1) - 1.
    inc = INC(np.zeros((2, 2)), np.vstack([K_LQR, K_LQR]), [[1.0, -1.0]], np.zeros((1, 2)), [1.0, -1.0], [-1.0])
    certificate = certify_region(TWO_STATE, inc, two_state_claim()).require()
    assert certificate.expected == pytest.approx(1.36496190, abs=1e-8)
    assert len(certificate.walk.done) <= 20


@pytest.mark.parametrize("k2", [-0.9, -0.5, -0.1, 0.3, 0.6, 0.9])
def test_implicit_laws_of_one_family_have_one_cost(k2):
    # eta = sat(k2 eta + (1 - k2) K x): where eta = K x is within the limits it solves this, and beyond them eta = +-1.
    inc = INC([[k2]], (1 - k2) * K_LQR, [[1.0]], np.zeros((1, 2)), activation=Saturation())
    plain = certify_region(TWO_STATE, INC.saturated(K_LQR, 1.0), two_state_claim())
    certificate = certify_region(TWO_STATE, inc, two_state_claim()).require()
    assert certificate.expected == pytest.approx(plain.expected, rel=1e-12)
    assert certificate.worst[0] == pytest.approx(plain.worst[0], rel=1e-12)
