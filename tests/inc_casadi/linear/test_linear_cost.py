"""The certified cost of dynamic controllers: summed motions, python-control, hand cases, and refusals with a reason."""

from dataclasses import replace
from fractions import Fraction

import control
import numpy as np
import pytest
from linear_draws import case, controller, expected, rolled, summed

from inc_casadi import Box, Ellipsoid, Empirical, Gaussian, Plant, Polytope, Spec, Uniform
from inc_casadi.blocks import exact
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.linear import input_limits
from inc_casadi.linear.controller import LinearController
from inc_casadi.linear.dynamic_loop import static_form
from inc_casadi.linear.input_limits import limit_weight
from inc_casadi.linear.linear_cost import linear_cost
from inc_casadi.linear.lyapunov import discounted_sum
from inc_casadi.linear.reach_of_rows import enclosing_box, is_below, verdicts

SCALAR = Plant(1.5, 1.0)


def unit(discount=0.5, R=0.0, initial=None, inputs=None):
    return Spec(1.0, R, discount, initial or Box(-1, 1), inputs or Box(-1, 1))


@pytest.mark.parametrize("seed", range(6))
def test_bound_and_worst_lie_just_above_summed_motions(seed):
    plant, spec = case(seed, p=4, radius=0.7, discount=(1.0, 0.9)[seed % 2])
    spec = replace(spec, inputs=Box([-9.0, -9.0], [9.0, 9.0]))
    law = controller(seed + 50)
    found = linear_cost(plant, spec, law)
    assert found.holds() and found.prove().succeeded, found.reason
    cost, corners = expected(plant, spec, law), summed(plant, spec, law, spec.initial.vertices)
    assert found.cost == pytest.approx(cost, rel=1e-9)
    assert cost * (1 - 1e-12) <= found.bound <= cost * (1 + 1e-8)
    assert max(corners) * (1 - 1e-12) <= found.worst <= max(corners) * (1 + 1e-8)


def test_the_cost_agrees_with_python_control():
    plant, spec = case(11, p=4, radius=0.7)
    law = controller(12)
    larger, gain = static_form(plant, law)
    beta, closed = spec.discount, larger.A + larger.B @ gain @ larger.C
    u = (gain @ larger.C)[: plant.m]
    stage = u.T @ spec.R @ u
    stage[: plant.n, : plant.n] += spec.Q
    P = control.dlyap(np.sqrt(beta) * closed.T, stage)
    start = np.vstack([spec.initial.quadrature(2)[0], np.tile(law.xi_0[:, None], (1, 8))])
    cost = np.sum(start * (P @ start), axis=0) @ spec.initial.quadrature(2)[1]
    assert linear_cost(plant, replace(spec, inputs=None), law).cost == pytest.approx(cost, rel=1e-9)


@pytest.mark.parametrize("initial", [Uniform(Ellipsoid([[2.0, 0.3], [0.3, 5.0]], [0.2, -0.1])),
                                     Gaussian([1.0, 0.0], np.eye(2)), Empirical([[1.0, 2.0], [0.0, 1.0]])])
def test_any_distribution_without_limits(initial):
    plant, law = Plant([[0.9, 0.3], [0.0, 0.7]], [[0.0], [1.0]], [[1.0, 0.5]]), controller(13, m=1, p=1, order=2)
    spec = Spec(np.diag([1.0, 2.0]), 0.3, 0.9, initial)
    found = linear_cost(plant, spec, law)
    assert found.holds() and found.cost == pytest.approx(expected(plant, spec, law, 400), rel=1e-9)
    assert (found.worst is None) == (not isinstance(initial, Empirical))


def test_a_limit_that_is_met_exactly_is_kept_and_one_a_hair_smaller_is_not():
    law = LinearController.static([[-1.0]])
    found = linear_cost(SCALAR, unit(), law)
    assert found.admissible and found.bound == pytest.approx(8 / 21, rel=1e-9)
    below = float(np.nextafter(1.0, 0.0))
    broken = linear_cost(SCALAR, unit(inputs=Box(-1, below)), law)
    assert not broken.admissible and "k = 0" in broken.reason and "facet 0" in broken.reason
    one_side = linear_cost(SCALAR, unit(initial=Box(-1, below), inputs=Box(-1, below)), law)
    assert not one_side.admissible and linear_cost(SCALAR, unit(inputs=Box(-1, 1.1)), law).admissible


