"""Retraining with the certificate: refused laws are certified, bounds fall, limits and numbers stay honest."""

import numpy as np
import pytest
from bmi_draws import draw

from inc_casadi import INC, Box, Plant, ReLU, Spec, Tanh, certify
from synthesis import synthesize
from synthesis.retraining import penalized, with_certificate
from synthesis.violation import violation


def problem(*shape, size, seed, inputs=None):
    plant, inc, claim = draw(*shape, size, seed=seed)
    return plant, Spec(claim.Q, claim.R, claim.discount, claim.initial, inputs), inc, claim


def test_a_bound_falls_and_the_result_says_before_and_after():
    plant, spec, inc, _ = problem(2, 1, 1, 4, ReLU(), size=0.3, seed=1)
    result = synthesize(plant, spec, hidden=0, start=inc, starts=["random"], rounds=2, tol=0.0, training_iterations=12,
                        verbose=False)
    given = result.history[0]
    last = next(one for one in result.history if "retrained with its certificate" in one.name)
    assert last.of == given.name and last.before >= given.verdict.cost * (1 - 1e-6)
    assert last.verdict.cost < 0.7 * given.verdict.cost and result.cost <= last.verdict.cost
    assert f"certified bound {last.before:.7g} before" in last.note and last.training[-1][1] <= last.before


@pytest.mark.slow
def test_a_refused_law_is_penalized_and_certified():
    plant, spec, inc, claim = problem(2, 1, 1, 4, ReLU(), size=2.0, seed=3)
    tried = certify(plant, inc, claim, multiplier="sector")
    assert not tried.holds()
    law = penalized(plant, spec, inc, tried, 0.95, 30, 20.0, seed=0)
    values = {name: np.asarray(value) for name, value in tried.values.items()}
    nus = [violation(plant, each, claim, "sector", values).value for each in (inc, law)]
    assert nus[1] < 0.5 * nus[0] and np.max(np.abs(law.W).sum(axis=1)) <= 0.95
    found = with_certificate(plant, spec, inc, 0.95, 20, 30.0)
    assert np.isinf(found.before) and np.isfinite(found.after) and found.note.startswith("penalty, alternation")
    assert certify(plant, found.inc, claim, multiplier="sector").prove()


def test_limits_that_are_built_in_stay():
    box = Box([-0.4], [0.4])
    plant, spec, inc, _ = problem(2, 1, 1, 3, Tanh(), size=0.5, seed=2, inputs=box)
    start = inc.with_saturated_output(box)
    found = with_certificate(plant, spec, start, 0.95, 5, 30.0)
    assert found.after <= found.before and np.array_equal(found.inc.V, start.V)
    assert np.max(np.abs(found.inc(20 * np.random.default_rng(0).normal(size=(1, 99))))) <= 0.4 + 1e-15


def test_nothing_certified_is_said():
    plant, spec, inc, _ = problem(2, 1, 1, 3, ReLU(), size=0.3, seed=2)
    unstable = Plant(1.6 * plant.A, plant.B, plant.C)
    found = with_certificate(unstable, spec, inc, 0.95, 0, 60.0)
    assert np.isinf(found.before) and np.isinf(found.after)
    assert found.note == "penalty, alternation: certified bound none before, none after (round limit)"


def test_kappa_and_frozen_matrices_are_kept():
    plant, spec, inc, _ = problem(2, 1, 1, 4, ReLU(), size=0.05, seed=1)
    small = INC(0.5 * inc.W, inc.U, inc.V, inc.K, activation=ReLU())
    found = with_certificate(plant, spec, small, 0.3, 4, 30.0, frozen=("U",))
    assert np.max(np.abs(found.inc.W).sum(axis=1)) <= 0.3 and found.after < found.before
    assert np.array_equal(found.inc.U, inc.U) and not np.array_equal(found.inc.V, inc.V)


def test_a_law_trained_for_a_gaussian_has_no_biases_and_is_proved():
    plant, spec, *_ = problem(2, 1, 1, 3, ReLU(), size=0.3, seed=1)
    result = synthesize(plant, spec, hidden=3, starts=["random"], training_iterations=8, tol=0.1, verbose=False).require()
    assert result.chosen.name == "random, trained" and not result.inc.b.any() and not result.inc.d.any() and result.proof
