"""The certificate of laws that never switch: against summed motions, hand cases at the edge, and corrupted numbers."""

from dataclasses import replace

import numpy as np
import pytest

from inc_casadi import (
    INC,
    Box,
    Ellipsoid,
    Gaussian,
    LeakyReLU,
    Plant,
    Polytope,
    Saturation,
    Spec,
    Tanh,
    Uniform,
    load,
    save,
    simulate,
)
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.linear.controller import LinearController
from inc_casadi.linear.linear_cost import linear_cost
from inc_casadi.linear.unswitched_cost import UnswitchedCost, unswitched_cost

SCALAR, UNIT = Plant(1.5, 1.0), Box(-1, 1)
PLANT = Plant([[1.1, 0.2, 0.0], [-0.1, 0.9, 0.1], [0.0, 0.2, 0.8]], [[0.0, 0.1], [1.0, 0.0], [0.0, 0.7]],
              [[1.0, 0.2, 0.0], [0.0, 1.0, 0.0], [0.3, 0.0, 1.0], [0.0, 0.5, 0.5]])
K = np.array([[-0.45, -0.35, 0.05, -0.1], [-0.1, 0.05, -0.2, 0.1]])


def spec(limit=1.0, discount=0.95, initial=None):
    initial = initial or Box([-0.5, -0.3, -0.2], [0.4, 0.3, 0.6])
    limits = Box([-limit, -limit], [limit, 1.5 * limit])
    return Spec(np.diag([1.0, 0.5, 2.0]), [[0.3, 0.1], [0.1, 0.4]], discount, initial, limits)


def scalar(initial=UNIT, **parts):
    return Spec(**({"Q": 1.0, "R": 0.0, "discount": 0.5, "initial": initial, "inputs": UNIT} | parts))


def summed(plant, asked, law, x, steps=600):
    motion = simulate(plant, law, x, steps=steps)
    states, inputs = motion.x[..., :steps], motion.u[..., :steps]
    stage = (np.einsum("i...k,ij,j...k->...k", states, asked.Q, states)
             + np.einsum("i...k,ij,j...k->...k", inputs, asked.R, inputs))
    return stage @ asked.discount ** np.arange(steps)


CLIPPED = INC.linear(K).with_saturated_output(spec().inputs)


@pytest.mark.parametrize("law", [INC.linear(K), CLIPPED], ids=["linear", "clipped"])
def test_bound_and_worst_lie_just_above_summed_motions(law):
    found = unswitched_cost(PLANT, spec(), law)
    assert found.holds() and found.prove().succeeded, found.reason
    nodes, weights = spec().initial.quadrature(2)  # exact for a quadratic
    cost, corners = summed(PLANT, spec(), law, nodes) @ weights, summed(PLANT, spec(), law, spec().initial.vertices)
    assert cost * (1 - 1e-12) <= found.bound <= cost * (1 + 1e-8) and found.gap == 0
    assert max(corners) * (1 - 1e-12) <= found.worst_bound <= max(corners) * (1 + 1e-8)
    assert found.worst[1] == pytest.approx(spec().initial.vertices[:, np.argmax(corners)])


def test_it_is_the_cost_of_the_linear_controller():
    asked = spec()
    other = linear_cost(PLANT, asked, LinearController.static(K))
    found = unswitched_cost(PLANT, asked, CLIPPED)
    assert found.bound == pytest.approx(other.bound, rel=1e-10)
    assert found.worst_bound == pytest.approx(other.worst, rel=1e-10)


def test_an_implicit_law_with_units_held_off_their_kinks():
    """eta = 1 - y / 2 and u = -y while the leaky ReLU is active, which it is for y < 2."""
    law = INC([[0.5]], [[-0.25]], [[2.0]], [[0.0]], b=[0.5], d=[-2.0], activation=LeakyReLU(0.5))
    found = unswitched_cost(SCALAR, scalar(inputs=Box(-2, 2)), law)
    assert found.holds() and found.prove() and found.bound == pytest.approx(1 / (3 * (1 - 0.5 / 4)), rel=1e-9)
    far = unswitched_cost(SCALAR, scalar(Box(-2.5, 2.5), inputs=Box(-9, 9)), law)
    assert far.reason == "at k = 0 unit 0 leaves its affine piece by 25 % of the way to there" and not far.prove()


