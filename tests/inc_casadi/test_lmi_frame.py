"""The frame moves with the coordinates, and its congruence is the change of variables that it says."""

import draws
import numpy as np
import pytest

from inc_casadi import INC, L2Gain, Plant, ReLU, Saturation, Stability, close_loop
from inc_casadi.lmi_assembly import assembled
from inc_casadi.lmi_frame import Frame, frame_of_loop
from inc_casadi.multipliers import Lifted, Relu, Sector


def problem():
    rng = np.random.default_rng(61)
    plant, inc = draws.plant(rng), draws.controller(rng, units=(ReLU(),) * 5)
    rng.normal(size=(3, 3))
    return plant, inc, rng


def moved(plant, T):
    back = np.linalg.inv(T)
    return Plant(T @ plant.A @ back, T @ plant.B, plant.C @ back)


def stage(plant, inc, Q, R):
    loop = close_loop(plant, inc)
    return loop.X.T @ Q @ loop.X + loop.G.T @ R @ loop.G


@pytest.mark.parametrize("costs", [True, False])
def test_the_frame_moves_with_the_coordinates(costs):
    plant, inc, rng = problem()
    T = np.diag([1.0, 10.0, 0.1]) @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    Q, R, back = np.diag([1.0, 0.5, 2.0]), np.diag([0.2, 0.1]), np.linalg.inv(T)
    other = moved(plant, T)
    here = frame_of_loop(close_loop(plant, inc), stage(plant, inc, Q, R) if costs else None)
    there = frame_of_loop(close_loop(other, inc), stage(other, inc, back.T @ Q @ back, R) if costs else None)
    near = 1e-3 if costs else 1e-2  # the floor below every weight does not move with the coordinates
    np.testing.assert_allclose(T.T @ there.T.T @ there.T @ T, here.T.T @ here.T, rtol=near, atol=near)
    np.testing.assert_allclose(there.sizes, here.sizes, rtol=near)


def test_the_congruence_is_the_change_of_variables():
    plant, inc, rng = problem()
    loop = close_loop(plant, inc)
    frame = frame_of_loop(loop, stage(plant, inc, np.eye(3), np.eye(2)))
    x, eta = rng.normal(size=3), rng.normal(size=5)
    s, tilde = np.concatenate([x, eta]), np.concatenate([frame.T @ x, eta / frame.sizes])
    S = frame.congruence(loop)
    np.testing.assert_allclose(S @ tilde, s)
    np.testing.assert_allclose(frame.T @ frame.back, np.eye(3), atol=1e-12)
    # In the frame the loop is of size one: the stand-in's cost-to-go is the identity, and z~ of a unit x~ is at most 1.
    assert np.linalg.norm(frame.T @ loop.F[:, :3] @ frame.back, 2) < 1.5
    assert np.all(np.linalg.norm(loop.Z[:, :3] @ frame.back, axis=1) <= frame.sizes * (1 + 1e-9))


def test_widened_stacks_get_one_scale_for_each_further_column():
    rng = np.random.default_rng(62)
    plant, inc = draws.plant(rng, n=2, m=1, p=2), draws.controller(rng, m=1, p=2, units=(ReLU(), Saturation()))
    frame, E = Frame(np.diag([2.0, 4.0]), np.array([3.0, 5.0])), np.array([[1.0, 0.0], [0.5, 0.0]])
    loop = close_loop(plant, inc).with_inputs(E)
    S = frame.congruence(loop)
    np.testing.assert_allclose(np.diag(S), [0.5, 0.25, 3, 5, 1 / np.hypot(2.0, 2.0), 1.0])
    graph = Lifted().step(loop)  # (x, eta_0, w, eta_1, and a column for the second kink of each saturation)
    S = frame.congruence(graph)
    assert S.shape == (graph.width,) * 2
    np.testing.assert_allclose(np.diag(S)[:8], [0.5, 0.25, 3, 5, 1 / np.hypot(2.0, 2.0), 1.0, 3, 5])
    np.testing.assert_allclose(np.diag(S)[8:], [5.0] * (graph.width - 8))
    assert np.count_nonzero(S) == graph.width and len(graph.atoms) == graph.width - 8 > 0
    now = Lifted().now(loop)
    np.testing.assert_allclose(np.diag(frame.congruence(now))[:4], [0.5, 0.25, 3, 5])


def test_refined_takes_the_P_just_found_or_stays():
    plant, inc, _ = problem()
    loop = close_loop(plant, inc)
    frame = frame_of_loop(loop)
    P = frame.T.T @ np.diag([1.0, 2.0, 3.0]) @ frame.T
    turn = frame.refined({"P": P}, loop).T
    np.testing.assert_allclose(turn.T @ turn, P, rtol=1e-9)
    for none in ({"P": -P}, {}, {"P": np.eye(8)}, {"P": np.zeros((3, 3))}, {"P": P * np.outer([1, 0, 0], [1, 0, 0])}):
        assert frame.refined(none, loop) is frame


def test_any_frame_will_do_for_a_loop_that_does_nothing():
    for plant in (Plant(np.zeros((2, 2)), np.zeros((2, 1))), Plant(np.diag([3.0, -2.0]), [[1.0], [0.0]]),
                  Plant(np.diag([3.0, -2.0]), [[1.0], [0.0]], dt=0)):
        frame = frame_of_loop(close_loop(plant, INC.linear(np.zeros((1, 2)))))
        assert np.all(np.isfinite(frame.T)) and np.linalg.matrix_rank(frame.T) == 2


@pytest.mark.parametrize("claim", [Stability(0.95), L2Gain(np.eye(3), gain=20.0)])
@pytest.mark.parametrize("multiplier", [Sector(), Relu()])
def test_a_congruence_does_not_change_which_numbers_satisfy_the_conditions(claim, multiplier):
    plant, inc, rng = problem()
    loop = close_loop(plant, inc)
    one = assembled(loop, claim, multiplier)
    other = assembled(loop, claim, multiplier, Frame(rng.normal(size=(3, 3)), rng.uniform(0.1, 9, size=5)))
    for _ in range(20):
        y = rng.normal(size=one.widest().size - 1)
        values = one.values_at(y)
        signs = [[np.linalg.eigvalsh(block.value(programs.point(values)))[0] > 0
                  for block in programs._blocks] for programs in (one, other)]
        assert signs[0] == signs[1]
