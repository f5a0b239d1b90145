"""How much lies beyond a level: never below samples or exact integrals, and not far above."""

import numpy as np
import pytest

from inc_casadi import Box, Ellipsoid, Empirical, Gaussian, Uniform
from inc_casadi.linear.tails import beyond, moments_known


@pytest.mark.parametrize("power, exact", [(1, lambda t: (1 - t) ** 2 / 2), (2, lambda t: (1 - t) ** 3 / 3)])
def test_one_uniform_variable_by_hand(power, exact):
    """|v| is uniform on [0, 1]: E max(|v| - t, 0)^p = (1 - t)^(p + 1) / (p + 1)."""
    for t in (0.1, 0.5, 0.9):
        bound = beyond(np.array(np.sqrt(1 / 3)), np.array(t), np.array(1.0), power, 30).item()
        assert exact(t) <= bound <= min(1.0, 10 * exact(t) ** 0.9)


@pytest.mark.parametrize("a", [np.ones(12) / 2, np.array([1.0, 0.1, 0.1]), np.array([0.7, 0.7])])
@pytest.mark.parametrize("power", [1, 2])
def test_sums_of_uniform_variables_by_sampling(a, power):
    v = np.random.default_rng(0).uniform(-1, 1, (200_000, a.size)) @ a
    deviation, most = np.sqrt(np.sum(a**2) / 3), np.abs(a).sum()
    for t in np.array([0.5, 1.0, 1.7, 2.5]) * deviation:
        seen = np.mean(np.maximum(np.abs(v) - t, 0) ** power)
        bound = beyond(np.array(deviation), np.array(t), np.array(most), power, 30).item()
        assert seen * 0.97 <= bound
        assert a.size < 12 or bound <= 6 * seen


def test_two_moments_alone_bound_any_distribution():
    v = np.random.default_rng(1).standard_exponential(100_000) - 1
    seen = np.mean(np.maximum(np.abs(v) - 2, 0))
    assert seen <= beyond(np.array(1.0), np.array(2.0), np.array(np.max(v)), 1, 1).item() <= 1 / 8 * (1 + 1e-8)


def test_nothing_lies_beyond_the_largest():
    assert beyond(np.array([1.0]), np.array([2.0]), np.array([2.0]), 2, 30).tolist() == [0.0]


@pytest.mark.parametrize("n", [1, 2, 5])
@pytest.mark.parametrize("support", [lambda n: Box(-np.ones(n), 2 * np.ones(n)),
                                     lambda n: Ellipsoid(np.diag(np.arange(1.0, n + 1)))], ids=["box", "ellipsoid"])
def test_boxes_and_ellipsoids_have_moments_below_normal_ones(n, support):
    initial = Uniform(support(n))
    v = np.ones(n) @ (initial.sample(100_000, np.random.default_rng(0)) - initial.mean[:, None])
    variance = np.ones(n) @ initial.covariance @ np.ones(n)
    assert moments_known(initial) > 4
    for q in range(1, 5):
        assert np.mean(v ** (2 * q)) <= 1.02 * np.prod(np.arange(1, 2 * q, 2)) * variance**q


@pytest.mark.parametrize("initial", [Gaussian([0.0], [[1.0]]), Empirical([[1.0, 2.0]])])
def test_of_others_only_two_moments_are_used(initial):
    assert moments_known(initial) == 1
