"""Training controllers with memory, judged by rollouts and certificates of their own."""

import numpy as np
import pytest

from inc_casadi import INC, Box, Plant, Polytope, Regional, Spec, bounds
from inc_casadi.dynamic import certify_dynamic, corrected, observer
from inc_casadi.errors import InvalidInputError
from inc_casadi.linear import discounted_lqr
from inc_casadi.linear.deadbeat import deadbeat_observer
from inc_casadi.output_range import within_limits
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


def test_polytope_of_inputs_is_refused():
    limits = Polytope([[1.0], [-1.0]], [0.5, 0.5])
    with pytest.raises(InvalidInputError, match="inputs must be a Box or None, not a Polytope"):
        train_dynamic(DOUBLE, Spec(SPEC.Q, SPEC.R, 0.95, SPEC.initial, limits), START)
