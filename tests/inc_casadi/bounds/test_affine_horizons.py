"""The horizon grows until the bound stops rising; the full-state relaxation is lower; moments and polytopes will do."""

from dataclasses import replace

import numpy as np
import pytest
from affine_oracle import sampled_program, with_moments

from inc_casadi import Box, Ellipsoid, Empirical, Moments, Plant, Polytope, Spec, Uniform
from inc_casadi.bounds import affine_moves, any_controller, first_move
from inc_casadi.errors import InvalidInputError

TWO_STATE = Plant([[1.10, 1.00], [0.0, 1.02]], [[0.20], [0.50]])
TWO_STATE_SPEC = Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box(-1, 1))
N, M = 3, 2
HULL = Polytope.from_vertices(np.random.default_rng(0).standard_normal((N, 9)) + [[0.2], [0.0], [-0.3]])
TRIANGLE = Polytope([[-1, 0], [0, -1], [1, 1.3]], [0.3, 0.2, 0.5])


def draw(seed, initial=HULL, inputs=TRIANGLE, p=1):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((N, N))
    A *= 0.95 / np.max(np.abs(np.linalg.eigvals(A)))
    short = rng.standard_normal((N, N))
    spec = Spec(short @ short.T, np.diag([0.1, 0.0]), 0.9, initial, inputs)
    return Plant(A, rng.standard_normal((N, M)), C=rng.standard_normal((p, N))), spec


def test_the_two_state_plant_settles_at_the_limit():
    bound = affine_moves(TWO_STATE, TWO_STATE_SPEC)
    assert bound.value == pytest.approx(2.1167631, abs=6e-8) and bound.holds()
    horizons, values = zip(*bound.horizons, strict=True)
    assert horizons == (1, 2, 4, 8, 16, 32) and bound.value == max(values)
    np.testing.assert_allclose([values[0], values[1], values[3]], [0.8465236, 1.3507976, 2.1167542], atol=6e-8)


def test_each_horizon_is_that_bound():
    plant, spec = draw(0)
    for N_, value in affine_moves(plant, spec, most=8).horizons:
        alone = affine_moves(plant, spec, N_)
        assert alone.value == value and alone.horizons == ((N_, value),)


def test_the_cap_and_the_tolerance_end_the_search():
    assert [N_ for N_, _ in affine_moves(TWO_STATE, TWO_STATE_SPEC, most=6).horizons] == [1, 2, 4, 6]
    assert [N_ for N_, _ in affine_moves(TWO_STATE, TWO_STATE_SPEC, tolerance=0.01).horizons] == [1, 2, 4, 8, 16]
    assert [N_ for N_, _ in affine_moves(TWO_STATE, TWO_STATE_SPEC, tolerance=10.0).horizons] == [1, 2, 4]
    dearer = replace(TWO_STATE_SPEC, Q=1e6 * TWO_STATE_SPEC.Q, R=1e6 * TWO_STATE_SPEC.R)
    assert [N_ for N_, _ in affine_moves(TWO_STATE, dearer, tolerance=0.01).horizons] == [1, 2, 4, 8, 16]


@pytest.mark.parametrize("bound", [affine_moves, first_move, any_controller])
def test_a_time_limit_leaves_a_lower_bound_that_holds(bound):
    whole, cut = bound(TWO_STATE, TWO_STATE_SPEC), bound(TWO_STATE, TWO_STATE_SPEC, seconds=0.0)
    assert cut.cut_short and not whole.cut_short
    assert cut.holds() and 0 < cut.value <= whole.value


def test_time_that_suffices_changes_nothing():
    plant, spec = draw(0)
    whole, timed = affine_moves(plant, spec, most=8), affine_moves(plant, spec, most=8, seconds=1e4)
    assert timed.horizons == whole.horizons and not timed.cut_short
    whole, timed = any_controller(plant, spec, cells=200), any_controller(plant, spec, cells=200, seconds=1e4)
    assert timed.value == pytest.approx(whole.value, rel=1e-9) and not timed.cut_short


def test_a_time_limit_is_a_number_of_seconds():
    for bound in (affine_moves, any_controller):
        with pytest.raises(InvalidInputError, match="seconds"):
            bound(TWO_STATE, TWO_STATE_SPEC, seconds=-1.0)


