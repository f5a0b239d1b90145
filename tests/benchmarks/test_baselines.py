"""The linear baselines agree with the toolbox, with which they share no code, and with hand calculations."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.baselines import control_lqr_gain, dense_search, lyapunov_costs, saturated_lqr
from benchmarks.plants import output_feedback, scalar, two_state
from inc_casadi import Box, Plant, Polytope, Spec, simulate
from inc_casadi.errors import InvalidInputError
from inc_casadi.linear.regulator import discounted_lqr


def test_lqr_of_python_control_is_ours():
    rng = np.random.default_rng(4)
    plant = Plant(rng.standard_normal((4, 4)), rng.standard_normal((4, 2)))
    spec = Spec(np.diag([1.0, 2.0, 0.5, 3.0]), np.diag([0.3, 0.7]), 0.9, Box(-np.ones(4), np.ones(4)))
    assert control_lqr_gain(plant, spec) == pytest.approx(discounted_lqr(plant, spec)[0], rel=1e-8)


def test_lyapunov_cost_is_the_sum_over_a_simulated_motion():
    plant, spec, _ = two_state()
    F = np.array([[-0.35, -0.9]])
    nodes, weights = spec.initial.quadrature(2)
    total = np.zeros(nodes.shape[1])
    for k, x in enumerate(_motion(plant.A + plant.B @ F, nodes, 600)):
        total += 0.98**k * (np.sum(x * x, axis=0) + 0.05 * (F @ x)[0] ** 2)
    assert lyapunov_costs(plant, spec, F[None])[0] == pytest.approx(weights @ total, rel=1e-9)


def _motion(A: np.ndarray, x: np.ndarray, steps: int):
    for _ in range(steps):
        yield x
        x = A @ x


def test_an_unstable_gain_costs_infinitely_much():
    plant, spec, _ = scalar(1.0)
    assert lyapunov_costs(plant, spec, np.array([[[-0.5]]]))[0] == np.inf


def test_dense_search_keeps_the_limit_and_is_no_better_than_its_neighbours_allow():
    plant, spec, _ = two_state()
    F, cost = dense_search(plant, spec)
    assert 0.8 * np.sum(np.abs(F)) <= 1 + 1e-9
    draws = np.random.default_rng(0).uniform(-1.25, 1.25, (4000, 1, 2))
    draws = draws[np.sum(np.abs(draws), axis=(1, 2)) <= 1.25]
    assert cost <= lyapunov_costs(plant, spec, draws).min()


def test_saturated_lqr_is_the_clipped_gain():
    plant, spec, _ = two_state()
    law, K = saturated_lqr(plant, spec), discounted_lqr(plant, spec)[0]
    x = np.random.default_rng(2).uniform(-0.8, 0.8, (2, 50))
    assert law(x) == pytest.approx(np.clip(K @ x, -1, 1), abs=1e-12)
    assert np.max(np.abs(simulate(plant, law, x).u)) <= 1.0


def test_saturated_lqr_refuses_what_it_cannot_clip():
    plant, spec, _ = output_feedback()
    with pytest.raises(InvalidInputError, match="full state"):
        saturated_lqr(plant, spec)
    plant, spec, _ = scalar()
    with pytest.raises(InvalidInputError, match="Box"):
        saturated_lqr(plant, Spec(spec.Q, spec.R, 1.0, spec.initial, Polytope([[1.0], [-1.0]], [1.0, 1.0])))
