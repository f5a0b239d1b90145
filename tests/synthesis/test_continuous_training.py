"""Training in continuous time: the true cost falls, bounds are kept, the start is never worsened, proofs follow."""

import numpy as np
import oracles
import pytest

from inc_casadi import INC, Attraction, Box, DiscountedCost, Plant, Polytope, Spec, Stability, certify
from inc_casadi.errors import DimensionError, InvalidInputError
from synthesis.continuous_setup import continuous_lqr
from synthesis.continuous_training import train_continuous
from synthesis.starts.random_start import linear_start, random_start

SPRING = Plant([[0.0, 1.0], [-1.0, -0.2]], [[0.0], [1.0]], [[1.0, 0.7]], dt=0)
SPEC = Spec(np.eye(2), 0.1, 0.95, Box([-2.0, -2.0], [2.0, 2.0]), Box(-1.0, 1.0))
SMALL = {"horizon": 6.0, "steps": 12, "degree": 2, "order": 3, "max_iterations": 6}


def true_cost(plant, spec, inc, order=6, duration=20.0, steps=200):
    """The mean cost on a grid of nodes by Simpson's rule on Runge-Kutta motions."""
    nodes, weights = spec.initial.quadrature(order)
    x = oracles.flow(plant, inc, nodes, duration, steps)
    u = inc(plant.C @ x.reshape(plant.n, -1)).reshape(plant.m, *x.shape[1:])
    rate = np.einsum("int,ij,jnt->nt", x, spec.Q, x) + np.einsum("int,ij,jnt->nt", u, spec.R, u)
    simpson = np.where(np.arange(steps + 1) % 2 == 1, 4.0, 2.0)
    simpson[[0, -1]] = 1.0
    t = np.linspace(0.0, duration, steps + 1)
    return float(weights @ ((rate * spec.discount**t) @ simpson) * duration / steps / 3)


@pytest.mark.slow
def test_output_feedback_improves_and_the_cost_is_true():
    start = linear_start([[-1.0]], SPRING, SPEC, hidden=2)
    found = train_continuous(SPRING, SPEC, start, **SMALL)
    assert found.improved and found.cost < 0.95 * found.start_cost
    assert found.cost == pytest.approx(true_cost(SPRING, SPEC, found.inc), rel=2e-3)
    assert found.start_cost == pytest.approx(true_cost(SPRING, SPEC, start.with_saturated_output(SPEC.inputs)), rel=2e-3)
    assert {row["phase"] for row in found.history} == {"coarse", "fine"} and found.iterations > 5


@pytest.mark.slow
def test_the_bound_on_W_and_the_limits_are_kept():
    start = random_start(SPRING, SPEC, 3, kappa=0.3, seed=2)
    found = train_continuous(SPRING, SPEC, start, kappa=0.3, **SMALL)
    assert found.improved and not np.array_equal(found.inner.W, start.W)
    assert np.max(np.abs(found.inner.W).sum(axis=1)) <= 0.3
    y = np.linspace(-50.0, 50.0, 201)[None]
    assert np.max(np.abs(found.inc(y))) <= 1.0
    np.testing.assert_allclose(found.inc([0.0]), 0.0, atol=1e-9)


def test_a_start_that_loses_the_state_is_no_obstacle():
    plant = Plant([[0.3]], [[1.0]], dt=0)
    spec = Spec(1.0, 0.1, 0.9, Box(-1.0, 1.0), Box(-1.0, 1.0))
    found = train_continuous(plant, spec, INC.linear([[0.5]]), horizon=4.0, steps=10, degree=2, order=4, max_iterations=20)
    assert found.start_cost == np.inf and found.cost < 1.0
    best = np.trace(continuous_lqr(plant, spec)[1] @ spec.initial.second_moment)
    assert best < found.cost < 1.5 * best


def test_a_start_whose_motion_explodes_begins_along_the_regulator():
    plant, spec = Plant([[0.3]], [[1.0]], dt=0), Spec(1.0, 0.1, 0.9, Box(-1.0, 1.0))
    found = train_continuous(plant, spec, INC.linear([[30.0]]), horizon=4.0, steps=10, degree=2, order=3, max_iterations=20)
    best = np.trace(continuous_lqr(plant, spec)[1] @ spec.initial.second_moment)
    assert found.start_cost == np.inf and found.cost == pytest.approx(best, rel=1e-2)


def test_the_best_law_there_is_stays_as_it_is():
    plant, spec = Plant([[0.3]], [[1.0]], dt=0), Spec(1.0, 0.1, 0.9, Box(-1.0, 1.0))
    K, P = continuous_lqr(plant, spec)
    found = train_continuous(plant, spec, INC.linear(K), horizon=4.0, steps=10, degree=2, order=3, max_iterations=6)
    assert found.status.startswith("the start is kept") and np.array_equal(found.inner.K, K) and not found.improved
    assert found.cost == found.start_cost == pytest.approx(np.trace(P @ spec.initial.second_moment), rel=1e-7)


