"""The walk over polytopes against the walk over simplices, which shares no cutting with it, and against trajectories."""

import numpy as np
import oracles
import pytest
from walk_draws import EACH_WALK, USABLE, draw, motions

from inc_casadi import INC, Box, Plant
from inc_casadi.claims.regional import Regional
from inc_casadi.pieces import cell_walk as cell_walk_module
from inc_casadi.pieces import cutting
from inc_casadi.pieces.cell_walk import cell_walk
from inc_casadi.pieces.laws import PiecewiseLoop
from inc_casadi.pieces.terminal import find
from inc_casadi.pieces.walk import Budget, walk


def both(plant, inc, claim, budget=None):
    loop = PiecewiseLoop(plant, inc)
    terminal, why = find(loop, claim)
    assert terminal is not None, why
    return cell_walk(loop, claim, terminal, budget), walk(loop, claim, terminal, budget)


@EACH_WALK
def test_polytopes_and_simplices_agree(seed):
    plant, inc, claim = draw(seed)
    cells, simplices = both(plant, inc, claim)
    assert cells.complete and simplices.complete
    assert cells.expected == pytest.approx(float(simplices.done.expected_cost()), rel=1e-9)
    assert cells.worst[0] == pytest.approx(float(simplices.done.worst_cost()[0]), rel=1e-9)
    assert cells.slack == pytest.approx(float(simplices.slack), abs=1e-9)
    assert len(cells.arrived) <= len(simplices.done)


@EACH_WALK
def test_costs_are_those_of_trajectories(seed):
    plant, inc, claim = draw(seed)
    found, _ = both(plant, inc, claim)
    points = found.arrived.start.T
    _, u, cost = motions(plant, inc, claim, points)
    lifted = found.arrived.lifted()
    stated = np.einsum("vi,vij,vj->v", lifted, found.arrived.cost[found.arrived.owner], lifted)
    np.testing.assert_allclose(stated, cost, rtol=1e-8)
    assert np.max(claim.inputs.H @ u.reshape(plant.m, -1) - claim.inputs.h[:, None]) <= 1e-9 - found.slack
    draws = claim.initial.sample(4000, np.random.default_rng(seed))
    _, _, sampled = motions(plant, inc, claim, draws)
    assert np.max(sampled) <= found.worst[0] * (1 + 1e-9)
    assert abs(sampled.mean() - found.expected) < 4 * sampled.std() / np.sqrt(draws.shape[1])


def masses(size, limit):
    """Two masses between walls on three springs, a force on each, sampled every half second; LQR clipped at the limit."""
    from scipy.linalg import expm, solve_discrete_are

    rates = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-2, 1, 0, 0], [1, -2, 0, 0]], float)
    forces = np.vstack([np.zeros((2, 2)), np.eye(2)])
    step = expm(0.5 * np.block([[rates, forces], [np.zeros((2, 6))]]))
    A, B = step[:4, :4], step[:4, 4:]
    P = solve_discrete_are(A, B, np.eye(4), np.eye(2))
    K = -np.linalg.solve(np.eye(2) + B.T @ P @ B, B.T @ P @ A)
    box = Box(-size * np.ones(4), size * np.ones(4))
    return Plant(A, B), INC.saturated(K, limit), Regional(box, Box([-limit] * 2, [limit] * 2), np.eye(4), np.eye(2))


def test_four_states_and_two_saturated_inputs_take_dozens_of_polytopes():
    """Issue: four-state, two-input plants in seconds, within two standard errors of Monte Carlo. Simplices: 158 316."""
    plant, inc, claim = masses(1.0, 1.0)
    loop = PiecewiseLoop(plant, inc)
    found = cell_walk(loop, claim, find(loop, claim)[0])
    assert found.complete and len(found.arrived) < 200 and found.seconds < 5
    assert found.expected == pytest.approx(6.2710479, abs=1e-6)  # the walk over 158 316 simplices gave 6.271047943
    x, u = oracles.roll_out(plant, inc, claim.initial.sample(20_000, np.random.default_rng(1)), 120)
    cost = oracles.discounted_cost(x, u, claim.Q, claim.R, 1.0)
    assert abs(cost.mean() - found.expected) < 2 * cost.std() / np.sqrt(len(cost))


def test_thousands_of_polytopes_where_simplices_run_into_millions():
    plant, inc, claim = masses(1.0, 0.5)
    loop = PiecewiseLoop(plant, inc)
    found = cell_walk(loop, claim, find(loop, claim)[0])
    assert found.complete and 2000 < len(found.arrived) < 6000
    x, u = oracles.roll_out(plant, inc, claim.initial.sample(20_000, np.random.default_rng(2)), 120)
    cost = oracles.discounted_cost(x, u, claim.Q, claim.R, 1.0)
    assert abs(cost.mean() - found.expected) < 2 * cost.std() / np.sqrt(len(cost))


