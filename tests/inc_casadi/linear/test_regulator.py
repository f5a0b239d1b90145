"""The discounted regulator: published gain, optimality on trajectories, and refusals that name the mode."""

import numpy as np
import pytest

from inc_casadi import Box, Gaussian, Plant, Spec
from inc_casadi.errors import InvalidInputError, NotStabilizableError, SolverError
from inc_casadi.linear.regulator import discounted_lqr

N, M = 3, 2


def draw(seed, discount=0.9, dt=1.0):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((N, N))
    spec = Spec(root @ root.T, np.diag([0.3, 2.0]), discount, Gaussian(np.zeros(N), np.eye(N)))
    return Plant(rng.standard_normal((N, N)), rng.standard_normal((N, M)), dt=dt), spec


def test_the_published_gain():
    plant = Plant([[1.10, 1.00], [0.0, 1.02]], [[0.20], [0.50]])
    K, P = discounted_lqr(plant, Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8])))
    np.testing.assert_allclose(K, [[-1.37488222, -2.64897412]], atol=5e-9)
    assert np.trace(P) * 0.64 / 3 == pytest.approx(0.924583, abs=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_P_is_the_cost_of_K_and_no_gain_nearby_is_better(seed):
    plant, spec = draw(seed)
    K, P = discounted_lqr(plant, spec)
    rng = np.random.default_rng(seed)

    def cost(gain, x):
        total = 0.0
        for k in range(3000):
            u = gain @ x
            total += spec.discount**k * (x @ spec.Q @ x + u @ spec.R @ u)
            x = plant.A @ x + plant.B @ u
        return total

    x0 = rng.standard_normal(N)
    assert cost(K, x0) == pytest.approx(x0 @ P @ x0, rel=1e-9)
    for _ in range(5):
        assert cost(K + 1e-3 * rng.standard_normal(K.shape), x0) > cost(K, x0)


def test_continuous_time_against_the_scalar_formula():
    K, P = discounted_lqr(Plant(1.0, 2.0, dt=0.0), Spec(3.0, 0.5, 1.0, Box(-1, 1)))
    assert P[0, 0] == pytest.approx((1 + np.sqrt(1 + 3 * 4 / 0.5)) * 0.5 / 4)
    assert K[0, 0] == pytest.approx(-2 * P[0, 0] / 0.5)
    K, P = discounted_lqr(Plant(1.0, 2.0, dt=0.0), Spec(3.0, 0.5, 0.9, Box(-1, 1)))
    damped = 1.0 + np.log(0.9) / 2  # 0.9 per second: 2 damped P + 3 = 8 P^2
    assert P[0, 0] == pytest.approx((damped + np.sqrt(damped**2 + 3 * 4 / 0.5)) * 0.5 / 4)
    with pytest.raises(InvalidInputError, match="impulse"):
        discounted_lqr(Plant(1.0, 2.0, dt=0.0), Spec(3.0, 0.0, 1.0, Box(-1, 1)))


def test_inputs_without_cost():
    K, P = discounted_lqr(Plant(1.5, 1.0), Spec(1.0, 0.0, 0.8, Box(-1, 1)))
    assert (K[0, 0], P[0, 0]) == pytest.approx((-1.5, 1.0))
    twice = Plant([[1.5, 1.0], [0.0, 1.2]], [[1.0, 2.0, 0.0], [1.0, 2.0, 1.0]])  # three inputs for two states
    K, P = discounted_lqr(twice, Spec(np.eye(2), np.zeros((3, 3)), 1.0, Box([-1, -1], [1, 1])))
    np.testing.assert_allclose(twice.A + twice.B @ K, 0, atol=1e-7)
    np.testing.assert_allclose(P, np.eye(2), atol=1e-7)


def test_an_unstable_mode_without_cost_is_stabilized_all_the_same():
    K, P = discounted_lqr(Plant(2.0, 1.0), Spec(0.0, 1.0, 1.0, Box(-1, 1)))
    assert (K[0, 0], P[0, 0]) == pytest.approx((-1.5, 3.0))


def test_refusals_name_the_mode():
    unreached = Plant(np.diag([1.25, 0.5]), [[0.0], [1.0]])
    spec = Spec(np.eye(2), 1.0, 1.0, Box([-1, -1], [1, 1]))
    with pytest.raises(NotStabilizableError, match="mode 1.25"):
        discounted_lqr(unreached, spec)
    K, _ = discounted_lqr(unreached, Spec(np.eye(2), 1.0, 0.6, spec.initial))  # discounted enough, 0.6 * 1.25^2 < 1
    assert K.shape == (1, 2)
    unseen = Plant([[1.0, 0.0], [0.0, 0.5]], [[1.0], [1.0]])
    with pytest.raises(SolverError, match="mode 1"):
        discounted_lqr(unseen, Spec(np.diag([0.0, 1.0]), 1.0, 1.0, spec.initial))
