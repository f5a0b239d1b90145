"""Measured output: better than every linear gain where one stabilizes, and a plain refusal where none does."""

import time

import numpy as np
import pytest

from benchmarks.plants.paper import output_feedback, two_state
from inc_casadi import Box, Plant, Spec
from inc_casadi.bounds import static_output_feedback
from inc_casadi.linear import best_static_gain
from synthesis import synthesize

A, B = [[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]]


def test_the_papers_embedding_is_solved_by_its_clipped_gain():
    """cor:genuine_of: u = -sat(1.5 y) costs 1/3 + beta/36, linear gains at least 1/(3(1 - beta/4)) (thm:lsof_sep)."""
    case = output_feedback(discount=0.9)
    result = synthesize(case.plant, case.spec, hidden=0, verbose=False).require()
    assert result.proof and result.chosen.name == "clipped gain"
    assert result.cost == pytest.approx(1 / 3 + 0.9 / 36, rel=1e-6)
    assert result.inc([0.1, ]).item() == pytest.approx(-0.15, rel=1e-6) and result.inc([5.0]).item() == -1.0
    assert result.linear["best static linear gain"] == pytest.approx(1 / (3 * (1 - 0.9 / 4)), rel=1e-5)


def test_one_measurement_of_the_two_state_plant_costs_hardly_more_than_the_state():
    """C = [1, 2]: the best gain within the limits costs 3.5058, the clipped one is within 0.1 % of any controller."""
    plant, spec = Plant(A, B, [[1.0, 2.0]]), two_state().spec
    result = synthesize(plant, spec, hidden=8, verbose=False).require()
    assert result.proof and result.cost == pytest.approx(1.3660487, abs=1e-6)
    assert best_static_gain(plant, spec).cost > 2.5 * result.cost
    assert len(result.history) == 2 and "within 0.1 %" in result.ended


@pytest.mark.slow
def test_a_clipped_gain_that_is_refused_is_followed_by_one_that_is_clipped_less():
    """C = [1, 1]: the unlimited optimum -2.48, clipped, does not get everyone home; halfway to the limited one does."""
    plant, spec = Plant(A, B, [[1.0, 1.0]]), two_state().spec
    result = synthesize(plant, spec, hidden=0, training_seconds=1.0, verbose=False).require()
    refused = next(one for one in result.history if one.name == "clipped gain")
    assert not refused.certified and result.chosen.of == "clipped gain" and "the proof takes too" in result.chosen.why
    assert result.cost == pytest.approx(2.374855, abs=1e-5) and result.proof
    gain = result.inc.jacobian(np.zeros(1)).item()
    assert gain == pytest.approx((-0.625 - 2.48147) / 2, abs=1e-4)
    assert "halfway gain follows from clipped gain" in str(result)


@pytest.mark.slow
def test_a_trained_law_of_one_measurement_is_certified_below_every_static_gain():
    plant, spec = Plant(A, B, [[1.0, 1.0]]), two_state().spec
    result = synthesize(plant, spec, hidden=8, training_seconds=60.0, verbose=False).require()
    floor = static_output_feedback(plant, spec)
    assert result.proof and result.cost < 2.235 < 10.48 < float(floor) and floor.holds()
    assert result.chosen.inner.q == 8 and np.abs(result.chosen.inner.W).max() > 0


@pytest.mark.parametrize("hidden", [0, pytest.param(8, marks=pytest.mark.slow)])
def test_a_double_integrator_whose_position_alone_is_measured_is_refused_with_proof(hidden):
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]])
    spec = Spec(np.eye(2), [[1.0]], 0.95, Box([-1.0, -1.0], [1.0, 1.0]), Box([-5.0], [5.0]))
    began = time.monotonic()
    result = synthesize(plant, spec, hidden=hidden, verbose=False)
    assert time.monotonic() - began < 30.0
    assert result.status == "failed" and not any(one.training for one in result.history)
    reason = next(note for note in result.notes if note.startswith("no static gain"))
    assert "no static law that is differentiable at its equilibrium makes motions converge exponentially" in reason
    assert "inc_casadi.dynamic" in reason and "synthesize_dynamic" in reason
    assert "no other static law is worth trying" in str(result)


@pytest.mark.slow
def test_several_measurements_that_no_gain_found_stabilizes_end_in_bounded_time():
    """Two double integrators, positions only: nothing is decided in advance, nothing is certified, retries end."""
    one = np.array([[1.0, 1.0], [0.0, 1.0]])
    plant = Plant(np.kron(np.eye(2), one), np.kron(np.eye(2), [[0.5], [1.0]]), np.kron(np.eye(2), [[1.0, 0.0]]))
    spec = Spec(np.eye(4), np.eye(2), 0.9, Box(-np.ones(4), np.ones(4)), Box([-5.0, -5.0], [5.0, 5.0]))
    began = time.monotonic()
    result = synthesize(plant, spec, hidden=0, training_seconds=1.0, verbose=False)
    assert time.monotonic() - began < 60.0 and result.status != "certified"
    names = {one.name: one for one in result.history}
    assert "stabilizing gain" in names and "no static gain u = F y was found" in names["stabilizing gain"].note
    assert names["stabilizing gain"].why == "does not stabilize around its equilibrium"
    assert any("inc_casadi.dynamic" in note and "synthesize_dynamic" in note for note in result.notes)
