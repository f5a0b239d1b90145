"""The exact walk: against trajectories, under changes of coordinates and units, in Fractions, and out of budget."""

import time
from fractions import Fraction

import numpy as np
import oracles
import pytest
from walk_draws import EACH_WALK, draw, motions

from inc_casadi import INC, Box, Identity, Plant, Polytope, ReLU, Saturation
from inc_casadi.claims.regional import Regional
from inc_casadi.pieces.laws import PiecewiseLoop
from inc_casadi.pieces.simplices import begin
from inc_casadi.pieces.terminal import find, in_fractions
from inc_casadi.pieces.walk import Budget, _size, one_pattern_each, walk


def follow(plant, inc, claim, budget=None):
    loop = PiecewiseLoop(plant, inc)
    terminal, why = find(loop, claim)
    assert terminal is not None, why
    return walk(loop, claim, terminal, budget)


def follow_exactly(plant, inc, claim):
    floats = PiecewiseLoop(plant, inc)
    terminal, why = find(floats, claim)
    assert terminal is not None, why
    loop = PiecewiseLoop(plant, inc, "exact")
    return walk(loop, claim, in_fractions(loop, claim, terminal))


def located(start, points):
    """For each point (n, N): a simplex that holds it, and its barycentric coordinates there."""
    lifted = np.concatenate([start, np.ones((*start.shape[:2], 1))], axis=2)
    solid = np.flatnonzero(np.abs(np.linalg.det(lifted)) > 1e-13)
    inverse = np.linalg.inv(np.swapaxes(lifted[solid], 1, 2))
    coordinates = inverse @ np.vstack([points, np.ones(points.shape[1])])
    best = coordinates.min(axis=1).argmax(axis=0)
    each = np.arange(points.shape[1])
    assert coordinates.min(axis=1)[best, each].min() > -1e-7, "a point is in no simplex"
    return solid[best], coordinates[best, :, each]


# Draws whose sampled motions converge; the others have an unstable equilibrium or motions that grow.


@EACH_WALK
def test_the_cost_form_of_its_simplex_is_the_simulated_cost_of_each_point(seed):
    plant, inc, claim = draw(seed)
    found = follow(plant, inc, claim)
    assert found.complete and found.done.weight.sum() == pytest.approx(1.0, abs=1e-12)
    points = claim.initial.sample(300, np.random.default_rng(1000 + seed))
    which, l = located(found.done.start, points)
    exact = np.einsum("ni,nij,nj->n", l, found.done.cost[which], l)
    np.testing.assert_allclose(exact, motions(plant, inc, claim, points)[2], rtol=1e-7)


@EACH_WALK
def test_expected_worst_and_slack_stand_up_to_sampled_motions(seed):
    plant, inc, claim = draw(seed)
    found = follow(plant, inc, claim)
    points = claim.initial.sample(2000, np.random.default_rng(2000 + seed))
    x, u, costs = motions(plant, inc, claim, points)
    assert abs(costs.mean() - found.done.expected_cost()) < 4 * costs.std() / np.sqrt(costs.size)
    worst, at = found.done.worst_cost()
    assert costs.max() <= worst * (1 + 1e-9)
    assert motions(plant, inc, claim, at[:, None])[2][0] == pytest.approx(worst, rel=1e-8)
    sampled = (claim.inputs.h[:, None, None] - np.einsum("km,mnt->knt", claim.inputs.H, u)).min()
    assert found.slack <= sampled + 1e-9 and found.slack == pytest.approx(sampled, abs=0.15)
    np.testing.assert_allclose(x[:, :, -1], np.broadcast_to(x[:, :1, -1], x[:, :, -1].shape), atol=1e-9)


@pytest.mark.parametrize("seed", [1, 13])
def test_arrival_is_the_first_step_with_the_whole_simplex_in_the_terminal_set(seed):
    plant, inc, claim = draw(seed)
    found = follow(plant, inc, claim)
    terminal, _ = find(PiecewiseLoop(plant, inc), claim)
    corners = np.moveaxis(found.done.start, 2, 0)
    x, _ = oracles.roll_out(plant, inc, corners.reshape(plant.n, -1), int(found.arrival.max()))
    x = np.moveaxis(x.reshape(*corners.shape, -1), 0, -1)
    inside = np.array([terminal.contains(x[:, :, k]).all(axis=1) for k in range(x.shape[2])]).T
    assert np.mean(inside.argmax(axis=1) == found.arrival) > 0.99


