"""Certified linear starts: the best of the gains that pass the gate, with their certificates; refusals with reasons."""

import numpy as np
import pytest

from inc_casadi import INC, Box, Plant, Polytope, Spec
from inc_casadi.errors import InfeasibleError, InvalidInputError, NotCertifiedError
from inc_casadi.linear import ClippedCost
from inc_casadi.linear.regulator import discounted_lqr
from inc_casadi.linear.static_gain import best_static_gain
from synthesis.gate import Verdict
from synthesis.starts.linear_feedback import certified_linear_start, stabilizing_gain


def test_the_stabilizing_gain_of_the_whole_state_is_the_regulator():
    plant = Plant([[1.1, 0.4], [0.0, 0.9]], [[0.2], [1.0]], [[2.0, 1.0], [0.0, 1.0]])
    spec = Spec(np.diag([1.0, 3.0]), 0.2, 0.95, Box([-1, -2], [1, 2]), Box(-0.1, 0.1))
    K, _ = discounted_lqr(plant, spec)
    assert stabilizing_gain(plant, spec) @ plant.C == pytest.approx(K, abs=1e-4)


def test_the_two_state_plant_of_the_paper():
    # Published: 1.3649619 for the clipped LQR.
    plant = Plant([[1.10, 1.00], [0.0, 1.02]], [[0.20], [0.50]])
    spec = Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box(-1, 1))
    start = certified_linear_start(plant, spec)
    assert start.cost == pytest.approx(1.3649619, abs=1e-6) and start.label == "free" and start.certificate.prove()


def test_output_feedback_is_certified_and_beats_the_gain_that_keeps_the_limits():
    plant = Plant([[0.7326, -0.0861], [0.1722, 0.9909]], [[0.0609], [0.0064]], [[0.0, 1.4142]])
    spec = Spec(np.eye(2), 0.01, 0.98, Box([-1.5, -1.5], [1.5, 1.5]), Box(-2, 2))
    start = certified_linear_start(plant, spec)
    x = spec.initial.sample(400, np.random.default_rng(3))
    kept, free = best_static_gain(plant, spec).F, stabilizing_gain(plant, spec)
    clipped = [INC.linear(F).with_saturated_output(spec.inputs) for F in (kept, free)]
    cost, *others = (simulated(law, plant, spec, x).mean() for law in (start.inc, *clipped))
    assert start.label == "0.5 free + 0.5 kept" and start.F == pytest.approx((kept + free) / 2)
    assert start.certificate.holds() and cost == pytest.approx(start.cost, rel=0.1)
    assert cost < min(others) and np.max(np.abs(start.inc(9e3 * plant.C @ x))) <= 2


def test_a_label_says_which_gain_it_is():
    plant = Plant([[0.7326, -0.0861], [0.1722, 0.9909]], [[0.0609], [0.0064]], [[0.0, 1.4142]])
    spec = Spec(np.eye(2), 0.01, 0.98, Box([-1.5, -1.5], [1.5, 1.5]), Box(-3, 3))
    start, kept, free = certified_linear_start(plant, spec), best_static_gain(plant, spec).F, stabilizing_gain(plant, spec)
    assert start.label == "0.25 free + 0.75 kept" and start.F == pytest.approx(0.25 * free + 0.75 * kept)


def simulated(law, plant, spec, x):
    total, weight = 0.0, 1.0
    for _ in range(600):
        u = law(plant.C @ x)
        total = total + weight * (np.sum(x * (spec.Q @ x), axis=0) + np.sum(u * (spec.R @ u), axis=0))
        x, weight = plant.A @ x + plant.B @ u, weight * spec.discount
    return total


def test_without_limits_the_gain_is_certified_everywhere():
    spec = Spec(np.diag([1.0, 2.0]), 1.0, 1.0, Box([-1, -2], [1, 2]))
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.0], [1.0]])
    start = certified_linear_start(plant, spec)
    _, P = discounted_lqr(plant, spec)
    assert start.inc.q == 0 and start.cost == pytest.approx(np.trace(P @ np.diag([1.0, 4.0]) / 3), rel=1e-4)


def test_where_the_discounted_gain_does_not_stabilize_the_undiscounted_one_is_certified():
    plant, spec = Plant(1.5, 1.0), Spec(1.0, 30.0, 0.5, Box(-1.9, 1.9), Box(-1, 1))
    assert np.abs(1.5 + stabilizing_gain(plant, spec)) > 1
    start = certified_linear_start(plant, spec)
    assert start.label == "undiscounted" and start.certificate.prove() and np.abs(1.5 + start.F) < 1


def test_a_gain_that_fails_is_passed_over_with_its_reason():
    # No time is left for any regional proof: the gain that is clipped least passes by what clipping adds, the others do not.
    plant = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
    spec = Spec(np.eye(2), 0.05, 0.98, Box([-1.8, -1.8], [1.8, 1.8]), Box(-1, 1))
    found = certified_linear_start(plant, spec, seconds=0.0)
    assert isinstance(found.certificate, ClippedCost) and len(found.refused) == 5
    assert all("time limit of 0 s" in reason for _, reason in found.refused)


def test_what_has_no_certified_gain_is_refused():
    plant = Plant(1.5, 1.0)
    with pytest.raises(NotCertifiedError, match="no saturated linear gain is certified.*free: exact pieces"):
        certified_linear_start(plant, Spec(1.0, 0.1, 0.9, Box(-2.5, 2.5), Box(-1, 1)))
    with pytest.raises(InvalidInputError, match="Polytope"):
        certified_linear_start(plant, Spec(1.0, 0.1, 0.9, Box(-1, 1), Polytope([[1], [-1]], [1, 1])))
    with pytest.raises(InvalidInputError, match="sampled"):
        certified_linear_start(Plant(1.5, 1.0, dt=0.0), Spec(1.0, 0.1, 1.0, Box(-1, 1), Box(-1, 1)))
    with pytest.raises(InfeasibleError, match="does not show"):
        certified_linear_start(Plant(np.diag([1.5, 0.5]), np.ones((2, 1)), [[0.0, 1.0]]),
                               Spec(np.eye(2), 0.1, 1.0, Box([-1, -1], [1, 1]), Box(-1, 1)))


def test_no_clock_decides_which_gain_is_taken(monkeypatch):
    """Pieces and steps are limited, seconds only on demand; more states, whose pieces have more vertices, get fewer."""
    budgets = []

    def refused(plant, spec, inc, budget):
        budgets.append(budget)
        return Verdict(None, np.inf, (), ("enough",), ())

    monkeypatch.setattr("synthesis.starts.linear_feedback.gate", refused)
    for n in (1, 4):
        plant, spec = Plant(0.9 * np.eye(n), np.eye(n)), Spec(np.eye(n), np.eye(n), 0.9, Box(-np.ones(n), np.ones(n)))
        for more in ({}, {"seconds": 3.0}):
            with pytest.raises(NotCertifiedError, match="enough"):
                certified_linear_start(plant, spec, **more)
    assert {budget.seconds for budget in budgets} == {np.inf, 3.0}
    assert {budget.pieces for budget in budgets} == {20_000, 5_000} and {budget.steps for budget in budgets} == {500}