@pytest.mark.parametrize("last, kept", [(0.5, True), (np.nextafter(0.5, 1.0), False)])
def test_a_limit_met_exactly_at_a_later_step_is_decided_in_fractions(last, kept):
    wait = LinearController([[0.0, 1.0], [0.0, 0.0]], np.zeros((2, 1)), [[1.0, 0.0]], [[0.0]], [0.0, last])
    found = linear_cost(Plant(0.25, 1.0), unit(1.0, inputs=Box(-0.5, 0.5)), wait)
    assert found.admissible == kept and ("k = 1" in found.reason) == (not kept)


@pytest.mark.parametrize("share, kept", [(1 + 1e-12, True), (1 - 1e-12, False)])
def test_rounding_that_has_built_up_is_not_taken_for_room(share, kept):
    """Two states near 1e8 whose difference is the input: floats see it to eight digits only."""
    b, Y = 0.3, 1e8
    a, X = b + 1e-8, Y + 0.1
    law = LinearController(np.diag([a, b]), np.zeros((2, 1)), [[1.0, -1.0]], [[0.0]], [X, Y])
    peak = float(Fraction(a) * Fraction(X) - Fraction(b) * Fraction(Y))  # at k = 1
    assert abs(a * X - b * Y - peak) > 1e-9 * peak
    found = linear_cost(Plant(0.25, 1.0), unit(1.0, inputs=Box(-share * peak, share * peak)), law)
    assert found.admissible == kept and ("k = 1" in found.reason) == (not kept), found.reason


@pytest.mark.parametrize("seed", [1, 3, 6])
def test_rounding_that_excites_a_slow_mode_is_counted(seed):
    """A fast mode of size 1e8 dies out unseen; what rounding puts into the slow ones is as large as the inputs."""
    T = np.random.default_rng(seed).standard_normal((3, 3))
    A_c = T @ np.array([[0.95, 1, 0], [0, 0.95, 0], [0, 0, 0.1]]) @ np.linalg.inv(T)
    xi_0, C_c = 1e8 * T[:, 2], np.linalg.svd(T[:, 2:].T)[2][1]
    exactly, floats, seen, rounded = exact(xi_0), xi_0, [], []
    for _ in range(40):
        seen.append(abs(float(exact(C_c) @ exactly)))
        rounded.append(abs(C_c @ floats))
        exactly, floats = exact(A_c) @ exactly, A_c @ floats
    peak = max(seen)
    assert max(rounded) < 0.7 * peak and int(np.argmax(seen)) > 8
    law = LinearController(A_c, np.zeros((3, 1)), C_c[None, :], [[0.0]], xi_0)
    for share, kept in ((1 - 1e-6, False), (0.9, False), (1e6, True)):
        found = linear_cost(Plant(0.25, 1.0), unit(1.0, inputs=Box(-share * peak, share * peak)), law)
        assert found.admissible == kept, found.reason


def test_a_limit_broken_late_is_found_and_the_step_named():
    wait = LinearController(np.eye(7, k=1), np.zeros((7, 1)), np.eye(1, 7), [[0.0]], 2.0 * np.eye(7)[6])
    found = linear_cost(Plant(0.25, 1.0), unit(1.0), wait)
    assert not found.holds() and "k = 6" in found.reason and found.cost < np.inf