@pytest.mark.parametrize("limit, kept", [(1.0, True), (1.0 - 2.0**-52, False)])
def test_the_edge_is_decided_to_the_last_bit(limit, kept):
    asked = scalar(inputs=Box(-limit, limit))
    found = unswitched_cost(SCALAR, asked, INC.linear([[-1.0]]))
    assert found.holds() == kept == bool(found.prove())
    assert kept or "an input leaves facet" in found.reason


def test_limits_that_are_left_later_are_seen():
    """x+ = [1.2 1; 0 0.5] x - ...: the input grows before it falls."""
    plant, law = Plant([[0.9, 2.0], [0.0, 0.3]], [[0.0], [1.0]]), INC.linear([[-0.2, 0.0]])
    asked = Spec(np.eye(2), 0.1, 1.0, Box([-0.1, -1.0], [0.1, 1.0]), Box(-0.3, 0.3))
    motion = simulate(plant, law, [0.1, 1.0], steps=5)
    assert abs(motion.u[0, 0]) < 0.3 < abs(motion.u[0, 1])
    assert unswitched_cost(plant, asked, law).reason.startswith("at k = 1 an input leaves facet")


def test_without_limits_any_distribution_will_do():
    found = unswitched_cost(SCALAR, Spec(1.0, 0.0, 0.9, Gaussian([0.0], [[1.0]])), INC.linear([[-1.0]]))
    assert found.holds() and found.prove() and found.bound == pytest.approx(1 / (1 - 0.9 / 4), rel=1e-9)
    assert found.worst_bound == np.inf and "from any" not in found.sentence


def test_an_ellipsoid_of_initial_states():
    asked = Spec(np.eye(2), 1.0, 0.95, Uniform(Ellipsoid([[4.0, 0.0], [0.0, 9.0]])), UNIT)
    plant, law = Plant([[0.7, 0.2], [0.0, 0.6]], [[0.0], [1.0]]), INC.saturated([[-0.3, -0.2]], 1.0)
    found = unswitched_cost(plant, asked, law)
    angles = np.linspace(0, 2 * np.pi, 400)
    costs = summed(plant, asked, law, np.vstack([np.cos(angles) / 2, np.sin(angles) / 3]))
    assert found.holds() and max(costs) <= found.worst_bound <= 1.001 * max(costs)


@pytest.mark.parametrize("law, why", [
    (INC.linear([[-0.4]]), "spectral radius 1.1"), (INC.linear([[-0.5]]), "spectral radius 1"),
    (INC([[0.0]], [[1.0]], [[-1.0]], [[0.0]], activation=Tanh()), "unit 0 is curved"),
    (INC([[1.5]], [[1.0]], [[1.0]], [[0.0]]), "not proved unique")])
def test_refusals_name_what_fails(law, why):
    found = unswitched_cost(SCALAR, scalar(), law)
    assert why in found.reason and not found.holds() and not found.prove() and why in found.sentence


def test_limits_without_zero_well_inside_are_refused():
    found = unswitched_cost(SCALAR, scalar(inputs=Box(0, 1)), INC.linear([[-1.0]]))
    assert "where the loop would rest, an input leaves facet" in found.reason


@pytest.mark.parametrize("name, factor", [("P", 1 - 1e-6), ("W", 1 - 1e-6), ("P", -1.0), ("W", 0.5)])
def test_corrupted_numbers_are_refused(name, factor):
    found = unswitched_cost(PLANT, spec(), INC.linear(K))
    bad = replace(found, **{name: factor * getattr(found, name)})
    assert not bad.holds() and not bad.prove()


def test_the_certificate_of_another_law_is_refused():
    found = unswitched_cost(PLANT, spec(), INC.linear(K))
    assert not replace(found, inc=INC.linear(1.05 * K)).holds()
    for heavier in ({"Q": 1.01 * spec().Q}, {"R": 1.01 * spec().R}, {"discount": 0.96}):
        assert not replace(found, spec=replace(spec(), **heavier)).holds()


