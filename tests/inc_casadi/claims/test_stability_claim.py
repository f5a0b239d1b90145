"""The stability claim: its conditions by hand, its words, its refusals."""

import numpy as np
import pytest

from inc_casadi import INC, Plant, ReLU, close_loop
from inc_casadi.claims import Stability
from inc_casadi.errors import InvalidInputError

LAW = INC([[0.0]], [[2.0]], [[-0.3]], [[0.1]], activation=ReLU())
DISCRETE, CONTINUOUS = Plant([[0.5]], [[1.0]]), Plant([[-0.5]], [[1.0]], dt=0)


def test_discrete_condition_by_hand():
    # x+ = 0.6 x - 0.3 eta, so F'PF = 2 [0.36, -0.18; -0.18, 0.09] for P = 2.
    loop = close_loop(DISCRETE, LAW)
    M = np.array([[1.0, 2.0], [2.0, -3.0]])
    conditions = Stability(0.5).conditions(loop, {"P": np.array([[2.0]])}, M)
    np.testing.assert_allclose(conditions["decrease"], [[0.5 - 0.72 - 1.0, 0.36 - 2.0], [0.36 - 2.0, -0.18 + 3.0]])
    assert conditions["P"].tolist() == [[2.0]]


def test_continuous_condition_by_hand():
    # dx/dt = -0.4 x - 0.3 eta: He(X'P Fc) = [-1.6, -0.6; -0.6, 0] for P = 2.
    loop = close_loop(CONTINUOUS, LAW)
    M = np.array([[1.0, 2.0], [2.0, -3.0]])
    conditions = Stability(0.25).conditions(loop, {"P": np.array([[2.0]])}, M)
    np.testing.assert_allclose(conditions["decrease"], [[1.6 - 0.5 - 1.0, 0.6 - 2.0], [0.6 - 2.0, 3.0]])


def test_no_rate_is_the_rate_of_standing_still():
    for plant, rate in ((DISCRETE, 1.0), (CONTINUOUS, 0.0)):
        loop, M, P = close_loop(plant, LAW), np.zeros((2, 2)), {"P": np.eye(1)}
        named = object.__new__(Stability)
        object.__setattr__(named, "rate", rate)
        np.testing.assert_array_equal(Stability().conditions(loop, P, M)["decrease"],
                                      named.conditions(loop, P, M)["decrease"])
        assert Stability().bound(loop, P) == rate


def test_refuses_rates_that_prove_nothing():
    with pytest.raises(InvalidInputError, match="rate = -0.1"):
        Stability(-0.1)
    with pytest.raises(InvalidInputError, match="NaN"):
        Stability(float("nan"))
    with pytest.raises(InvalidInputError, match=r"outside \[0, 1\)"):
        Stability(1.0).check(DISCRETE, LAW)
    with pytest.raises(InvalidInputError, match="must be positive"):
        Stability(0.0).check(CONTINUOUS, LAW)
    Stability(0.0).check(DISCRETE, LAW)
    Stability(7.0).check(CONTINUOUS, LAW)


def test_sentences_speak_about_the_right_equilibrium():
    biased = INC([[0.0]], [[2.0]], [[-0.3]], [[0.1]], b=[1.0])
    values = {"P": np.eye(1)}
    plain = Stability(0.5).sentence(close_loop(DISCRETE, LAW), values)
    shifted = Stability(0.5).sentence(close_loop(DISCRETE, biased), values)
    flowing = Stability(0.5).sentence(close_loop(CONTINUOUS, LAW), values)
    assert "the origin" in plain and "x'P x shrinks at least by the factor 0.5^2" in plain
    assert "equilibrium x*" in shifted and "(x - x*)'P (x - x*)" in shifted
    assert "exp(-0.5 t)" in flowing