@pytest.mark.parametrize("seed", range(8))
def test_limits_are_admitted_just_above_the_peaks_of_the_motions_and_not_just_below(seed):
    plant, spec = case(seed, p=4, radius=0.7)
    law = controller(seed + 90)
    _, inputs = rolled(plant, law, spec.initial.vertices, 400)
    high, low = np.max(inputs, axis=(0, 2)), np.min(inputs, axis=(0, 2))
    assert np.all(high > 0) and np.all(low < 0)
    for share in (1 + 1e-9, 1 + 1e-3):
        assert linear_cost(plant, replace(spec, inputs=Box(share * low, share * high)), law).admissible
    for i in range(4):
        ends = np.concatenate([low, high])
        ends[i] *= 1 - 1e-9
        assert not linear_cost(plant, replace(spec, inputs=Box(ends[:2], ends[2:])), law).admissible


@pytest.mark.parametrize("initial", [
    Ellipsoid([[2.0, 0.3], [0.3, 5.0]], [0.1, -0.1]), Polytope([[-1, 0], [0, -1], [1, 1]], [0.5, 0.5, 0.5]),
    Empirical([[0.1, 0.9, -0.5], [0.1, -0.1, 0.0]]), Empirical([[0.5, -0.5], [0.25, -0.25]])])
def test_the_largest_admissible_gain_on_every_kind_of_set(initial):
    plant, K = Plant([[0.5, 0.2], [0.0, 0.4]], [[1.0], [0.5]]), np.array([[-0.3, 0.4]])
    spec = Spec(np.eye(2), 0.1, 1.0, initial, Box(-0.2, 0.3))
    draws = spec.initial.sample(4000, np.random.default_rng(0))
    if not isinstance(initial, Ellipsoid):
        draws = spec.initial.vertices
    _, inputs = rolled(plant, LinearController.static(K), draws, 40)
    share = min(0.3 / inputs.max(), -0.2 / inputs.min())
    assert linear_cost(plant, spec, LinearController.static(0.97 * share * K)).holds()
    assert not linear_cost(plant, spec, LinearController.static(1.01 * share * K)).holds()


def test_unstable_loops_are_refused_with_the_radius():
    found = linear_cost(SCALAR, unit(1.0), LinearController.static([[-0.4]]))
    assert found.P is None and found.bound == found.cost == found.worst == np.inf
    assert not found.holds() and not found.prove() and "1.1" in found.reason and "Not certified" in found.sentence


def test_a_finite_cost_without_stability_does_not_make_inputs_admissible():
    found = linear_cost(Plant(1.1, 1.0), unit(0.5), LinearController.static([[0.01]]))
    assert found.P is not None and found.W is None and not found.admissible and "not stable" in found.reason
    free = linear_cost(Plant(1.1, 1.0), replace(unit(0.5), inputs=None), LinearController.static([[0.01]]))
    assert free.holds() and free.cost == pytest.approx(1 / 3 / (1 - 0.5 * 1.11**2))


def test_unbounded_initial_states_and_limits_without_room_at_zero_are_refused():
    law = LinearController.static([[-1.0]])
    gaussian = linear_cost(SCALAR, unit(initial=Gaussian([0.0], [[1.0]])), law)
    assert not gaussian.admissible and "unbounded" in gaussian.reason
    assert "u = 0" in linear_cost(SCALAR, unit(inputs=Box(0.0, 1.0)), law).reason
    assert "u = 0" in linear_cost(SCALAR, unit(inputs=Box(0.1, 1.0)), law).reason


def test_a_motion_that_settles_too_slowly_is_left_open(monkeypatch):
    monkeypatch.setattr(input_limits, "MOST_STEPS", 200)
    found = linear_cost(Plant(1 - 1e-6, 1.0), unit(1.0), LinearController.static([[-1e-9]]))
    assert found.holds()  # slow, but the inputs are so small that their energy says enough
    slow = LinearController([[1 - 1e-7]], [[0.0]], [[0.5]], [[0.0]], [1.0])
    found = linear_cost(Plant(0.5, 1.0), unit(0.9), slow)
    assert not found.admissible and "open" in found.reason


