"""No admissible linear controller undercuts the bound; nothing but the stored numbers is needed to see it."""

import importlib
import os
import subprocess
import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from affine_oracle import sampled_program

from inc_casadi import Box, Ellipsoid, Empirical, Gaussian, Plant, Polytope, Spec, Uniform
from inc_casadi.bounds import affine_cuts, affine_moves, any_controller, first_move
from inc_casadi.errors import DimensionError, InvalidInputError

TWO_STATE = Plant([[1.10, 1.00], [0.0, 1.02]], [[0.20], [0.50]])
SQUARE = Box([-0.8, -0.8], [0.8, 0.8])
TWO_STATE_SPEC = Spec(np.eye(2), 0.05, 0.98, SQUARE, Box(-1, 1))
N, M, P = 3, 2, 1


def draw(seed, initial=None, radius=0.95):
    """A plant with 3 states, 2 inputs, 1 output and a spec without symmetry."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((N, N))
    A *= radius / np.max(np.abs(np.linalg.eigvals(A)))
    root = rng.standard_normal((N, N))
    initial = initial or Box([-1.0, -0.5, -2.0], [1.5, 0.5, 1.0])
    spec = Spec(root @ root.T, np.diag([0.1, 0.3]), 0.9, initial, Box([-0.3, -0.5], [0.4, 0.2]))
    return Plant(A, rng.standard_normal((N, M)), C=rng.standard_normal((P, N))), spec


@pytest.mark.parametrize("moves, value", [(1, 0.8465236), (2, 1.3507976), (3, 1.8011500), (5, 2.1037627),
                                          (8, 2.1167542), (20, 2.1167631)])
def test_the_figures_of_the_two_state_plant(moves, value):
    bound = affine_moves(TWO_STATE, TWO_STATE_SPEC, moves)
    assert bound.value == pytest.approx(value, abs=6e-8)
    assert bound.holds()


@pytest.mark.parametrize("moves", [1, 3])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_program_on_trajectories_has_the_same_minimum(moves, seed):
    plant, spec = draw(seed)
    plant = Plant(plant.A, plant.B)
    nodes, weights = spec.initial.quadrature(2)
    true = sampled_program(plant, spec, moves, nodes, weights, spec.initial.vertices)
    bound = affine_moves(plant, spec, moves)
    assert true * (1 - 1e-6) < bound.value < true * (1 + 1e-8)


@pytest.mark.parametrize("seed", range(6))
def test_no_dynamic_linear_output_feedback_undercuts_it(seed):
    plant, spec = draw(seed)
    rng = np.random.default_rng(100 + seed)
    bound = affine_moves(plant, spec, 12)
    nodes, weights = spec.initial.quadrature(2)
    states = np.hstack([nodes, spec.initial.vertices])
    order = 1 + seed % 3
    Ac = rng.standard_normal((order, order))
    Ac *= 0.8 / max(1.0, np.max(np.abs(np.linalg.eigvals(Ac))))
    Bc, Cc, Dc, xi0 = (rng.standard_normal(s) for s in ((order, P), (M, order), (M, P), (order, 1)))
    for shrink in (0.3, 0.1, 0.03, 0.0):
        x, xi, cost, held = states, np.tile(xi0, states.shape[1]), 0.0, True
        for k in range(300):
            y = plant.C @ x
            u = shrink * (Cc @ xi + Dc @ y)
            held = held and np.all(spec.inputs.contains(u[:, nodes.shape[1]:]))
            stage = np.sum(x * (spec.Q @ x) + 0, axis=0) + np.sum(u * (spec.R @ u), axis=0)
            cost += spec.discount**k * weights @ stage[:nodes.shape[1]]
            x, xi = plant.A @ x + plant.B @ u, Ac @ xi + Bc @ y
        if held:
            assert cost >= bound.value
    assert held  # without any input at the latest


@pytest.mark.parametrize("seed", range(3))
def test_more_moves_and_fewer_measurements_raise_it(seed):
    plant, spec = draw(seed)
    full = Plant(plant.A, plant.B)
    values = [affine_moves(plant, spec, moves).value for moves in (1, 2, 4, 8)]
    assert np.all(np.diff(values) > -1e-7 * values[-1])
    assert affine_moves(plant, spec, 8).value > affine_moves(full, spec, 8).value * (1 + 1e-6)
    mixed = Plant(plant.A, plant.B, C=np.random.default_rng(seed).standard_normal((N, N)))
    assert affine_moves(mixed, spec, 4).value == pytest.approx(affine_moves(full, spec, 4).value, rel=1e-6)


def test_any_multipliers_and_any_moves_prove_something_lower():
    plant, spec = draw(2)
    bound = affine_moves(plant, spec, 5)
    rng = np.random.default_rng(0)
    for scale in (1e-3, 1e-2, 1e-1):
        other = bound.multipliers * np.exp(scale * rng.standard_normal(bound.multipliers.size))
        for worse in (replace(bound, multipliers=other),
                      replace(bound, moves=bound.moves + scale * rng.standard_normal(bound.moves.shape))):
            assert worse.dual()[0] < bound.value
            assert not worse.holds()
            assert replace(worse, value=worse.dual()[0] - worse.dual()[1]).holds()


def test_the_tangent_by_hand():
    # From x_0 = 1 the cost is 1 + (2 + u)^2: at u = 0 the tangent is 5 + 4 u, at least 1 on [-1, 3]; at u = 1, 4 + 6 u.
    known = Spec(1.0, 0.0, 1.0, Empirical([[1.0]]), Box(-1, 3))
    bound = affine_moves(Plant(2.0, 1.0), known, 1)
    assert bound.value == pytest.approx(2.0, abs=1e-7)
    without = replace(bound, multipliers=0 * bound.multipliers)
    assert replace(without, moves=np.zeros((1, 1, 2))).dual()[0] == pytest.approx(1.0)
    assert replace(without, moves=np.array([[[0.0, 1.0]]])).dual()[0] == pytest.approx(-2.0)


def test_altered_numbers_are_refused():
    bound = affine_moves(TWO_STATE, TWO_STATE_SPEC, 3)
    assert bound.holds() and replace(bound, value=bound.value - 0.1).holds()
    assert not replace(bound, value=bound.value + 1e-9).holds()
    assert not replace(bound, value=float("nan")).holds()
    assert not replace(bound, multipliers=bound.multipliers - 1e-3).holds()
    assert not replace(bound, cuts=replace(bound.cuts, point=1.1 * bound.cuts.point)).holds()
    assert not replace(bound, anchors=1.1 * bound.anchors).holds()
    assert not replace(bound, anchors=np.nextafter(bound.anchors, 2 * bound.anchors)).holds()
    assert not replace(bound, spec=replace(TWO_STATE_SPEC, inputs=Box(-2, 2))).holds()


def test_it_does_not_depend_on_coordinates_or_units():
    plant, spec = draw(4)
    T, units = np.random.default_rng(3).standard_normal((N, N)), np.array([1e-3, 50.0])
    back = np.linalg.inv(T)
    corners = Polytope.from_vertices(T @ spec.initial.vertices)
    there = Plant(T @ plant.A @ back, T @ plant.B * units, C=plant.C @ back)
    inputs = Box(spec.inputs.lower / units, spec.inputs.upper / units)
    moved = Spec(1e4 * back.T @ spec.Q @ back, 1e4 * spec.R * np.outer(units, units), 0.9, corners, inputs)
    assert affine_moves(there, moved, 5).value == pytest.approx(1e4 * affine_moves(plant, spec, 5).value, rel=1e-6)


def test_from_one_known_state_it_is_the_best_sequence():
    plant, spec = draw(1, initial=Empirical([[1.0], [-0.5], [2.0]]))
    linear, best = affine_moves(plant, spec, 40), any_controller(plant, spec)
    assert linear.holds() and best.holds()
    assert linear.value == pytest.approx(best.value, rel=1e-6)


def test_states_in_a_plane_are_no_obstacle():
    plane = Empirical(np.array([[1.0, 0.0, -1.0, 0.3], [0.0, 1.0, -1.0, 0.3], [1.0, 1.0, -2.0, 0.6]]))
    plant, spec = draw(2, initial=plane)
    plant = Plant(plant.A, plant.B)
    true = sampled_program(plant, spec, 3, plane.points, plane.weights, plane.points)
    bound = affine_moves(plant, spec, 3)
    assert bound.holds() and true * (1 - 1e-5) < bound.value < true * (1 + 1e-8)


def test_a_disc_by_hand():
    disc, spec_of = Uniform(Ellipsoid(np.eye(2))), Box([-1, -1], [1, 1])
    bound = first_move(Plant(1.5 * np.eye(2), np.eye(2)), Spec(np.eye(2), np.zeros((2, 2)), 0.8, disc, spec_of))
    true = np.trace(disc.second_moment) * (1 + 0.8 * 0.25)  # rows of D have norm at most 1, so D = -I
    assert bound.holds() and true - 1e-5 < bound.value < true


def test_constraints_added_as_they_are_violated_give_the_same(monkeypatch):
    plant, spec = draw(5)
    listed = affine_moves(plant, spec, 4)
    few = partial(affine_cuts.first_cuts, most=10)
    monkeypatch.setattr(importlib.import_module("inc_casadi.bounds.affine_moves"), "first_cuts", few)
    for initial in (spec.initial, Polytope(spec.initial.support.H, spec.initial.support.h)):
        added = affine_moves(plant, replace(spec, initial=initial), 4)
        assert added.multipliers.size < listed.multipliers.size and added.holds()
        assert added.value == pytest.approx(listed.value, rel=1e-5)
        assert added.value < listed.value * (1 + 1e-7)


def test_without_input_limits_it_is_the_unconstrained_optimum():
    plant, spec = draw(3)
    free = affine_moves(plant, replace(spec, inputs=None), 2)
    nodes, weights = spec.initial.quadrature(2)
    wide = replace(spec, inputs=Box([-1e3, -1e3], [1e3, 1e3]))
    true = sampled_program(Plant(plant.A, plant.B), wide, 2, nodes, weights, spec.initial.vertices)
    assert free.holds() and free.value == pytest.approx(true, rel=1e-6)
    assert "without input limits" in free.statement


def test_free_inputs_and_unseen_costs():
    spec = Spec(np.diag([1.0, 0.0, 0.0]), np.zeros((2, 2)), 1.0, draw(0)[1].initial, draw(0)[1].inputs)
    bound = affine_moves(draw(0)[0], spec, 6)
    assert bound.holds() and bound.value > 0
    nothing = affine_moves(draw(0)[0], replace(spec, Q=np.zeros((3, 3))), 2)
    assert nothing.holds() and nothing.value == pytest.approx(0, abs=1e-7) and nothing.value <= 0


def test_refusals_name_the_reason():
    plant, spec = draw(0)
    with pytest.raises(InvalidInputError, match="Gaussian.*no bounded set"):
        affine_moves(plant, replace(spec, initial=Gaussian(np.zeros(N), np.eye(N))))
    with pytest.raises(InvalidInputError, match="continuous"):
        affine_moves(Plant(plant.A, plant.B, dt=0.0), spec)
    with pytest.raises(InvalidInputError, match="moves must be at least 1"):
        affine_moves(plant, spec, 0)
    with pytest.raises(InvalidInputError, match="most must be at least 1"):
        affine_moves(plant, spec, most=0)
    with pytest.raises(InvalidInputError, match="tolerance"):
        affine_moves(plant, spec, tolerance=-1.0)
    with pytest.raises(DimensionError):
        affine_moves(TWO_STATE, spec)


def test_the_statement_is_true_and_names_the_class():
    bound = affine_moves(Plant(TWO_STATE.A, TWO_STATE.B, C=[[1.0, 0.3]]), TWO_STATE_SPEC, 4)
    figure = float(bound.statement.split("at least ")[1].split(" ")[0])
    assert bound.value - 1e-6 < figure <= bound.value == float(bound)
    assert "controller of any finite order" in bound.statement and "y = C x" in bound.statement
    assert "first move counted" in first_move(TWO_STATE, TWO_STATE_SPEC).statement


def test_a_control_state_space_will_do():
    control = pytest.importorskip("control")
    sys_ = control.ss(TWO_STATE.A, TWO_STATE.B, np.eye(2), np.zeros((2, 1)), True)
    assert first_move(sys_, TWO_STATE_SPEC).value == pytest.approx(0.846524, abs=2e-6)


def test_importing_and_rechecking_loads_no_solver():
    code = ("import sys, inc_casadi.bounds; "
            "assert not {'scipy', 'cvxpy', 'clarabel', 'casadi'} & set(sys.modules), sorted(sys.modules)")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)