def test_first_laws_are_those_at_the_starting_points():
    plant, inc, claim = draw(13)
    found = follow(plant, inc, claim)
    moved = found.first >= 0
    middles = found.done.start[moved].mean(axis=1).T
    z = inc.W @ oracles.hidden(inc, plant.C @ middles) + inc.U @ plant.C @ middles + inc.b[:, None]
    pieces = np.array([unit.pieces.index(row) for unit, row in zip(inc.activations, z, strict=True)]).T
    assert moved.any()
    np.testing.assert_array_equal(found.patterns[found.first[moved]], pieces)


@pytest.mark.parametrize("seed", [1, 2, 5, 10, 12])
def test_new_state_coordinates_change_nothing(seed):
    plant, inc, claim = draw(seed)
    rng = np.random.default_rng(seed)
    T = np.eye(plant.n) + 0.3 * rng.standard_normal((plant.n, plant.n))
    back = np.linalg.inv(T)
    moved = Plant(T @ plant.A @ back, T @ plant.B, plant.C @ back)
    region = Polytope.from_vertices(T @ claim.initial.support.vertices)
    other = Regional(region, claim.inputs, back.T @ claim.Q @ back, claim.R, claim.discount)
    same(follow(plant, inc, claim), follow(moved, inc, other), T)


@pytest.mark.parametrize("seed", [1, 2, 5])
def test_permuted_idle_and_rescaled_units_change_nothing(seed):
    plant, inc, claim = draw(seed)
    rng = np.random.default_rng(seed)
    order = rng.permutation(inc.q)
    permuted = INC(inc.W[np.ix_(order, order)], inc.U[order], inc.V[:, order], inc.K, inc.b[order], inc.d,
                   [inc.activations[i] for i in order])
    idle = INC(np.block([[inc.W, np.zeros((inc.q, 1))], [0.1 * np.ones((1, inc.q + 1))]]),
               np.vstack([inc.U, np.ones((1, inc.p))]), np.hstack([inc.V, np.zeros((inc.m, 1))]), inc.K,
               np.append(inc.b, 0.05), inc.d, (*inc.activations, ReLU()))
    # phi(c z) = c phi(z) for the units with a cone at 0; a saturation keeps its scale.
    scale = np.array([1.0 if isinstance(unit, Saturation) else rng.uniform(0.5, 2.0) for unit in inc.activations])
    rescaled = INC(scale[:, None] * inc.W / scale, scale[:, None] * inc.U, inc.V / scale, inc.K, scale * inc.b, inc.d,
                   inc.activations)
    reference = follow(plant, inc, claim)
    for law in (permuted, idle, rescaled):
        same(reference, follow(plant, law, claim))


def same(one, other, T=None):
    assert other.complete
    assert other.done.expected_cost() == pytest.approx(one.done.expected_cost(), rel=1e-10)
    assert other.done.worst_cost()[0] == pytest.approx(one.done.worst_cost()[0], rel=1e-10)
    assert other.slack == pytest.approx(one.slack, rel=1e-9)
    at, point = one.done.worst_cost()[1], other.done.worst_cost()[1]
    np.testing.assert_allclose(point, at if T is None else T @ at, atol=1e-8)


@pytest.mark.parametrize("seed", [1, 7, 12])
def test_the_walk_in_fractions_agrees_with_floats(seed):
    plant, inc, claim = draw(seed)
    inc = INC(inc.W[:2, :2], inc.U[:2], inc.V[:, :2], inc.K, inc.b[:2], inc.d, inc.activations[:2])
    floats, exact = follow(plant, inc, claim), follow_exactly(plant, inc, claim)
    assert exact.complete and len(exact.done) > 2
    assert sum(exact.done.weight, Fraction(0)) == 1
    assert float(exact.done.expected_cost()) == pytest.approx(floats.done.expected_cost(), rel=1e-9)
    assert float(exact.done.worst_cost()[0]) == pytest.approx(floats.done.worst_cost()[0], rel=1e-9)
    assert float(exact.slack) == pytest.approx(floats.slack, abs=1e-12)


