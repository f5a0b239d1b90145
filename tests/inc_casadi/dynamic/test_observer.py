"""Observers with an implicit readout: what separates, and certificates by matrix inequalities on the extended plant."""

import numpy as np
import pytest

from inc_casadi import INC, Attraction, Box, DiscountedCost, Plant, Spec, Stability, Tanh, certify, simulate
from inc_casadi.dynamic import corrected, extended, extended_spec, observer, observer_gain
from inc_casadi.errors import DimensionError, InfeasibleError
from inc_casadi.linear import discounted_lqr

DOUBLE = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]])
STABLE = Plant([[0.85, 0.45, 0.0], [-0.4, 0.85, 0.2], [0.0, 0.0, 0.6]], [[0.0], [0.3], [1.0]], [[1.0, 0.0, 0.3]])
GAIN = observer_gain(STABLE, np.eye(3), 0.5)


def clipped(plant: Plant, limit: float) -> INC:
    n = plant.n
    K, _ = discounted_lqr(plant, Spec(np.eye(n), 0.1, 0.95, Box(-np.ones(n), np.ones(n))))
    return INC.saturated(K, limit)


@pytest.mark.parametrize("reads_y", [False, True])
def test_estimate_follows_the_plant_under_the_clipped_input(reads_y):
    inc = clipped(DOUBLE, 0.3)
    readout = corrected(inc, [[0.5], [0.2]], DOUBLE.C) if reads_y else inc
    gain, start = np.array([[1.2], [0.4]]), np.array([0.3, -0.2])
    run = simulate(*extended(DOUBLE, observer(DOUBLE, gain, readout, start)), [1.0, 0.4, *start], steps=6)
    x, xhat, clips = np.array([1.0, 0.4]), start, 0
    for k in range(7):
        np.testing.assert_allclose(run.x[:, k], np.concatenate([x, xhat]), atol=1e-12)
        seen = xhat + np.array([0.5, 0.2]) * (x[0] - xhat[0]) if reads_y else xhat
        u = inc(seen)
        clips += abs(u[0]) == 0.3
        x, xhat = DOUBLE.A @ x + DOUBLE.B @ u, DOUBLE.A @ xhat + DOUBLE.B @ u + gain @ (DOUBLE.C @ (x - xhat))
    assert clips >= 2


def test_error_runs_by_itself():
    n = STABLE.n
    start = np.random.default_rng(1).standard_normal((2 * n, 50))
    run = simulate(*extended(STABLE, observer(STABLE, GAIN, clipped(STABLE, 0.2))), start, steps=12)
    error = run.x[:n] - run.x[n:]
    for k in range(13):
        alone = np.linalg.matrix_power(STABLE.A - GAIN @ STABLE.C, k) @ error[:, :, 0]
        np.testing.assert_allclose(error[:, :, k], alone, atol=1e-12)


def test_certified_rate_of_the_full_state_bounds_the_driven_estimate():
    n, inc = STABLE.n, clipped(STABLE, 0.2)
    certificate = certify(Plant(STABLE.A, STABLE.B), inc, Stability(), multiplier="sector").require()
    P, rate = certificate.values["P"], certificate.bound
    assert rate < 1 and np.max(np.abs(np.linalg.eigvals(STABLE.A - GAIN @ STABLE.C))) < 1
    start = 3 * np.random.default_rng(2).standard_normal((2 * n, 200))
    run = simulate(*extended(STABLE, observer(STABLE, GAIN, inc)), start, steps=150)
    estimate, drive = run.x[n:], np.tensordot(GAIN @ STABLE.C, run.x[:n] - run.x[n:], axes=1)
    size, pushed = (np.sqrt(np.einsum("ijk,il,ljk->jk", part, P, part)) for part in (estimate, drive))
    assert np.all(size[:, 1:] <= rate * size[:, :-1] + pushed[:, :-1] + 1e-10)
    assert np.max(np.abs(run.x[:, :, -1])) < 1e-3 * np.max(np.abs(start))


@pytest.mark.slow
def test_stable_plant_is_certified_globally_with_memory():
    spec = Spec(np.diag([1.0, 2.0, 0.5]), 0.2, 0.97, Box([-1, -0.5, -0.3], [1, 0.5, 0.6]))
    dynamic = observer(STABLE, GAIN, clipped(STABLE, 0.2), [0.1, -0.2, 0.0])
    wide, law = extended(STABLE, dynamic)
    asked = extended_spec(spec, dynamic)
    assert certify(wide, law, Stability()).prove()
    certificate = certify(wide, law, DiscountedCost(asked.Q, asked.R, asked.discount, asked.initial))
    assert certificate.prove()
    x = spec.initial.sample(4000, np.random.default_rng(3))
    costs = simulate(wide, law, np.vstack([x, np.repeat([[0.1], [-0.2], [0.0]], 4000, axis=1)]), steps=300).cost(
        asked.Q, asked.R, asked.discount)
    assert costs.mean() - 4 * costs.std() / np.sqrt(4000) <= certificate.bound


def test_tanh_readout_of_an_observer_attracts_from_positions_and_speeds():
    K = clipped(DOUBLE, 0.5).U[0] * 0.5
    smooth = INC([[0.0]], [K / 0.5], [[0.5]], [[0.0, 0.0]], activation=Tanh())
    dynamic = observer(DOUBLE, observer_gain(DOUBLE, np.eye(2) / 3, 0.01), smooth)
    corners = np.array([[0.4, 0.4, -0.4, -0.4], [0.2, -0.2, 0.2, -0.2], [0.0] * 4, [0.0] * 4])
    wide, law = extended(DOUBLE, dynamic)
    certificate = certify(wide, law, Attraction(directions=corners)).require()
    P = certificate.values["P"]
    assert np.max(np.einsum("ij,ik,kj->j", corners, P, corners)) <= 1
    run = simulate(wide, law, corners, steps=300)
    assert np.all(np.einsum("ijk,il,ljk->jk", run.x, P, run.x) <= 1 + 1e-9)
    assert np.max(np.abs(run.x[:, :, -1])) < 1e-6


def test_gain_of_a_scalar_filter_is_the_one_by_hand():
    # S = 4 S - 4 S^2 / (S + 1) + 1 has the root S = 2 + sqrt(5), and L = 2 S / (S + 1).
    S = 2 + np.sqrt(5)
    np.testing.assert_allclose(observer_gain(Plant(2.0, 1.0), 1.0, 1.0), [[2 * S / (S + 1)]], rtol=1e-9)


def test_unseen_mode_and_misfits_are_refused():
    with pytest.raises(InfeasibleError, match="does not show the mode 2"):
        observer_gain(Plant([[2.0, 0.0], [0.0, 0.5]], [[1.0], [1.0]], [[0.0, 1.0]]), np.eye(2), 1.0)
    with pytest.raises(DimensionError, match="the readout maps 4 values to 1 inputs"):
        observer(DOUBLE, [[1.0], [0.0]], INC.linear(np.ones((1, 4))))
    with pytest.raises(DimensionError, match="L has shape"):
        observer(DOUBLE, np.ones((2, 2)), clipped(DOUBLE, 1.0))
