"""The stability claim: its conditions by hand, its promise on trajectories for each rung, its words, its refusals."""

import draws
import numpy as np
import oracles
import pytest

from inc_casadi import INC, Plant, ReLU, Saturation, Tanh, certify, close_loop
from inc_casadi.claims import Stability
from inc_casadi.errors import InvalidInputError
from inc_casadi.multipliers import LADDER, Lifted

LAW = INC([[0.0]], [[2.0]], [[-0.3]], [[0.1]], activation=ReLU())
DISCRETE, CONTINUOUS = Plant([[0.5]], [[1.0]]), Plant([[-0.5]], [[1.0]], dt=0)


def test_discrete_condition_by_hand():
    # x+ = 0.6 x - 0.3 eta, so F'PF = 2 [0.36, -0.18; -0.18, 0.09] for P = 2.
    loop = close_loop(DISCRETE, LAW)
    M = np.array([[1.0, 2.0], [2.0, -3.0]])
    conditions = Stability(0.5).conditions({"decrease": loop}, {"P": np.array([[2.0]])}, {"decrease": M})
    np.testing.assert_allclose(conditions["decrease"], [[0.5 - 0.72 - 1.0, 0.36 - 2.0], [0.36 - 2.0, -0.18 + 3.0]])
    assert conditions["P"].tolist() == [[2.0]]


def test_continuous_condition_by_hand():
    # dx/dt = -0.4 x - 0.3 eta: He(X'P Fc) = [-1.6, -0.6; -0.6, 0] for P = 2.
    loop = close_loop(CONTINUOUS, LAW)
    M = np.array([[1.0, 2.0], [2.0, -3.0]])
    conditions = Stability(0.25).conditions({"decrease": loop}, {"P": np.array([[2.0]])}, {"decrease": M})
    np.testing.assert_allclose(conditions["decrease"], [[1.6 - 0.5 - 1.0, 0.6 - 2.0], [0.6 - 2.0, 3.0]])


def test_no_rate_is_the_rate_of_standing_still():
    for plant, rate in ((DISCRETE, 1.0), (CONTINUOUS, 0.0)):
        loop, M, P = close_loop(plant, LAW), {"decrease": np.zeros((2, 2))}, {"P": np.eye(1)}
        named = object.__new__(Stability)
        object.__setattr__(named, "rate", rate)
        graphs = {"decrease": loop}
        np.testing.assert_array_equal(Stability().conditions(graphs, P, M)["decrease"],
                                      named.conditions(graphs, P, M)["decrease"])
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


def test_lifted_condition_by_hand():
    # v = (x, eta_0), one step on (x_1, eta_1); x_1 = 0.6 x - 0.3 eta_0 over s = (x, eta_0, eta_1).
    loop, P = close_loop(DISCRETE, LAW), np.array([[2.0, 0.5], [0.5, 1.0]])
    graphs = Stability(0.5).graphs(loop, Lifted())
    M = {"decrease": np.diag([0.1, 0.2, 0.3]), "positive": np.diag([0.4, 0.5])}
    found = Stability(0.5).conditions(graphs, {"P": P}, M)
    ahead = np.array([[0.6, -0.3, 0.0], [0.0, 0.0, 1.0]])
    now = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    np.testing.assert_allclose(found["decrease"], 0.25 * now.T @ P @ now - ahead.T @ P @ ahead - M["decrease"])
    np.testing.assert_allclose(found["P"], P - M["positive"])


def storage_of(certificate, x):
    """V along states (n, N, T): v'P v, where v is x or (x, eta_0)."""
    P, plant, inc = certificate.values["P"], certificate.plant, certificate.inc
    if len(P) == plant.n:
        return oracles.quadratic(P, x)
    eta = np.stack([oracles.hidden(inc, plant.C @ x[..., k]) for k in range(x.shape[-1])], axis=-1)
    return oracles.quadratic(P, np.concatenate([x, eta]))


@pytest.mark.parametrize("rate", [0.93, None])
@pytest.mark.parametrize("multiplier", LADDER, ids=lambda multiplier: multiplier.name)
def test_every_rung_keeps_its_promise(multiplier, rate):
    rng = np.random.default_rng(7)
    plant = draws.plant(rng, n=2, m=1, p=2)
    inc = draws.controller(rng, m=1, p=2, units=(ReLU(), ReLU(), Saturation()), gain=0.05)
    found = certify(plant, inc, Stability(rate), multiplier=multiplier)
    assert found.holds() and found.prove() and found.multiplier == multiplier and found.bound < 1
    x, _ = oracles.roll_out(plant, inc, draws.points(rng, 2, 200), 25)
    V = storage_of(found, x)
    assert np.all(V[1:, 0] > 0)  # the first motion rests at the origin
    assert np.all(V[1:, 1:] <= found.bound**2 * V[1:, :-1] * (1 + 1e-9) + 1e-300)
    assert rate is not None or found.bound < 0.9
    # Not idle: some motion shrinks nearly as slowly as promised.
    assert rate is not None or np.max(V[1:, 25] / V[1:, 15]) > (0.7 * found.bound) ** 20


def test_lifted_curved_units_keep_their_promise():
    rng = np.random.default_rng(17)
    plant = draws.plant(rng, n=2, m=1, p=2)
    inc = draws.controller(rng, m=1, p=2, units=(Tanh(), Tanh()), gain=0.3)
    found = certify(plant, inc, Stability(0.95), multiplier="lifted")
    assert found.prove() and found.values["P"].shape == (4, 4)
    x, _ = oracles.roll_out(plant, inc, draws.points(rng, 2, 200, size=3.0), 25)
    V = storage_of(found, x)
    assert np.all(V[1:, 0] > 0) and np.all(V[1:, 1:] <= 0.95**2 * V[1:, :-1] * (1 + 1e-9) + 1e-300)


def test_the_lifted_rung_needs_discrete_time_and_an_equilibrium():
    loop = close_loop(CONTINUOUS, LAW)
    assert "needs discrete time" in Stability().refusal(loop, Lifted())
    assert not certify(CONTINUOUS, LAW, Stability(0.1), multiplier="lifted").holds()
    assert Stability().refusal(close_loop(DISCRETE, LAW), Lifted()) is None
