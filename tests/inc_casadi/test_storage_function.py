"""`certificate.storage` does along motions what the certificate says it does."""

import numpy as np
import pytest

from inc_casadi import (
    INC,
    Attraction,
    Box,
    DiscountedCost,
    Gaussian,
    Invariance,
    Lifted,
    Plant,
    Regional,
    Spec,
    Stability,
    Tanh,
    certify,
    equilibrium,
    simulate,
)
from inc_casadi.ellipsoid_certificate import EllipsoidCertificate
from inc_casadi.ellipsoidal_region import certify_ellipsoidal
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.linear import LinearController, linear_cost
from inc_casadi.storage_function import stored_value

PLANT = Plant([[0.9, 0.2], [-0.1, 0.95]], [[0.0], [0.3]])
LAW = INC([[0.2, -0.3, 0.0], [0.1, 0.0, 0.2], [0.0, 0.1, 0.1]], [[1.0, 0.5], [-0.4, -1.0], [0.3, -0.2]], [[-0.5, 0.6, 0.1]],
          [[0.0, 0.0]])
BIASED = INC(LAW.W, LAW.U, LAW.V, LAW.K, [0.3, -0.2, 0.1], [0.4])
UNSTABLE, CLIPPED = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]]), INC.saturated([[-1.1, -2.0]], 1.0)
START, LIMITS = Box([-0.8, -0.8], [0.8, 0.8]), Box([-1.0], [1.0])


def starts(number=6, seed=3):
    return np.random.default_rng(seed).normal(size=(2, number))


@pytest.mark.parametrize("law", [LAW, BIASED], ids=["about the origin", "about x*"])
@pytest.mark.parametrize("multiplier", ["relu", Lifted(1), Lifted(2)], ids=["relu", "lifted", "lifted 2"])
def test_the_storage_function_falls_at_the_certified_rate_along_motions(law, multiplier):
    claim = Stability(0.94)
    found = certify(PLANT, law, claim, multiplier=multiplier).require()
    x = simulate(PLANT, law, starts(), steps=25).x
    V = np.stack([found.storage(x[:, i, :]) for i in range(x.shape[1])])
    assert V.shape == x.shape[1:] and np.all(V > 0)
    assert np.all(V[:, 1:] <= claim.rate**2 * V[:, :-1] * (1 + 1e-9) + 1e-12)


def test_a_lifted_storage_function_is_no_quadratic_form():
    found = certify(PLANT, LAW, Stability(0.94), multiplier=Lifted(1)).require()
    x = starts()
    assert np.allclose(found.storage(2 * x), 4 * np.asarray(found.storage(x)))   # no biases: V is homogeneous
    assert np.max(np.abs(np.asarray(found.storage(-x)) / found.storage(x) - 1)) > 0.01


def test_later_hidden_vectors_are_those_of_the_loop():
    plant, law = Plant([[0.5]], [[1.0]]), INC([[0.0]], [[2.0]], [[0.25]], [[0.0]])
    value = stored_value([3.0], np.diag([1.0, 10.0, 100.0]), plant, law)  # eta_0 = 6, u = 1.5, x_1 = 3, eta_1 = 6
    assert value == 9 + 360 + 3600


def test_it_vanishes_where_the_loop_rests():
    found = certify(PLANT, BIASED, Stability(0.94), multiplier="relu").require()
    rest = equilibrium(PLANT, BIASED).x
    assert np.max(np.abs(rest)) > 0.1 and found.storage(rest) < 1e-18 < 1e-3 < found.storage([0.0, 0.0])


def test_it_bounds_the_cost_from_every_state_and_is_the_cost_of_a_linear_law():
    Q, R, initial = np.diag([1.0, 2.0]), [[0.1]], Gaussian([0, 0], np.eye(2))
    x0 = starts()
    for law, at_least in ((LAW, 0.0), (INC.linear([[-0.3, -0.5]]), 0.999)):
        found = certify(PLANT, law, DiscountedCost(Q, R, 0.98, initial)).require()
        share = simulate(PLANT, law, x0, steps=400).cost(Q, R, 0.98) / found.storage(x0)
        assert np.all(share <= 1 + 1e-9) and np.all(share >= at_least)


