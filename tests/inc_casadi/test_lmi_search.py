"""The search finds what is there, in any units, and gives back its best numbers where nothing is."""

import sys

import draws
import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

from inc_casadi import INC, Box, Gaussian, Plant, ReLU, close_loop
from inc_casadi import lmi_search as lmi
from inc_casadi.claims import DiscountedCost, Stability
from inc_casadi.errors import SolverError
from inc_casadi.lmi_frame import frame_of_loop
from inc_casadi.multipliers import Relu, Sector


def cost_problem(seed=61):
    rng = np.random.default_rng(seed)
    plant, inc = draws.plant(rng), draws.controller(rng, units=(ReLU(),) * 5)
    root = rng.normal(size=(plant.n, plant.n))
    claim = DiscountedCost(np.diag([1.0, 0.5, 2.0]), np.diag([0.2, 0.1]), 0.95,
                           Gaussian(np.zeros(plant.n), root @ root.T + np.eye(plant.n)))
    return plant, inc, claim, rng


def transformed(plant, claim, T, factor=1.0):
    back = np.linalg.inv(T)
    moved = Plant(T @ plant.A @ back, T @ plant.B, plant.C @ back)
    Q, S0 = factor * back.T @ claim.Q @ back, T @ claim.initial.covariance @ T.T
    return moved, DiscountedCost((Q + Q.T) / 2, factor * claim.R, claim.discount,
                                 Gaussian(np.zeros(plant.n), (S0 + S0.T) / 2))


def test_a_linear_loop_costs_what_lyapunov_says():
    rng = np.random.default_rng(62)
    plant, _, claim, _ = cost_problem()
    K = 0.05 * rng.normal(size=(plant.m, plant.p))
    closed, gain = plant.A + plant.B @ K @ plant.C, K @ plant.C
    P = solve_discrete_lyapunov(np.sqrt(0.95) * closed.T, claim.Q + gain.T @ claim.R @ gain)
    found = lmi.search(plant, INC.linear(K), claim, Sector())
    assert found.holds() and found.prove()
    assert found.bound == pytest.approx(np.trace(P @ claim.initial.second_moment), rel=1e-6)
    assert found.bound > np.trace(P @ claim.initial.second_moment)


@pytest.mark.parametrize("multiplier", [Sector(), Relu()])
@pytest.mark.parametrize("factor", [1e-6, 1.0, 1e6])
def test_the_bound_survives_a_change_of_coordinates_and_of_units(multiplier, factor):
    plant, inc, claim, rng = cost_problem()
    reference = lmi.search(plant, inc, claim, multiplier)
    left, right = (np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(2))
    T = left @ np.diag([1.0, 30.0, 1000.0]) @ right
    moved_plant, moved_claim = transformed(plant, claim, T, factor)
    moved = lmi.search(moved_plant, inc, moved_claim, multiplier)
    assert reference.holds() and moved.holds() and moved.prove()
    assert moved.bound == pytest.approx(factor * reference.bound, rel=2e-5)


def test_the_verdict_at_the_edge_survives_a_change_of_coordinates():
    # x+ = diag(...) x + v relu(.) with the critical mode 0.5 + v: certified below v = 0.5, in bad coordinates too.
    T = np.array([[1.0, 200.0], [0.0, 3.0]])
    for v, expected in ((0.499, True), (0.501, False)):
        back = np.linalg.inv(T)
        plant = Plant(T @ np.diag([0.5, 0.3]) @ back, T @ np.array([[1.0], [0.2]]), (np.array([[1.0, 0.0]]) @ back))
        inc = INC([[0.0]], [[1.0]], [[v]], [[0.0]])
        for multiplier in (Sector(), Relu()):
            found = lmi.search(plant, inc, Stability(0.9999), multiplier)
            assert found.holds() == expected and bool(found.prove()) == expected


@pytest.mark.parametrize("multiplier", [Sector(), Relu()])
def test_order_of_units_and_idle_units_do_not_matter(multiplier):
    plant, inc, claim, rng = cost_problem()
    reference = lmi.search(plant, inc, claim, multiplier)
    order = rng.permutation(inc.q)
    shuffled = INC(inc.W[np.ix_(order, order)], inc.U[order], inc.V[:, order], inc.K)
    assert lmi.search(plant, shuffled, claim, multiplier).bound == pytest.approx(reference.bound, rel=1e-5)
    for row in (np.zeros((1, inc.p)), np.ones((1, inc.p))):  # a unit that is always 0, and one that nobody reads
        W = np.zeros((inc.q + 1, inc.q + 1))
        W[: inc.q, : inc.q] = inc.W
        idle = INC(W, np.vstack([inc.U, row]), np.hstack([inc.V, np.zeros((inc.m, 1))]), inc.K)
        found = lmi.search(plant, idle, claim, multiplier)
        assert found.holds() and found.prove()
        assert found.bound == pytest.approx(reference.bound, rel=1e-5)