def test_it_does_not_stop_before_the_inputs_have_reached_the_cost():
    # A chain of four: the cost is on the end, and what the input does arrives there after four steps.
    A = np.diag([1.2, 0, 0, 0]) + np.eye(4, k=1)
    late = Moments(Box(-np.ones(4), np.ones(4)), np.zeros(4), np.diag([1e-12, 0, 0, 1]))
    spec = Spec(np.diag([1.0, 0, 0, 0]), 0.0, 1.0, late, Box(-0.1, 0.1))
    bound = affine_moves(Plant(A, np.eye(4)[:, 3:]), spec, tolerance=1e-3, most=8)
    assert bound.horizons[1][1] < 1e-11 and bound.value > 0.5 and bound.holds()


@pytest.mark.slow
def test_a_cost_without_limit_is_seen_to_grow():
    bound = affine_moves(Plant(2.0, 1.0), Spec(1.0, 0.0, 1.0, Box(-2, 2), Box(-1, 1)))
    assert bound.value > 1e6 and bound.holds()


def test_without_limits_value_iteration_settles():
    plant, spec = draw(0)
    free = affine_moves(plant, replace(spec, inputs=None))
    assert free.value == pytest.approx(any_controller(plant, replace(spec, inputs=None)).value, rel=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_relaxed_is_the_full_state_bound_and_no_larger(seed):
    plant, spec = draw(seed)
    full = Plant(plant.A, plant.B)
    for bound in (affine_moves, first_move):
        more = {"moves": 4} if bound is affine_moves else {}
        tight, relaxed = bound(plant, spec, **more), bound(plant, spec, relaxed=True, **more)
        assert relaxed.value == bound(full, spec, **more).value < tight.value * (1 - 1e-4)
        assert relaxed.holds() and relaxed.prove() and tight.prove()
    assert bound(full, spec, relaxed=True).value == bound(full, spec).value


def test_the_statement_says_whom_it_covers():
    plant, spec = draw(0)
    full = Plant(plant.A, plant.B)
    said = "Every linear time-invariant controller of any finite order that measures y = C x, started"
    assert said in affine_moves(plant, spec, 2).statement
    even = ", even a time-varying one, started"
    varying = affine_moves(plant, spec, 2, time_varying=True)
    assert "Every linear controller of any finite order that measures y = C x" + even in varying.statement
    assert "finite order, whatever it measures" + even in affine_moves(plant, spec, 2, relaxed=True).statement
    assert "finite order" + even in affine_moves(full, spec, 2, relaxed=True).statement


KNOWN = {
    "polytope": Uniform(HULL),
    "empirical": Empirical(HULL.vertices, np.arange(1, 1 + HULL.vertices.shape[1])),
    "moments": Moments(HULL, HULL.center + [0.1, 0.0, -0.05], 0.02 * np.eye(N) + 0.01),
}


@pytest.mark.parametrize("kind, options", [("free", {"relaxed": True}), ("rows", {"time_varying": True}), ("tied", {})])
@pytest.mark.parametrize("initial", KNOWN.values(), ids=KNOWN)
def test_a_program_on_trajectories_has_the_same_minimum(initial, kind, options):
    plant, spec = draw(3, initial)
    states, weights = with_moments(initial.mean, initial.covariance)
    true = sampled_program(plant, spec, 3, states, weights, initial.vertices, kind)
    bound = affine_moves(plant, spec, 3, **options)
    assert true * (1 - 1e-6) < bound.value < true * (1 + 1e-8)


def test_only_support_and_moments_count():
    plant, spec = draw(4)
    same = replace(spec, initial=Moments(HULL, HULL.center, HULL.covariance))
    assert affine_moves(plant, same, 3).value == pytest.approx(affine_moves(plant, spec, 3).value, rel=1e-9)
    less = replace(spec, initial=Moments(HULL, HULL.center, HULL.covariance / 2))
    assert affine_moves(plant, less, 3).value < affine_moves(plant, spec, 3).value


def test_moments_on_an_ellipsoid():
    disc = Moments(Ellipsoid(np.eye(2)), [0.0, 0.0], 0.25 * np.eye(2))  # those of the uniform distribution
    spec = Spec(np.eye(2), np.zeros((2, 2)), 0.8, disc, Box([-1, -1], [1, 1]))
    bound = first_move(Plant(1.5 * np.eye(2), np.eye(2)), spec)
    assert 0.6 - 1e-5 < bound.value < 0.5 * (1 + 0.8 * 0.25) and bound.prove()


def test_any_controller_starts_from_the_mean_when_only_moments_are_known():
    plant, spec = draw(5, Moments(HULL, HULL.center, 0.01 * np.eye(N)), Box([-0.3, -0.5], [0.4, 0.2]))
    at_mean = any_controller(plant, replace(spec, initial=Empirical(HULL.center[:, None])))
    everyone = any_controller(plant, spec)
    assert everyone.holds() and at_mean.value < everyone.value < affine_moves(plant, spec, relaxed=True).value