@pytest.mark.parametrize("part, factor", [("P", 0.999), ("P", -1.0), ("W", 0.49), ("W", -1.0)])
def test_corrupted_matrices_are_refused(part, factor):
    plant, spec = case(21, p=4, radius=0.7)
    spec = replace(spec, inputs=Box([-9.0, -9.0], [9.0, 9.0]))
    found = linear_cost(plant, spec, controller(22))
    assert found.holds()
    wrong = replace(found, **{part: factor * getattr(found, part)})
    assert not wrong.holds() and not wrong.prove() and "not positive" in wrong.prove().reason
    assert min(wrong.margins().values()) < 0 < min(found.margins().values())


def test_an_energy_with_the_discount_in_it_is_no_proof_of_limits():
    plant, spec = case(25, p=4, radius=0.7)
    found = linear_cost(plant, replace(spec, inputs=Box([-9.0, -9.0], [9.0, 9.0])), controller(26))
    R_w, loop = limit_weight(found.spec.inputs), found.loop
    W = discounted_sum(loop.F, 1.0001 * loop.G[:2].T @ R_w @ loop.G[:2] + 1e-9 * np.eye(6), 0.95)
    assert found.holds() and not replace(found, W=W).holds()


def test_a_matrix_lowered_in_one_direction_only_is_refused():
    plant, spec = case(23, p=4, radius=0.7)
    found = linear_cost(plant, replace(spec, inputs=None), controller(24))
    lowered = found.P.copy()
    lowered[3, 3] -= 1e-6 * lowered[3, 3]
    assert found.holds() and not replace(found, P=lowered).holds()


def test_what_does_not_fit_is_refused_at_the_door():
    with pytest.raises(InvalidInputError, match="continuous"):
        linear_cost(Plant(-1.0, 1.0, dt=0.0), unit(1.0), LinearController.static([[-1.0]]))
    with pytest.raises(DimensionError, match="measurements"):
        linear_cost(SCALAR, unit(), LinearController.static([[-1.0, 0.0]]))


def test_the_sentence_states_rounded_up_numbers():
    found = linear_cost(SCALAR, unit(), LinearController.static([[-1.0]]))
    assert found.sentence == ("This static linear controller keeps the input limits from every initial state and costs at "
                              "most 0.3809524 on average over the initial states, and at most 1.142858 from the worst.")
    assert found.require() is found and str(found) == found.sentence


@pytest.mark.parametrize("inputs", [Box([-1.0, -3.0], [0.2, 4.0]), Polytope([[1, 1], [-1, 0.5], [0, -1]], [1.0, 2.0, 0.3])])
def test_the_weight_of_the_limits_dominates_every_facet(inputs):
    R_w = limit_weight(inputs)
    for u in np.random.default_rng(0).standard_normal((200, 2)):
        assert np.max((inputs.H @ u / inputs.h) ** 2) < u @ R_w @ u


def test_boxes_enclose_and_rows_are_judged_on_both_sides():
    ellipsoid = Uniform(Ellipsoid([[2.0, 0.3], [0.3, 5.0]], [0.2, -0.1]))
    center, half = enclosing_box(ellipsoid)
    draws = ellipsoid.sample(20_000, np.random.default_rng(1))
    spread = np.max(np.abs(draws - center[:, None]), axis=1)
    assert np.all(spread <= half) and np.all(half <= 1.02 * spread)
    row, sets = np.array([1.0, -2.0]), [ellipsoid, Uniform(Box([-1, 0], [1, 2])), Empirical([[1.0, 3.0], [0.0, 4.0]])]
    for initial in sets:
        most = row @ initial.mean + np.sqrt(row @ np.linalg.solve(ellipsoid.support.P, row)) if initial is ellipsoid \
            else np.max(row @ initial.vertices)
        room = most + np.array([1e-9, -1e-9])
        found = verdicts(initial, np.tile(row, (2, 1)), room, np.zeros(2), np.full(2, 9.0))
        assert found[0] == 1 and found[1] < 1
        assert [is_below(initial, exact(row), Fraction(float(value))) for value in room] == [True, False]
        assert verdicts(initial, row[None], room[:1], np.array([1e-6]), np.full(2, 9.0))[0] == 0
