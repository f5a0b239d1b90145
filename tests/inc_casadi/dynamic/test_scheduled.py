"""Observers whose gains differ from step to step: what they estimate, and that their gates cut nothing."""

import numpy as np
import pytest

from inc_casadi import INC, Box, Gaussian, Plant, Regional, Spec
from inc_casadi.dynamic import certify_dynamic, filter_gains, scheduled_observer
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.linear import discounted_lqr

PLANT = Plant([[1.2, 0.7, 0.0], [0.0, 0.8, 0.4], [0.1, 0.0, 0.9]], [[0.3], [0.0], [0.5]], [[1.0, 0.5, 0.0]])
SPEC = Spec(np.diag([1.0, 0.5, 0.2]), 0.1, 0.95, Box([-0.3, -0.2, -0.1], [0.3, 0.4, 0.2]), Box(-2.0, 2.0))
READOUT = INC.saturated(discounted_lqr(PLANT, SPEC)[0], 2.0)
GAINS, LAST = filter_gains(PLANT, SPEC), np.array([[0.9], [0.1], [0.2]])


def estimates(gains, x, steps=6):
    """Estimates (steps, 3, N) by the recursion itself, and the inputs (steps, N), from x (3, N)."""
    xbar, found, inputs = np.repeat(SPEC.initial.mean[:, None], x.shape[1], axis=1), [], []
    for k in range(steps):
        M = gains[k] if k < len(gains) else LAST
        xhat = xbar + M @ (PLANT.C @ (x - xbar))
        u = READOUT(xhat)
        found.append(xhat - x)
        inputs.append(u[0])
        x, xbar = PLANT.A @ x + PLANT.B @ u, PLANT.A @ xhat + PLANT.B @ u
    return np.array(found), np.array(inputs)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_it_is_the_recursion_with_these_gains(count):
    law = scheduled_observer(PLANT, SPEC, READOUT, GAINS[:count], LAST)
    x = SPEC.initial.sample(200, np.random.default_rng(0))
    _, wanted = estimates(GAINS[:count], x)
    xi = np.repeat(law.xi_0[:, None], 200, axis=1)
    for u_wanted in wanted:
        xi, u = law.step(xi, PLANT.C @ x)
        np.testing.assert_allclose(u[0], u_wanted, atol=1e-12)
        x = PLANT.A @ x + PLANT.B @ u
    assert law.order == 3 + count


def test_the_filter_has_the_least_mean_square_error_of_all_affine_estimates():
    """Least squares over many draws knows nothing of Riccati: x_k on (1, y_0, ..., y_k) of the motion without input."""
    x = SPEC.initial.sample(40_000, np.random.default_rng(1))
    xbar, seen = np.repeat(SPEC.initial.mean[:, None], x.shape[1], axis=1), [np.ones(x.shape[1])]
    for k in range(3):
        seen.append((PLANT.C @ x)[0])
        design = np.array(seen).T
        fitted = design @ np.linalg.lstsq(design, x.T, rcond=None)[0]
        xhat = xbar + GAINS[k] @ (PLANT.C @ (x - xbar))
        least = np.mean((fitted - x.T) ** 2, axis=0)
        np.testing.assert_allclose(np.mean((xhat - x) ** 2, axis=1), least, rtol=2e-3, atol=1e-10)
        x, xbar = PLANT.A @ x, PLANT.A @ xhat
    assert len(GAINS) == 3 and np.max(least) < 1e-20


def test_gates_cut_no_set_of_starting_points():
    """With a linear readout the loop is linear and time-varying, so one polytope is followed to the end."""
    free = Regional(SPEC.initial, Box(-50.0, 50.0), SPEC.Q, SPEC.R, SPEC.discount)
    linear = INC.linear(discounted_lqr(PLANT, SPEC)[0])
    found = certify_dynamic(PLANT, scheduled_observer(PLANT, SPEC, linear, GAINS, LAST), free).require()
    assert len(found.inner.walk.arrived) == 1 and found.prove()


def test_measured_states_need_one_gain():
    seen = Plant(PLANT.A, PLANT.B)
    gains = filter_gains(seen, SPEC)
    assert len(gains) == 1
    np.testing.assert_allclose(gains[0], np.eye(3), atol=1e-12)


def test_a_state_that_is_never_seen_keeps_its_variance():
    blind = Plant(np.diag([0.5, 0.5]), [[1.0], [1.0]], [[1.0, 0.0]])
    gains = filter_gains(blind, Spec(np.eye(2), 0.1, 0.95, Box([-1, -1], [1, 1])), steps=4)
    np.testing.assert_allclose(gains[0], [[1.0], [0.0]], atol=1e-12)
    np.testing.assert_allclose(np.array(gains[1:]), 0.0, atol=1e-12)


@pytest.mark.parametrize("changed, error, words", [
    ({"plant": Plant(PLANT.A, PLANT.B, PLANT.C, dt=0)}, InvalidInputError, "continuous"),
    ({"readout": INC.linear([[1.0, 0.0]])}, DimensionError, "the readout maps 2 values to 1 inputs"),
    ({"gains": [np.ones((3, 2))]}, DimensionError, r"gains\[0\]"),
    ({"spec": Spec(np.eye(3), 0.1, 0.9, Gaussian(np.zeros(3), np.eye(3)))}, InvalidInputError, "no bound"),
])
def test_what_does_not_fit_is_refused(changed, error, words):
    parts = {"plant": PLANT, "spec": SPEC, "readout": READOUT, "gains": GAINS, "last": LAST} | changed
    with pytest.raises(error, match=words):
        scheduled_observer(**parts)