def test_a_change_of_coordinates_leaves_the_cost():
    T = np.array([[2.0, 1.0, 0.0], [0.0, 0.5, 0.0], [0.25, 0.0, 4.0]])
    inverse, vertices = np.linalg.inv(T), spec().initial.vertices
    moved = Plant(T @ PLANT.A @ inverse, T @ PLANT.B, PLANT.C @ inverse)
    asked = replace(spec(), Q=inverse.T @ spec().Q @ inverse, initial=Uniform(Polytope.from_vertices(T @ vertices)))
    left, right = (unswitched_cost(*pair, CLIPPED)
                   for pair in ((PLANT, spec()), (moved, asked)))
    assert right.holds() and left.bound == pytest.approx(right.bound, rel=1e-9)


def test_it_is_kept_in_a_file(tmp_path):
    found = unswitched_cost(PLANT, spec(), CLIPPED)
    save(found, tmp_path / "found.json")
    again = load(tmp_path / "found.json")
    assert isinstance(again, UnswitchedCost) and again.holds() and again.prove() and again.bound == found.bound


def test_twelve_states_take_no_longer_than_their_corners():
    A = 0.9 * np.eye(12) + 0.05 * np.eye(12, k=1)
    law = INC.saturated(-0.02 * np.ones((1, 12)), 1.0)
    asked = Spec(np.eye(12), 1.0, 0.98, Box(-np.ones(12), np.ones(12)), UNIT)
    assert unswitched_cost(Plant(A, np.eye(12, 1, -11)), asked, law).holds()


def test_what_does_not_fit_is_refused_at_the_door():
    with pytest.raises(InvalidInputError, match="continuous"):
        unswitched_cost(Plant(-1.0, 1.0, dt=0), scalar(), INC.linear([[0.0]]))
    with pytest.raises(DimensionError):
        unswitched_cost(SCALAR, scalar(), INC.linear([[1.0, 2.0]]))
    with pytest.raises(DimensionError):
        UnswitchedCost(SCALAR, scalar(), INC.linear([[-1.0]]), np.eye(3), np.eye(1))


def test_a_saturation_that_is_hit_exactly_still_counts():
    """sat is continuous: at its kink both pieces agree, so reaching it switches nothing."""
    found = unswitched_cost(SCALAR, scalar(), INC([[0.0]], [[-1.0]], [[1.0]], [[0.0]], activation=Saturation()))
    assert found.holds() and found.bound == pytest.approx(1 / (3 * (1 - 0.5 / 4)), rel=1e-9)


def test_an_affine_law_is_counted_from_zero_though_it_rests_elsewhere():
    """u = 1/4 - x on x+ = 1.5 x + u rests at 1/2, and u lies in [-3/4, 3/4] to the last bit."""
    law = INC(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[-1.0]], d=[0.25])
    asked = Spec(1.0, 0.5, 0.9, Box(-0.5, 1.0), Box(-0.75, 0.75))
    found = unswitched_cost(SCALAR, asked, law)
    nodes, weights = asked.initial.quadrature(2)
    assert found.holds() and found.prove(), found.reason
    assert found.bound == pytest.approx(summed(SCALAR, asked, law, nodes) @ weights, rel=1e-9)
    assert found.worst_bound == pytest.approx(max(summed(SCALAR, asked, law, asked.initial.vertices)), rel=1e-9)
    edge = unswitched_cost(SCALAR, replace(asked, inputs=Box(-0.74, 0.75)), law)
    assert edge.reason.startswith("at k = 0 an input leaves facet 1 of its limits")


def test_an_offset_without_discount_is_refused():
    law = INC(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[-1.0]], d=[0.2])
    assert "costs without end" in unswitched_cost(SCALAR, Spec(1.0, 0.5, 1.0, UNIT, Box(-2, 2)), law).reason


def test_an_ellipsoid_of_initial_states_about_another_rest():
    law = INC(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[-1.0]], d=[0.2])
    asked = Spec(1.0, 0.5, 0.9, Uniform(Ellipsoid([[4.0]], [0.1])), UNIT)
    found = unswitched_cost(SCALAR, asked, law)
    ends = max(summed(SCALAR, asked, law, np.array([[-0.4, 0.6]])))
    assert found.holds() and ends <= found.worst_bound <= (1 + 1e-6) * ends
