"""Moves of a time-invariant controller are tied across time: a bound its class attains, proved, refused when forged."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from affine_oracle import sampled_program, with_moments
from linear_draws import case, controller, expected, rolled, summed

from inc_casadi import Box, Ellipsoid, Empirical, Moments, Plant, Polytope, Spec
from inc_casadi.blocks import exact
from inc_casadi.bounds import affine_moves, any_controller, first_move
from inc_casadi.bounds.tied import hidden_states
from inc_casadi.linear.best_dynamic import best_dynamic_linear

A, B = [[1.10, 1.00], [0.0, 1.02]], [[0.20], [0.50]]
ONE_OUTPUT = Plant(A, B, C=[[1.0, 0.0]])
SPEC = Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box(-1, 1))


def test_one_output_of_the_two_state_plant_closes_the_gap():
    bound, upper = affine_moves(ONE_OUTPUT, SPEC), best_dynamic_linear(ONE_OUTPUT, SPEC)
    assert 5.91707 < bound.value <= bound.exact_value() <= Fraction(upper.bound) and upper.bound < bound.value * (1 + 1e-8)
    assert bound.holds() and bound.prove() and upper.holds()
    _, inputs = rolled(ONE_OUTPUT, upper.controller, SPEC.initial.vertices, 600)
    assert np.max(np.abs(inputs)) <= 1 and expected(ONE_OUTPUT, SPEC, upper.controller, 600) > bound.value
    assert [N for N, _ in bound.horizons] == [1, 2, 4, 8, 16, 32]


@pytest.mark.parametrize("moves, tied, varying", [(1, 1.0765447, 1.0765447), (2, 1.9735314, 1.9559861),
                                                  (4, 4.2653660, 3.9709002), (20, 5.9170702, 4.7063522)])
def test_the_figures_of_the_two_state_plant(moves, tied, varying):
    assert affine_moves(ONE_OUTPUT, SPEC, moves).value == pytest.approx(tied, abs=1e-7)
    assert affine_moves(ONE_OUTPUT, SPEC, moves, time_varying=True).value == pytest.approx(varying, abs=1e-7)


@pytest.mark.parametrize("seed, m, p, gap", [
    (0, 2, 2, 1e-9), (2, 2, 1, 1e-9), (3, 1, 2, 1e-8),
    *(pytest.param(*case, marks=pytest.mark.slow) for case in ((4, 1, 1, 1e-4), (5, 2, 1, 1e-6)))])
def test_the_gap_to_certified_controllers_is_small_on_unstable_plants(seed, m, p, gap):
    plant, spec = case(seed, n=3, m=m, p=p, size=0.2)
    bound, varying = affine_moves(plant, spec, 32), affine_moves(plant, spec, 32, time_varying=True)
    upper = best_dynamic_linear(plant, spec)
    assert varying.value * (1 + 1e-4) < bound.value < upper.bound < bound.value * (1 + gap)
    assert bound.holds() and varying.holds() and upper.holds()


@pytest.mark.parametrize("seed, m, p", [(6, 1, 1), (7, 2, 2)])
def test_long_horizons_of_very_unstable_plants_stay_accurate(seed, m, p):
    plant, spec = case(seed, n=3, m=m, p=p, size=0.2, radius=1.3)
    bound, upper = affine_moves(plant, spec, 32), best_dynamic_linear(plant, spec)
    assert bound.holds() and bound.prove() and bound.value < upper.bound < bound.value * (1 + 1e-5)
    assert 0.5 < affine_moves(plant, spec, 64).value / upper.bound < 1


@pytest.mark.parametrize("seed", range(4))
def test_a_program_with_the_gains_of_the_definition_has_the_same_minimum(seed):
    plant, spec = case(seed, n=3, m=1 + seed % 2, p=1 + seed // 2, size=0.3)
    nodes, weights = spec.initial.quadrature(2)
    for moves in (2, 5):
        true = sampled_program(plant, spec, moves, nodes, weights, spec.initial.vertices, "tied")
        bound = affine_moves(plant, spec, moves)
        assert bound.ties is not None and true * (1 - 1e-6) < bound.value < true * (1 + 1e-7)


FLAT = Moments(Box([-1, -0.5, -2], [1.5, 0.5, 1]), [0.1, 0.0, -0.4], np.outer([0.3, 0.1, -0.2], [0.3, 0.1, -0.2]))


KINDS = {
    "singular moments": FLAT, "ellipsoid": Ellipsoid(np.eye(3) + 0.3, [0.2, -0.1, 0.3]),
    "polytope": Polytope([[-1, 0, 0], [0, -1, 0], [0, 0, -1], [1, 1, 1]], [1, 0.5, 0, 1]),
    "points": Empirical(np.random.default_rng(8).standard_normal((3, 7))),
}


@pytest.mark.parametrize("initial", KINDS.values(), ids=KINDS)
def test_every_kind_of_initial_states(initial):
    plant, spec = case(1, n=3, m=2, p=1, size=0.3)
    spec = replace(spec, initial=Spec(spec.Q, spec.R, 0.9, initial).initial)
    bound, varying = affine_moves(plant, spec, 4), affine_moves(plant, spec, 4, time_varying=True)
    assert bound.holds() and bound.prove() and bound.value > varying.value * (1 + 1e-4)
    if not isinstance(initial, Ellipsoid):
        states, weights = with_moments(spec.initial.mean, spec.initial.covariance)
        true = sampled_program(plant, spec, 4, states, weights, spec.initial.vertices, "tied")
        assert true * (1 - 1e-5) < bound.value < true * (1 + 1e-7)


@pytest.mark.parametrize("C", [None, [[1.0, 2.0], [0.0, 1.0]], [[1.0, 2.0], [0.0, 1.0], [1.0, 0.0]]])
def test_measured_states_are_not_tied(C):
    bound, varying = (affine_moves(Plant(A, B, C), SPEC, 8, time_varying=varying) for varying in (False, True))
    assert bound.ties is None and "even a time-varying one" in bound.statement
    assert bound.value == varying.value == pytest.approx(2.1167542, abs=1e-7)


def test_one_move_is_not_tied():
    assert first_move(ONE_OUTPUT, SPEC).value == affine_moves(ONE_OUTPUT, SPEC, 1, time_varying=True).value


def test_nothing_measured_and_measured_twice():
    blind = affine_moves(Plant(A, B, C=[[0.0, 0.0]]), SPEC, 5)
    corners = SPEC.initial.quadrature(2)
    assert blind.holds() and blind.value == pytest.approx(
        sampled_program(Plant(A, B, C=[[0.0, 0.0]]), SPEC, 5, *corners, SPEC.initial.vertices, "tied"), rel=1e-6)
    twice = affine_moves(Plant(A, B, C=[[1.0, 0.0], [-3.0, 0.0]]), SPEC, 5)
    assert twice.ties.shape == (5, 1, 1) and twice.value == pytest.approx(affine_moves(ONE_OUTPUT, SPEC, 5).value, rel=1e-8)


def test_states_in_a_plane_leave_the_ties_out():
    plane = Empirical(np.array([[1.0, 0.0, -1.0, 0.3], [0.0, 1.0, -1.0, 0.3], [1.0, 1.0, -2.0, 0.6]]) / 4)
    plant, spec = case(2, n=3, m=2, p=1)
    spec = replace(spec, initial=plane)
    bound = affine_moves(plant, spec, 4)
    assert bound.ties is None and bound.holds() and bound.value == affine_moves(plant, spec, 4, time_varying=True).value
    nodes = sampled_program(plant, spec, 4, plane.points, plane.weights, plane.points, "tied")
    assert bound.value <= nodes * (1 + 1e-7)


def test_where_rounding_takes_much_of_a_tied_bound_an_untied_one_is_given():
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    plant, spec = case(2, n=3, m=2, p=1)
    for shape, tied in (([1.0, 2.0, 1e4], True), ([1.0, 1.0, 1e12], False)):
        bound = affine_moves(plant, replace(spec, initial=Ellipsoid(turn @ np.diag(shape) @ turn.T)), 2)
        assert (bound.ties is not None) == tied and bound.holds() and bound.prove()


@pytest.mark.parametrize("seed", range(6))
def test_no_time_invariant_controller_that_keeps_the_limits_costs_less(seed):
    plant, spec = case(seed, n=3, m=2, p=2, radius=0.95)
    bound = affine_moves(plant, spec, 12)
    nodes, weights = spec.initial.quadrature(2)
    kept = 0
    for gain in (0.3, 0.1, 0.03, 0.0):
        law = controller(seed, m=2, p=2, order=3, gain=gain)
        _, inputs = rolled(plant, law, spec.initial.vertices, 300)
        if np.all(spec.inputs.H @ inputs <= spec.inputs.h[:, None]):
            kept += 1
            assert summed(plant, spec, law, nodes, 300) @ weights >= bound.value
    assert kept  # without any input at the latest


def test_a_time_varying_controller_costs_less():
    # u_k = Y_k x_0 + d_k needs the rows C, ..., CA^k only: gains on y_0..y_k that change with k. All limits are kept.
    varying, tied = affine_moves(ONE_OUTPUT, SPEC, 20, time_varying=True), affine_moves(ONE_OUTPUT, SPEC, 20)
    nodes, weights = SPEC.initial.quadrature(2)
    x, cost = nodes, 0.0
    assert np.allclose(varying.moves[0][:, 1], 0, atol=1e-7)
    for k, U in enumerate(0.9999 * varying.moves):
        assert np.max(np.abs(U @ np.vstack([SPEC.initial.vertices, np.ones(4)]))) <= 1
        u = U @ np.vstack([nodes, np.ones(nodes.shape[1])])
        cost += SPEC.discount**k * weights @ (np.sum(x * x, axis=0) + 0.05 * u[0] ** 2)
        x = ONE_OUTPUT.A @ x + ONE_OUTPUT.B @ u
    assert cost + SPEC.discount**20 * weights @ np.sum(x * x, axis=0) < 0.8 * tied.value


def test_no_tied_moves_cost_less_in_exact_arithmetic():
    plant, spec = case(3, n=3, m=2, p=1, size=0.3)
    spec = replace(spec, initial=Empirical(spec.initial.vertices, np.arange(1, 9)))
    bound, points = affine_moves(plant, spec, 3), exact(spec.initial.vertices)
    low, rng, Af, Bf, C = bound.exact_value(), np.random.default_rng(0), exact(plant.A), exact(plant.B), exact(plant.C)
    near = [np.linalg.lstsq(plant.C.T, (bound.moves[k][:, :3] - (bound.moves[k - 1][:, :3] @ plant.A if k else 0)).T)[0].T
            for k in range(3)]
    for trial in range(8):
        T = [exact(each + 0.02 * trial * rng.standard_normal(each.shape)) for each in near]
        Y, Y_k = [], np.full((2, 3), Fraction(0), dtype=object)
        for each in T:
            Y_k = Y_k @ Af + each @ C
            Y.append(Y_k)
        middle = exact((spec.inputs.upper + spec.inputs.lower) / 2)[:, None]
        inputs = np.stack([Y_k @ points + exact(bound.moves[k][:, 3:]) for k, Y_k in enumerate(Y)]) - middle
        over = max(1, np.max(np.abs(inputs) / (exact(spec.inputs.upper)[:, None] - middle)))
        inputs = inputs / over + middle  # all gains and constants shrunk alike, so that they stay tied
        x, cost, weights = points, Fraction(0), exact(spec.initial.weights) / exact(spec.initial.weights).sum()
        for k, u in enumerate(inputs):
            stage = np.sum(x * (exact(spec.Q) @ x), axis=0) + np.sum(u * (exact(spec.R) @ u), axis=0)
            cost += Fraction(spec.discount) ** k * (weights @ stage)
            x = Af @ x + Bf @ u
        cost += Fraction(spec.discount) ** 3 * (weights @ np.sum(x * (exact(spec.Q) @ x), axis=0))
        assert cost >= low and (trial or cost < low * Fraction(1.0001))


def test_any_ties_prove_something_lower_and_exactly_that():
    bound = affine_moves(ONE_OUTPUT, SPEC, 5)
    rng = np.random.default_rng(0)
    for scale in (1e-3, 1e-1, 10.0):
        worse = replace(bound, ties=bound.ties + scale * rng.standard_normal(bound.ties.shape))
        value, allowance = worse.dual()
        assert not worse.holds() and not worse.prove()
        assert value - allowance <= worse.exact_value() <= value + allowance < bound.value
        assert replace(worse, value=value - allowance).holds() and replace(worse, value=value - allowance).prove()


def test_the_sizes_for_rounding_add_up_all_terms():
    bound = affine_moves(*case(1, n=3, m=2, p=1), 3)
    rng, cuts, inputs = np.random.default_rng(0), bound.cuts, bound.spec.inputs
    bound = replace(bound, multipliers=rng.uniform(size=bound.multipliers.size), ties=rng.standard_normal(bound.ties.shape))
    slopes, root, Z = rng.standard_normal((3, 2, 4)), rng.standard_normal((4, 4)), hidden_states(bound.plant).astype(float)
    for found, size in zip(bound.lagrangian.forces(slopes, root), (np.asarray, np.abs), strict=True):
        true = np.stack([size(slope) @ size(root.T) for slope in slopes])
        for move, facet, point, multiplier in zip(cuts.move, cuts.facet, cuts.point.T, bound.multipliers, strict=True):
            true[move] += multiplier * size(np.outer(inputs.H[facet], np.append(point, 1.0)))
        for k in range(3):
            true[k, :, :3] += size(bound.ties[k]) @ size(Z.T)
            if k:
                sign = -1 if size is np.asarray else 1
                true[k - 1, :, :3] += sign * size(bound.ties[k]) @ size(Z.T) @ size(bound.plant.A.T)
        np.testing.assert_allclose(found, true, rtol=1e-12, atol=1e-12)


def corrupted(bound):
    ties = bound.ties
    yield "none", replace(bound, ties=None)
    yield "of the other sign", replace(bound, ties=-ties)
    yield "a step late", replace(bound, ties=np.roll(ties, 1, axis=0))
    yield "too few", replace(bound, ties=ties[1:])
    yield "of other shape", replace(bound, ties=ties[:, :, :1])
    yield "no number", replace(bound, ties=np.full_like(ties, np.nan))
    yield "infinite", replace(bound, ties=np.full_like(ties, np.inf))
    yield "another measurement", replace(bound, plant=Plant(bound.plant.A, bound.plant.B, bound.plant.C + [0.0, 0.0, 0.01]))
    yield "more measurements", replace(bound, plant=Plant(bound.plant.A, bound.plant.B, np.eye(3)[:2]))
    yield "relaxed", replace(bound, relaxed=True)
    yield "another plant", replace(bound, plant=Plant(0.99 * bound.plant.A, bound.plant.B, bound.plant.C))
    face = bound.anchors[0] > np.min(bound.anchors[0])
    yield "anchors in a plane", replace(bound, anchors=bound.anchors[:, face], value=-1e9)


CORRUPTED = dict(corrupted(affine_moves(*case(1, n=3, m=2, p=1), 4)))


@pytest.mark.parametrize("bound", CORRUPTED.values(), ids=CORRUPTED)
def test_corrupted_ties_are_refused(bound):
    assert not bound.holds() and not bound.prove() and bound.prove().reason


def test_it_depends_on_neither_coordinates_nor_units():
    plant, spec = case(4, n=3, m=2, p=1)
    T, units = np.random.default_rng(3).standard_normal((3, 3)), np.array([1e-3, 50.0])
    back = np.linalg.inv(T)
    there = Plant(T @ plant.A @ back, T @ plant.B * units, C=1e5 * plant.C @ back)
    corners = Polytope.from_vertices(T @ spec.initial.vertices)
    moved = Spec(1e4 * back.T @ spec.Q @ back, 1e4 * spec.R * np.outer(units, units), spec.discount, corners,
                 Box(spec.inputs.lower / units, spec.inputs.upper / units))
    assert affine_moves(there, moved, 6).value == pytest.approx(1e4 * affine_moves(plant, spec, 6).value, rel=1e-6)


def test_more_moves_raise_it_and_it_is_above_that_of_all_controllers():
    plant, spec = case(2, n=3, m=1, p=1)
    values = [affine_moves(plant, spec, N).value for N in (1, 2, 3, 6, 12)]
    assert np.all(np.diff(values) > 0) and values[-1] > any_controller(plant, spec).value