SCALAR = Plant([[1.5]], [[1.0]])


def test_deadbeat_loops_with_flat_simplices_have_exact_costs():
    # The double integrator with its deadbeat gain: unsaturated motions reach a line in one step, the origin in two.
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]])
    claim = Regional(Box([-0.5, -0.8], [0.5, 0.8]), Box([-1.0], [1.0]), np.diag([1.0, 2.0]), [[0.3]], 1.0)
    inc = INC.saturated([[-1.0, -1.5]], 1.0)
    found = follow(plant, inc, claim)
    points = claim.initial.sample(200, np.random.default_rng(0))
    which, l = located(found.done.start, points)
    exact = np.einsum("ni,nij,nj->n", l, found.done.cost[which], l)
    np.testing.assert_allclose(exact, motions(plant, inc, claim, points)[2], rtol=1e-9)
    assert follow_exactly(plant, inc, claim).done.weight.sum() == 1


@pytest.mark.parametrize("inc", [
    INC.linear([[-1.0]]),
    INC([[0.0]], [[1.0]], [[-1.0]], [[0.0]], activation=Identity()),
    INC.saturated([[-1.0]], 5.0),
    INC([[0.5]], [[0.5]], [[-1.0]], [[0.0]], activation=Identity()),
])
def test_a_linear_law_in_any_dress_is_not_cut(inc):
    claim = Regional(Box([-1.0], [1.0]), Box([-2.0], [2.0]), [[1.0]], [[0.0]], 0.9)
    found = follow(SCALAR, inc, claim)
    assert found.cuts == 0 and len(found.done) == 1
    assert found.done.expected_cost() == pytest.approx(1 / (3 * (1 - 0.9 / 4)), rel=1e-13)


@pytest.mark.parametrize("half, pieces", [(2 / 3, 1), (2.0 / 3 * (1 + 1e-9), 3), (1.0, 3)])
def test_kinks_at_the_ends_of_the_initial_set_are_not_cut_at(half, pieces):
    # By hand: u = -sat(1.5 x) has its kinks at |x| = 2/3.
    claim = Regional(Box([-half], [half]), Box([-1.0], [1.0]), [[1.0]], [[0.0]], 1.0)
    assert len(follow(SCALAR, INC.saturated([[-1.5]], 1.0), claim).done) == pieces


def test_a_kink_through_vertices_edges_and_centroids_is_no_trouble():
    # sat(x1 - x2 + offset): its kinks run through corners and along the diagonal of the box.
    for offset in (0.0, 1.0, -1.0, 1 / 3):
        plant = Plant([[0.6, 0.2], [0.1, 0.5]], [[0.1], [0.2]])
        inc = INC([[0.0]], [[1.0, -1.0]], [[1.0]], [[0.0, 0.0]], [offset], [-offset], Saturation())
        claim = Regional(Box([-1.0, -1.0], [1.0, 1.0]), None, np.eye(2), [[0.1]], 0.8)
        if abs(offset) == 1.0:
            terminal, why = find(PiecewiseLoop(plant, inc), claim)
            assert terminal is None and "kink" in why
            continue
        found = follow(plant, inc, claim)
        points = claim.initial.sample(100, np.random.default_rng(3))
        which, l = located(found.done.start, points)
        exact = np.einsum("ni,nij,nj->n", l, found.done.cost[which], l)
        np.testing.assert_allclose(exact, motions(plant, inc, claim, points)[2], rtol=1e-9)


def test_cutting_ends_where_many_kinks_nearly_meet():
    # This draw left slivers on which a tolerance relative to the sliver itself cut for ever.
    A, B = np.array([[1.1, 1.0], [0.0, 1.02]]), np.array([[0.2], [0.5]])
    for seed in (1, 6):
        rng = np.random.default_rng(seed)
        W = rng.standard_normal((8, 8))
        W *= 0.6 / np.abs(W).sum(axis=1).max()
        U, V, b = rng.standard_normal((8, 2)), 0.05 * rng.standard_normal((1, 8)), 0.3 * rng.standard_normal(8)
        K = 0.9 * np.array([[-1.37488222, -2.64897412]])
        rest = INC(W, U, V, K, b)(np.zeros(2))
        inc = INC(W, U, V, K, b, -rest).with_saturated_output(Box([-1.0], [1.0]))
        claim = Regional(Box([-0.8, -0.8], [0.8, 0.8]), Box([-1.0], [1.0]), np.eye(2), [[0.05]], 0.98)
        found = follow(Plant(A, B), inc, claim)
        assert found.complete and len(found.done) < 10_000