@pytest.mark.parametrize("budget, why", [(Budget(pieces=3), "more than 3 pieces"), (Budget(steps=1), "after 1 steps"),
                                         (Budget(seconds=0.0), "time limit")])
def test_a_spent_budget_is_said_and_what_was_found_is_kept(budget, why):
    plant, inc, claim = draw(1)
    found, _ = both(plant, inc, claim, budget)
    assert not found.complete and why in found.ended
    assert found.followed + float(found.left.weight.sum()) == pytest.approx(1.0, abs=1e-9)
    whole, _ = both(plant, inc, claim)
    assert 0 <= found.at_least < whole.expected and whole.at_least == whole.expected


@pytest.mark.parametrize("pieces", [20, 60, 200])
@pytest.mark.parametrize("seed", USABLE[:6])
def test_no_walk_ever_holds_more_pieces_than_its_budget(seed, pieces):
    plant, inc, claim = draw(seed)
    cells, simplices = both(plant, inc, claim, Budget(pieces=pieces))
    assert len(cells.arrived) + len(cells.alive) <= pieces
    assert len(simplices.done) + len(simplices.left) <= pieces


def test_pieces_that_have_arrived_count_too():
    plant, inc, claim = masses(1.0, 0.5)
    loop = PiecewiseLoop(plant, inc)
    terminal = find(loop, claim)[0]
    most = []
    found = cell_walk(loop, claim, terminal, progress=lambda step, alive: most.append(alive))
    assert len(found.arrived) > max(most)  # so many at once would be allowed below, but not in all
    short = cell_walk(loop, claim, terminal, Budget(pieces=(len(found.arrived) + max(most)) // 2))
    assert "more than" in short.ended and not short.complete


def test_polytopes_of_too_many_vertices_end_a_walk_before_memory_does(monkeypatch):
    plant, inc, claim = masses(1.0, 0.5)
    loop = PiecewiseLoop(plant, inc)
    terminal = find(loop, claim)[0]
    monkeypatch.setattr(cutting, "MOST_BYTES", 2**20)
    found = cell_walk(loop, claim, terminal)
    assert found.ended.startswith("more than") and "GiB for the vertices of" in found.ended
    assert found.arrived.size + found.alive.size <= 2**20


def test_what_has_arrived_takes_memory_too(monkeypatch):
    plant, inc, claim = masses(1.0, 0.5)
    loop = PiecewiseLoop(plant, inc)
    terminal = find(loop, claim)[0]
    size = cell_walk(loop, claim, terminal).arrived.size
    monkeypatch.setattr(cutting, "MOST_BYTES", int(0.95 * size))
    found = cell_walk(loop, claim, terminal)
    assert "GiB for the vertices of" in found.ended and found.arrived.size + found.alive.size <= size


def test_an_integral_over_too_many_simplices_is_not_worked_out(monkeypatch):
    plant, inc, claim = draw(3)
    monkeypatch.setattr(cell_walk_module, "MOST_SIMPLICES", 3)
    found, _ = both(plant, inc, claim)
    assert found.complete and np.isnan(found.expected) and found.followed == 1.0 and np.isfinite(found.worst[0])


def test_small_batches_of_cells_give_the_same_integral(monkeypatch):
    plant, inc, claim = draw(3)
    whole, _ = both(plant, inc, claim)
    monkeypatch.setattr(cell_walk_module, "HELD", 8)
    again, _ = both(plant, inc, claim)
    assert len(again.arrived) > 8 and again.expected == pytest.approx(whole.expected, rel=1e-12)


def test_at_the_edge_of_what_can_be_steered_the_walk_ends_with_a_reason():
    """x+ = 1.5 x - sat(1.5 x) from [-2, 2]: the ends stay where they are, and their neighbours part ways for ever."""
    plant, inc = Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0)
    claim = Regional(Box([-2.0], [2.0]), Box([-1.0], [1.0]), [[1.0]], [[0.0]], 0.9)
    loop = PiecewiseLoop(plant, inc)
    found = cell_walk(loop, claim, find(loop, claim)[0])
    assert not found.complete and "tell apart" in found.ended and found.followed > 1 - 1e-9


def test_a_linear_law_in_many_dimensions_has_a_worst_cost_without_simplices():
    n = 10
    plant, inc = Plant(0.5 * np.eye(n), np.ones((n, 1))), INC.linear(-0.01 * np.ones((1, n)))
    loop, claim = PiecewiseLoop(plant, inc), Regional(Box(-np.ones(n), np.ones(n)), None, np.eye(n), [[1.0]], 0.9)
    found = cell_walk(loop, claim, find(loop, claim)[0])
    _, _, cost = motions(plant, inc, claim, claim.initial.vertices)
    assert found.complete and np.isnan(found.expected) and found.worst[0] == pytest.approx(cost.max(), rel=1e-9)
