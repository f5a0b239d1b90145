"""Each start by its name gives a law of the right shape where it applies, and its reason where it does not."""

import numpy as np
import pytest

from inc_casadi import Box, Plant, ReLU, Spec
from inc_casadi.errors import INCError
from synthesis import registry
from synthesis.registry import STARTS

PAIR = Plant([[1.1, 1.0], [0.0, 0.7]], [[0.2], [0.5]])
ONE = Plant(PAIR.A, PAIR.B, [[1.0, 2.0]])
CALM = Plant(0.6 * PAIR.A, PAIR.B)
SPEC = Spec(np.eye(2), [[0.05]], 0.98, Box([-0.8, -0.6], [0.8, 0.6]), Box([-1.0], [1.0]))


@pytest.mark.parametrize(("name", "plant", "units"), [
    ("clipped LQR", PAIR, 3), ("static gain", ONE, 3), ("clipped gain", ONE, 3), ("stabilizing gain", ONE, 3),
    ("halfway gain", ONE, 3), ("sector inequality", CALM, 1), ("certified linear", ONE, 1),
    ("MPC", PAIR, None), ("random", ONE, 3)])
def test_a_start_fits_its_problem(name, plant, units):
    law = STARTS[name](plant, SPEC, 3, ReLU(), 0.9, 0)
    assert (law.p, law.m) == (plant.p, 1) and law.well_posedness().holds and units in (None, law.q)


def test_a_compressed_law_has_the_units_that_are_asked_for(monkeypatch):
    monkeypatch.setattr(registry, "IMITATION", 3)
    assert STARTS["compressed MPC"](PAIR, SPEC, 3, ReLU(), 0.9, 0).q == 3


@pytest.mark.parametrize(("name", "plant", "words"), [
    ("clipped LQR", ONE, "LQR reads the state"), ("MPC", ONE, "reads the state"),
    ("sector inequality", ONE, "state feedback only"),
    ("stabilizing gain", Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]]), "no static gain")])
def test_a_start_that_does_not_apply_says_why(name, plant, words):
    with pytest.raises(INCError, match=words):
        STARTS[name](plant, SPEC, 3, ReLU(), 0.9, 0)


def test_halfway_is_the_mean_of_the_limited_and_the_clipped_gain():
    gains = [STARTS[name](ONE, SPEC, 0, ReLU(), 0.9, 0).K.item() for name in ("static gain", "clipped gain", "halfway gain")]
    assert gains[1] < gains[0] < 0 and gains[2] == pytest.approx((gains[0] + gains[1]) / 2)
