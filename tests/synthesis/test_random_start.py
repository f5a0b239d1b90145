"""From random weights to a certificate: the two-state plant with 8 ReLU units and feedback among them."""

import numpy as np
import pytest

from benchmarks.plants.paper import two_state
from inc_casadi import INC, Box, Plant, Spec, certify
from inc_casadi.errors import InvalidInputError
from synthesis import synthesize


def test_a_random_implicit_network_is_trained_and_certified_within_two_percent_of_any_controller():
    case = two_state()
    result = synthesize(case.plant, case.spec, starts=["random"], seed=2, frozen=("W", "K"), verbose=False).require()
    inner = result.chosen.inner
    assert result.proof and result.chosen.name == "random, trained" and inner.q == 8 and not inner.K.any()
    assert np.max(np.abs(np.linalg.eigvals(inner.W))) > 0.1  # loops among the units, and they count:
    y = case.spec.initial.sample(200, np.random.default_rng(0))
    without = INC(0 * inner.W, inner.U, inner.V, inner.K, inner.b, inner.d, inner.activation)
    assert np.max(np.abs(without(y) - inner(y))) > 0.05
    floor = result.bounds["any controller"]
    assert floor.holds() and 1.3649 < float(floor) <= result.cost <= 1.02 * float(floor)
    assert result.cost == pytest.approx(1.3649619, rel=1e-4)
    again = certify(case.plant, result.inc, result.certificate.claim)
    assert again.holds() and again.bound == result.cost


@pytest.mark.slow
def test_without_discount_a_trained_law_with_biases_rests_exactly_and_is_proved():
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]])
    spec = Spec(np.eye(2), 0.1, 1.0, Box([-3.0, -1.5], [3.0, 1.5]), Box(-0.5, 0.5))
    result = synthesize(plant, spec, hidden=4, starts=["random"], training_iterations=20, tol=0.0, verbose=False)
    assert result.chosen.name == "random, trained" and np.any(result.inc.b) and result.proof
    assert result.cost <= 1.001 * float(result.bounds["any controller"])


@pytest.mark.slow
@pytest.mark.parametrize("form", ["projected", "lifted"])
def test_other_forms_of_training_are_certified_too(form):
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]])
    spec = Spec(np.eye(2), 0.1, 0.95, Box([-3.0, -1.5], [3.0, 1.5]), Box(-0.5, 0.5))
    keywords = {"hidden": 3, "starts": ["clipped LQR"], "training_iterations": 8, "tol": 0.0, "verbose": False}
    result, usual = synthesize(plant, spec, form=form, **keywords), synthesize(plant, spec, **keywords)
    trained, other = (next(one for one in run.history if "trained" in one.name) for run in (result, usual))
    assert result.status == "certified" and trained.certified and trained.verdict.cost < 14.64  # the clipped LQR: 14.646
    assert trained.training and trained.verdict.cost != other.verdict.cost


def test_an_unknown_form_of_training_is_refused():
    case = two_state()
    with pytest.raises(InvalidInputError, match="form is 'shoot', but must be one of auto, shooting, lifted, projected"):
        synthesize(case.plant, case.spec, form="shoot")