def test_an_infeasible_claim_comes_back_with_the_least_violated_numbers():
    inc = INC([[0.0]], [[1.0]], [[0.6]], [[0.0]])
    for claim in (Stability(0.9), Stability(), DiscountedCost([[1.0]], [[1.0]], 1.0, Box([-1.0], [1.0]))):
        found = lmi.search(Plant([[0.5]], [[1.0]]), inc, claim, Sector())
        assert not found.holds() and not found.prove()
        assert np.any(found.values["P"] != 0)
        assert -2.0 < lmi.worst_margin(found) < 0


@pytest.mark.parametrize(("plant", "rate"), [
    (Plant([[0.9, 0.3], [-0.2, 0.7]], [[0.0], [1.0]]), np.sqrt(0.69)), (Plant([[0.5]], [[1.0]]), 0.5),
    (Plant([[-1.0, 3.0], [0.0, -2.0]], [[0.0], [1.0]], dt=0), 2.0), (Plant([[-0.001]], [[1.0]], dt=0), 0.002),
    (Plant([[0.9999]], [[1.0]]), 0.9999),
])
def test_the_best_rate_of_a_linear_loop_is_its_spectral_rate(plant, rate):
    found = lmi.search(plant, INC.linear(np.zeros((1, plant.n))), Stability(), Sector())
    assert found.holds() and found.prove()
    if plant.discrete:
        assert 0 <= found.bound - rate < 2e-4 * (1 - rate) + 1e-9
    else:
        assert 0 <= rate - found.bound < 2e-4 * rate


def test_the_best_rate_survives_a_change_of_coordinates_and_needs_few_solves(monkeypatch):
    rng = np.random.default_rng(63)
    calls, solve = [], lmi._solve
    monkeypatch.setattr(lmi, "_solve", lambda *arguments: calls.append(1) or solve(*arguments))
    plant, inc = draws.plant(rng, dt=0), draws.controller(rng, gain=0.05)
    T = np.linalg.qr(rng.normal(size=(3, 3)))[0] @ np.diag([1.0, 1e2, 1e4])
    moved = Plant(T @ plant.A @ np.linalg.inv(T), T @ plant.B, plant.C @ np.linalg.inv(T), dt=0)
    here, there = (lmi.search(where, inc, Stability(), Relu()) for where in (plant, moved))
    assert here.prove() and there.prove() and there.bound == pytest.approx(here.bound, rel=3e-4)
    assert here.margins()["decrease"] > 1e-9
    assert len(calls) <= 36


def test_a_deadbeat_loop():
    found = lmi.search(Plant([[0.5]], [[1.0]]), INC.linear([[-0.5]]), Stability(), Sector())
    assert found.prove() and found.bound < 1e-3


def test_the_frame_moves_with_the_coordinates():
    plant, inc, claim, rng = cost_problem()
    T = np.diag([1.0, 10.0, 0.1]) @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    moved_plant, moved_claim = transformed(plant, claim, T)
    frames = []
    for where, what in ((plant, claim), (moved_plant, moved_claim)):
        loop = close_loop(where, inc)
        at_zero = what.conditions(loop, {"P": np.zeros((3, 3))}, np.zeros((8, 8)))
        frames.append(frame_of_loop(loop, at_zero))
    here, there = frames
    np.testing.assert_allclose(T.T @ there.T.T @ there.T @ T, here.T.T @ here.T, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(np.diag(there.S)[3:], np.diag(here.S)[3:], rtol=1e-3)
    P = here.T.T @ np.diag([1.0, 2.0, 3.0]) @ here.T
    turn = here.refined({"P": P}, close_loop(plant, inc)).T
    np.testing.assert_allclose(turn.T @ turn, P, rtol=1e-9)
    assert here.refined({"P": -P}, close_loop(plant, inc)) is here and here.refined({}, close_loop(plant, inc)) is here
    x, eta = rng.normal(size=3), rng.normal(size=5)
    twin, s = here.twin(loop := close_loop(plant, inc)), np.concatenate([x, eta])
    tilde = np.concatenate([here.T @ x, eta / here.sizes])
    np.testing.assert_allclose(here.S @ tilde, s)
    np.testing.assert_allclose(twin.F @ tilde, loop.F @ s)
    np.testing.assert_allclose(here.sizes * (twin.Z @ tilde), loop.Z @ s)
    np.testing.assert_allclose(here.sizes * (twin.H @ tilde), eta)


def test_a_missing_solver_is_said_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "cvxpy", None)
    with pytest.raises(SolverError, match="pip install cvxpy"):
        lmi.search(Plant([[0.5]], [[1.0]]), INC.linear([[0.0]]), Stability(0.9), Sector())


def test_a_solver_that_gives_nothing_leaves_a_certificate_that_does_not_hold(monkeypatch):
    monkeypatch.setattr(lmi, "_run", lambda cp, problem: False)
    for claim in (Stability(0.9), Stability(), DiscountedCost([[1.0]], [[1.0]], 0.9, Box([-1.0], [1.0]))):
        found = lmi.search(Plant([[0.5]], [[1.0]]), INC.linear([[0.0]]), claim, Sector())
        assert not found.holds() and "no numbers" in found.note