def test_what_lies_on_a_kink_up_to_rounding_is_not_cut():
    # z = x1 - x2 is a difference of numbers of size 1: here it is their rounding and nothing else.
    loop = PiecewiseLoop(Plant(0.5 * np.eye(2), np.ones((2, 1))), INC([[0.0]], [[1.0, -1.0]], [[1.0]], [[0.0, 0.0]]))
    tiny = 2.0**-52
    sliver = begin(np.array([[[1.0, 1.0], [1.0 + tiny, 1.0], [1.0, 1.0 + tiny]]]), np.ones(1))
    whole = begin(np.array([[[1.0, 1.0], [2.0, 1.0], [1.0, 2.0]]]), np.ones(1))
    for simplices, pieces in ((sliver, 1), (whole, 2)):
        patterns = loop.patterns_at(simplices.centroids())
        size = _size(loop, patterns, simplices.now)
        found = one_pattern_each(loop, simplices, np.zeros(1, int), patterns, size, Budget(), time.monotonic())
        assert len(found[0]) == pieces and found[3].cuts == pieces - 1


@pytest.mark.parametrize("budget, reason", [
    (Budget(pieces=3), "more than 3 simplices"),
    (Budget(steps=2), "still under way after 2 steps"),
    (Budget(seconds=0.0), "time limit"),
])
def test_a_budget_that_ends_leaves_the_rest_under_way(budget, reason):
    plant, inc, claim = draw(1)
    found = follow(plant, inc, claim, budget)
    assert not found.complete and reason in found.ended
    assert len(found.left) and found.left.weight.sum() + found.done.weight.sum() == pytest.approx(1.0)


def test_a_motion_that_grows_ends_the_walk():
    claim = Regional(Box([-3.0], [3.0]), None, [[1.0]], [[0.0]], 0.9)
    found = follow(SCALAR, INC.saturated([[-1.5]], 1.0), claim)
    assert not found.complete and "grew" in found.ended
    # By hand: |x| < 2 converges and |x| > 2 grows.
    assert found.done.weight.sum() == pytest.approx(2 / 3, abs=0.01)


def test_progress_is_told_step_by_step():
    plant, inc, claim = draw(1)
    loop = PiecewiseLoop(plant, inc)
    heard = []
    found = walk(loop, claim, find(loop, claim)[0], progress=lambda step, alive: heard.append((step, alive)))
    assert [step for step, _ in heard] == list(range(found.arrival.max() + 1)) and heard[-1][1] == 0


def test_steps_tell_what_an_error_bound_needs():
    """x+ = 1.5 x - sat(1.5 x) on [-1, 1]: both kinks at 2/3 cut the interval, one after the other; |u| reaches 1."""
    found = follow(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0),
                   Regional(Box([-1.0], [1.0]), Box([-1.25], [1.25]), [[1.0]], [[0.0]], 0.9))
    first = found.steps[0]
    assert first.rounds == 2 and first.pieces == len(found.done) == 3 and first.beyond == 0.0
    assert first.x.tolist() == [1.0] and first.u == pytest.approx([1.0]) and float(first.slack) == pytest.approx(0.25)
    assert first.largest >= 1.5


def test_a_tolerance_is_paid_for_in_what_steps_tell(monkeypatch):
    """With kinks of 0.4 tolerance [-1, 1] is not cut, and z = 1.5 lies 0.5 beyond its piece of the first law."""
    monkeypatch.setattr(PiecewiseLoop, "kink_tolerance", 0.4)
    found = follow(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0),
                   Regional(Box([-1.0], [1.0]), None, [[1.0]], [[0.0]], 0.9))
    assert len(found.done) == 1 and found.steps[0].beyond == pytest.approx(0.5)