def test_an_ellipsoid_is_the_level_set_at_its_level():
    values = {"P": [[1.8, 2.4], [2.4, 4.1]]}
    found = EllipsoidCertificate(UNSTABLE, CLIPPED, Attraction(LIMITS), "linear", values).require()
    turn = np.linspace(0, 2 * np.pi, 9)
    rim = np.linalg.solve(np.linalg.cholesky(found.ellipsoid.P).T, np.stack([np.cos(turn), np.sin(turn)]))
    assert np.allclose(found.storage(rim), found.storage_level)
    x = simulate(UNSTABLE, CLIPPED, 0.999 * rim, steps=30).x
    V = np.stack([found.storage(one) for one in x.transpose(1, 0, 2)])
    assert np.all(np.diff(V, axis=1) < 0)


def test_motions_of_a_regional_certificate_end_within_its_level():
    found = certify(UNSTABLE, CLIPPED, Regional(START, LIMITS, np.eye(2), [[0.05]], 0.98)).require()
    V = np.asarray(found.storage(simulate(UNSTABLE, CLIPPED, [0.8, 0.8], steps=40).x))
    inside = np.flatnonzero(V <= found.storage_level)
    assert V[0] == pytest.approx(np.array([0.8, 0.8]) @ found.P @ [0.8, 0.8])
    assert 0 < inside[0] and np.array_equal(inside, np.arange(inside[0], 41)) and np.all(np.diff(V[inside[:20]]) < 0)


def test_an_ellipsoidal_region_has_its_initial_states_within_its_level():
    law = INC([[0.0]], [[1.6]], [[-1.0]], [[0.0]], activation=Tanh())
    found = certify_ellipsoidal(Plant(1.5, 1.0), law, Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-1, 1))).require()
    assert np.max(found.storage([[-1.0, 1.0]])) <= found.storage_level == 1.0


def test_the_storage_function_of_a_linear_controller_starts_its_memory():
    spec = Spec(np.eye(2), [[0.1]], 0.98, START)
    held = LinearController([[0.3]], [[0.1, 0.0]], [[0.5]], [[-0.1, -0.4]], [0.7])
    found = linear_cost(PLANT, spec, held).require()
    x, xi, cost = np.array([0.5, -0.7]), held.xi_0, 0.0
    value = found.storage(x)
    for k in range(600):
        after, u = held.step(xi, x)
        cost += 0.98**k * (x @ x + 0.1 * u @ u)
        x, xi = PLANT.A @ x + PLANT.B @ u, after
    assert value == pytest.approx(cost, rel=1e-6)


def test_a_state_gives_a_number_and_columns_give_a_row():
    found = certify(PLANT, LAW, Stability(0.95), multiplier="sector")
    assert isinstance(found.storage([1.0, 2.0]), float)
    assert found.storage(starts(5)).shape == (5,) and found.storage_level == np.inf
    with pytest.raises(DimensionError, match=r"x has shape \(3,\)"):
        found.storage(np.ones(3))


def test_what_rests_on_no_storage_function_says_so():
    box = Box([-0.1, -0.1], [0.1, 0.1])
    with pytest.raises(InvalidInputError, match="InvarianceCertificate rests on no storage function"):
        certify(PLANT, LAW, Invariance(box)).storage([0.0, 0.0])
    unstable = certify(Plant(2.0, 1.0), INC.linear([[0.0]]), Regional(Box(-1, 1), Box(-1, 1), [[1.0]], [[1.0]], 0.9))
    with pytest.raises(InvalidInputError, match="no terminal ellipsoid"):
        unstable.storage([0.0])
