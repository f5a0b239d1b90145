"""Which test decides, what it says, and what it proves in exact arithmetic."""

from dataclasses import replace

import numpy as np
import posed
import pytest

from inc_casadi import INC, LeakyReLU, Logistic, ReLU, Saturation, Tanh
from inc_casadi.activations.stack import slopes
from inc_casadi.well_posed import error_from_residual, is_proved

SKEW = [[0.0, 3.0], [-3.0, 0.0]]


def law(W, activation=None):
    q = len(W)
    return INC(W, np.ones((q, 1)), np.ones((1, q)), [[0.0]], activation=activation or ReLU())


def proved(inc, **changes):
    return is_proved(replace(inc.well_posedness(), **changes), inc.W, slopes(inc.activations))


@pytest.mark.parametrize("W, activation, words", [
    ([[0.5]], ReLU(), "infinity norm 0.5 < 1"),
    ([[0.0, 5.0], [0.1, 0.0]], ReLU(), "Perron-Frobenius radius 0.707107 < 1"),
    (SKEW, ReLU(), "2T - TW - W'T > 0 with smallest eigenvalue at least 1.98 relative to T (Perron-Frobenius radius 3)"),
    ([[-8.0]], Logistic(), "2T - TSW - W'ST > 0 with smallest eigenvalue at least 5.94"),
    ([[-3.0]], LeakyReLU(0.5), "He((I - LW)'T(I - SW)) > 0 with smallest eigenvalue at least 19.8"),
    ([[2.0]], ReLU(), "Perron-Frobenius radius 2 >= 1, and no diagonal T > 0 with 2T - TW - W'T > 0 was found"),
])
def test_it_says_which_test_decided(W, activation, words):
    test = law(W, activation).well_posedness()
    assert words in test.test
    assert test.holds == (test.margin > 0) == ("no diagonal" not in words)
    assert (test.T is not None) == ("eigenvalue" in words) and test.contracts == ("< 1" in words)


def test_perron_frobenius_comes_first_and_T_only_where_it_fails():
    assert law([[-0.5]]).well_posedness().T is None and law([[-0.5]]).well_posedness().margin == pytest.approx(0.5)
    test = law(SKEW, Tanh()).well_posedness()
    assert not test.contracts and test.rate >= 1 and test.margin == test.monotonicity == pytest.approx(0.99)
    assert np.all(np.isfinite(test.lipschitz)) and test.multiplier.T is test.T
    assert INC.linear([[1.0]]).well_posedness().holds


def test_what_is_proved_exactly_is_what_is_stored():
    skew = law(SKEW)
    assert proved(skew) and proved(law([[0.5]])) and not proved(law([[2.0]]))
    assert not proved(skew, T=np.array([1.0, -1.0])) and not proved(skew, T=np.array([1.0, 9.0]))
    assert not proved(skew, monotonicity=1.01) and not proved(skew, T=None)
    assert not proved(law([[0.5]]), weights=np.array([-1.0]))


def test_the_error_bound_follows_the_test_and_the_guard():
    ends = (np.zeros(1), np.ones(1))
    half = law([[0.5]]).well_posedness()
    assert error_from_residual(half, np.array([[0.5]]), ends, np.array([3.0]))[0] == pytest.approx(6.0)
    assert error_from_residual(half, np.array([[0.5]]), ends, np.array([3.0]), 1.1)[0] == pytest.approx(1.1 * 6.0)
    chain = law([[0.0, 0.0], [9.0, 0.0]])
    small = error_from_residual(chain.well_posedness(), chain.W, (np.zeros(2), np.ones(2)), np.array([1.0, 1e-9]))
    np.testing.assert_allclose(small, [1.0, 9.0], rtol=1e-5)  # (I - M)^{-1} residual, far below the weights' bound
    assert error_from_residual(half, np.array([[0.5]]), ends, np.array([3.0]), 2.0)[0] == np.inf
    steep = law([[-3.0]]).well_posedness()
    plain = error_from_residual(steep, np.array([[-3.0]]), ends, np.array([0.4]))[0]
    assert 0.4 <= plain == pytest.approx(0.4 * 5 / 3.96)
    assert error_from_residual(steep, np.array([[-3.0]]), ends, np.array([0.4]), 1.5)[0] == pytest.approx(1.5 * plain)
    assert error_from_residual(law([[2.0]]).well_posedness(), np.array([[2.0]]), ends, np.array([0.4]))[0] == np.inf


def test_an_mpc_law_is_well_posed_though_its_radius_exceeds_one():
    inc = posed.mpc_law()
    test = inc.well_posedness()
    assert np.max(np.abs(np.linalg.eigvals(np.abs(inc.W)))) > 1.3 and test.radius > 1.3 and test.holds
    np.testing.assert_array_equal(test.T, np.ones(4))  # W = I - step H with H > 0: the identity does
    H = (np.eye(4) - inc.W)
    assert 2 * test.monotonicity == pytest.approx(0.99 * 2 * np.linalg.eigvalsh(H)[0], rel=1e-9)
    assert proved(inc)


def test_steepness_of_the_units_counts():
    # relu(w eta + c) with w = 1.5 is ill posed, 4 sat(w z / 4) too, but a logistic unit of slope 1/4 is not.
    assert not law([[1.5]]).well_posedness().holds and not law([[1.5]], Saturation()).well_posedness().holds
    assert law([[1.5]], Logistic()).well_posedness().contracts
    assert not law([[4.5]], Logistic()).well_posedness().holds and law([[-4.5]], Logistic()).well_posedness().T is not None
