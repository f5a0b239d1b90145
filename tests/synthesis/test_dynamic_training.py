"""Training controllers with memory, judged by rollouts and certificates of their own."""

import numpy as np
import pytest

from inc_casadi import INC, Box, Plant, Polytope, Regional, Spec, bounds
from inc_casadi.dynamic import certify_dynamic, corrected, observer
from inc_casadi.estimate import Estimate
from inc_casadi.linear import discounted_lqr
from inc_casadi.linear.deadbeat import deadbeat_observer
from inc_casadi.output_range import within_limits
from synthesis import dynamic_training
from synthesis.dynamic_training import train_dynamic, with_units

DOUBLE = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]])
SPEC = Spec(np.eye(2), 0.1, 0.95, Box([-1, -0.5], [1, 0.5]), Box(-0.5, 0.5))
CLAIM = Regional(SPEC.initial.support, SPEC.inputs, SPEC.Q, SPEC.R, SPEC.discount)
L = deadbeat_observer(DOUBLE.A, DOUBLE.C)
K, _ = discounted_lqr(DOUBLE, SPEC)
START = observer(DOUBLE, L, corrected(INC.saturated(K, 0.5), np.linalg.solve(DOUBLE.A, L), DOUBLE.C))


@pytest.fixture(scope="module")
def found():
    return train_dynamic(DOUBLE, SPEC, with_units(DOUBLE, SPEC, START, 2, seed=3), order=7, horizon=20, max_iterations=20)


def test_training_lowers_the_certified_cost(found):
    before, after = (certify_dynamic(DOUBLE, one, CLAIM).require() for one in (found.start, found.dynamic))
    assert found.improved and after.prove()
    assert bounds.any_controller(DOUBLE, SPEC).value < after.bound < 0.95 * before.bound


def test_stated_cost_is_that_of_rollouts(found):
    x = SPEC.initial.sample(5000, np.random.default_rng(0))  # those that the cost is stated of
    xi, total, excess = np.zeros((2, x.shape[1])), np.zeros(x.shape[1]), -1.0
    for k in range(300):
        after, u = found.dynamic.step(xi, DOUBLE.C @ x)
        total += 0.95**k * ((x**2).sum(axis=0) + 0.1 * u[0] ** 2)
        excess = max(excess, float(np.max(np.abs(u))) - 0.5)
        x, xi = DOUBLE.A @ x + DOUBLE.B @ u, after
    np.testing.assert_allclose(total.mean(), found.cost.mean, rtol=1e-6)
    assert excess <= 0 and within_limits(found.dynamic.readout, SPEC.inputs)


def test_state_is_not_clipped_in_what_is_returned(found):
    after, _ = found.dynamic.step(np.full((2, 1), 1e4), np.array([[-1e4]]))
    assert np.max(np.abs(after)) > 1e3


def test_added_units_leave_the_controller_as_it_is():
    more = with_units(DOUBLE, SPEC, START, 5, seed=2)
    rng = np.random.default_rng(3)
    xi, y = rng.standard_normal((2, 100)), rng.standard_normal((1, 100))
    for ours, theirs in zip(more.step(xi, y), START.step(xi, y), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-12)
    assert more.q == START.q + 5 and more.law.well_posedness().norm < 0.95


def test_start_is_kept_where_nothing_is_searched():
    kept = train_dynamic(DOUBLE, SPEC, START, order=5, max_iterations=0)
    assert not kept.improved and kept.dynamic is kept.start


def rolled(dynamic, plant, x, steps=200):
    """Inputs (m, N, steps) of the motions from columns x."""
    xi, us = np.repeat(dynamic.xi_0[:, None], x.shape[1], axis=1), []
    for _ in range(steps):
        xi, u = dynamic.step(xi, plant.C @ x)
        us.append(u)
        x = plant.A @ x + plant.B @ u
    return np.stack(us, axis=2), x


@pytest.mark.slow
def test_an_interval_written_as_a_polytope_is_the_box(found):
    same = Spec(SPEC.Q, SPEC.R, 0.95, SPEC.initial, Polytope([[1.0], [-1.0]], [0.5, 0.5]))
    polytope = train_dynamic(DOUBLE, same, with_units(DOUBLE, SPEC, START, 2, seed=3), order=7, horizon=20,
                             max_iterations=20)
    assert polytope.improved and polytope.cost.mean == pytest.approx(found.cost.mean, rel=1e-3)
    assert within_limits(polytope.dynamic.readout, SPEC.inputs) and polytope.cost.excess <= 1e-9


@pytest.mark.slow
def test_a_polytope_of_initial_states_is_what_is_trained_for():
    triangle = Polytope([[-1.0, 0.0], [0.0, -1.0], [1.0, 1.0]], [0.2, 0.1, 1.0])
    found = train_dynamic(DOUBLE, Spec(SPEC.Q, SPEC.R, 0.95, triangle, SPEC.inputs),
                          with_units(DOUBLE, SPEC, START, 2, seed=4), order=6, horizon=15, max_iterations=10)
    assert found.improved and found.cost.settled
    u, x = rolled(found.dynamic, DOUBLE, triangle.vertices)
    assert np.max(np.abs(u)) <= 0.5 and np.max(np.abs(u[:, :, -1])) < 1e-6 and np.max(np.abs(x)) < 0.1


@pytest.mark.slow
def test_two_inputs_that_share_a_budget_are_kept_within_it():
    """|u_1| + |u_2| <= 0.6 while each alone may reach 0.6: the trained controller keeps the sum on other motions too."""
    plant = Plant([[1.0, 0.5], [0.0, 0.9]], np.eye(2), [[1.0, 0.0], [0.0, 1.0]])
    diamond = Polytope([[1, 1], [1, -1], [-1, 1], [-1, -1]], 0.6 * np.ones(4))
    spec = Spec(np.eye(2), 0.1 * np.eye(2), 0.95, Box([-1, -1], [1, 1]), diamond)
    K, _ = discounted_lqr(plant, spec)
    filtered = observer(plant, 0.3 * plant.A, INC.saturated(0.5 * K, 0.3))
    start = with_units(plant, spec, filtered, 2)
    found = train_dynamic(plant, spec, start, order=4, horizon=12, max_iterations=5)
    assert found.improved and found.cost.excess <= 1e-9
    u, _ = rolled(found.dynamic, plant, spec.initial.sample(500, np.random.default_rng(5)))
    assert np.max(np.abs(u).sum(axis=0)) <= 0.6 + 1e-6


def test_a_start_that_leaves_its_polytope_gives_way_to_a_law_that_keeps_it_and_never_the_other_way_round(monkeypatch):
    runs = {"keeps": Estimate(2.0, 0.0, 3.0, -0.1, 9, 9, True), "leaves": Estimate(1.0, 0.0, 3.0, 0.2, 9, 9, True),
            "cheap": Estimate(1.5, 0.0, 3.0, 0.0, 9, 9, True), "wild": Estimate(0.5, 0.0, 3.0, 0.0, 9, 9, False)}
    for before, after, improved in (("leaves", "keeps", True), ("keeps", "leaves", False), ("keeps", "cheap", True),
                                    ("keeps", "wild", False), ("cheap", "keeps", False)):
        judged = iter([runs[before], runs[after]])
        monkeypatch.setattr(dynamic_training, "simulated_dynamic", lambda *_, judged=judged: next(judged))
        found = train_dynamic(DOUBLE, SPEC, START, order=3, max_iterations=0)
        assert (found.cost is runs[after]) == improved and (found.dynamic is found.start) != improved