@pytest.mark.slow
def test_an_unstable_plant_is_left_to_the_clipped_regulator_or_improved():
    plant = Plant([[0.5, 1.0], [0.0, -0.3]], [[0.0], [1.0]], dt=0)
    spec = Spec(np.eye(2), 0.1, 0.9, Box([-0.4, -0.4], [0.4, 0.4]), Box(-1.0, 1.0))
    start = linear_start(continuous_lqr(plant, spec)[0], plant, spec, hidden=2)
    found = train_continuous(plant, spec, start, **{**SMALL, "max_iterations": 4})
    assert found.cost <= found.start_cost * (1 + 1e-12)
    assert found.cost == pytest.approx(true_cost(plant, spec, found.inc), rel=2e-3)
    assert certify(plant, found.inc, Attraction(inputs=spec.inputs), method="dead zone").prove()
    assert not certify(plant, found.inc, Stability()).holds()  # no bounded input stabilizes it everywhere


def test_without_limits_the_regulator_is_found_from_elsewhere_and_its_cost_certified():
    plant = Plant([[0.0, 1.0], [0.5, -0.2]], [[0.0], [1.0]], dt=0)
    spec = Spec(np.eye(2), 0.3, 0.8, Box([-1.0, -1.0], [1.0, 2.0]))
    found = train_continuous(plant, spec, INC.linear([[-1.5, -0.5]]), horizon=6.0, steps=15, degree=3, order=3)
    K, P = continuous_lqr(plant, spec)
    best = np.trace(P @ spec.initial.second_moment)
    assert best <= found.cost * (1 + 1e-7) and found.cost <= best * (1 + 1e-4)
    np.testing.assert_allclose(found.inner.K, K, atol=0.03)
    proof = certify(plant, found.inc, DiscountedCost(spec.Q, spec.R, spec.discount, spec.initial)).require()
    assert proof.prove() and found.cost <= proof.bound * (1 + 1e-7) and proof.bound <= found.cost * (1 + 1e-6)


@pytest.mark.slow
def test_what_is_frozen_stays():
    start = random_start(SPRING, SPEC, 2, seed=3)
    found = train_continuous(SPRING, SPEC, start, frozen=("W", "U"), **SMALL)
    np.testing.assert_array_equal(found.inner.W, start.W)
    np.testing.assert_array_equal(found.inner.U, start.U)
    assert found.improved


def test_nothing_to_do_returns_the_start():
    start = linear_start([[-1.0]], SPRING, SPEC, hidden=2)
    for options in ({"max_iterations": 0}, {"time_limit": 0.0}):
        found = train_continuous(SPRING, SPEC, start, **{**SMALL, **options})
        assert found.cost == found.start_cost and found.inner is not None and not found.improved
        assert found.status == "the start is kept (nothing searched)"


def test_a_progress_that_fails_is_passed_on_and_an_interruption_ends_the_search():
    def failing(row):
        raise ValueError("no more")

    def interrupting(row):
        raise KeyboardInterrupt

    start = linear_start([[-1.0]], SPRING, SPEC, hidden=2)
    with pytest.raises(ValueError, match="no more"):
        train_continuous(SPRING, SPEC, start, progress=failing, **SMALL)
    assert "interrupted" in train_continuous(SPRING, SPEC, start, progress=interrupting, **SMALL).status


def test_what_it_refuses():
    start = INC.linear([[-1.0]])
    with pytest.raises(InvalidInputError, match="the plant has dt = 1: use train"):
        train_continuous(Plant(SPRING.A, SPRING.B, SPRING.C), SPEC, start)
    with pytest.raises(DimensionError, match="start maps 2 measurements"):
        train_continuous(SPRING, SPEC, INC.linear([[-1.0, 0.0]]))
    diamond = Polytope([[1, 1], [1, -1], [-1, 1], [-1, -1]], [1, 1, 1, 1])
    wide = Plant(SPRING.A, np.eye(2), SPRING.C, dt=0)
    with pytest.raises(InvalidInputError, match="a polytope that is no box"):
        train_continuous(wide, Spec(np.eye(2), np.eye(2), 0.9, SPEC.initial, diamond), INC.linear([[-1.0], [0.0]]))
    for options, message in (({"degree": 10}, "degree = 10"), ({"steps": 0}, "steps"), ({"horizon": 0.0}, "horizon"),
                             ({"kappa": 1.0}, "kappa"), ({"frozen": ("X",)}, "frozen"), ({"frozen": "W"}, "frozen"),
                             ({"order": 0}, "order"), ({"frozen": ("W", "U", "V", "K", "b", "d")}, "nothing to train")):
        with pytest.raises(InvalidInputError, match=message):
            train_continuous(SPRING, SPEC, start, **options)


@pytest.mark.slow
def test_training_pays_where_the_clipped_regulator_overshoots():
    # A double integrator with cheap inputs: the clipped regulator brakes too late and overshoots.
    plant = Plant([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], dt=0)
    spec = Spec(np.diag([1.0, 0.0]), 0.01, 0.95, Box([-4.0, -2.0], [4.0, 2.0]), Box(-1.0, 1.0))
    start = linear_start(continuous_lqr(plant, spec)[0], plant, spec, hidden=4)
    found = train_continuous(plant, spec, start, horizon=10.0, steps=20, max_iterations=30)
    assert found.start_cost == pytest.approx(14.7189, abs=1e-3) and found.cost < 0.9 * found.start_cost
    assert found.cost == pytest.approx(true_cost(plant, spec, found.inc), rel=1e-3)
    assert certify(plant, found.inc, Attraction(inputs=spec.inputs)).prove()
