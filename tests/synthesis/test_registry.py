"""Each start by its name gives a law of the right shape where it applies, and its reason where it does not."""

from types import SimpleNamespace

import numpy as np
import pytest

from inc_casadi import Box, Plant, ReLU, Spec
from inc_casadi.errors import INCError
from synthesis import registry
from synthesis.registry import STARTS
from synthesis.starts.explicit import explicit_start
from synthesis.starts.predictive import predictive_start

PAIR = Plant([[1.1, 1.0], [0.0, 0.7]], [[0.2], [0.5]])
ONE = Plant(PAIR.A, PAIR.B, [[1.0, 2.0]])
CALM = Plant(0.6 * PAIR.A, PAIR.B)
SPEC = Spec(np.eye(2), [[0.05]], 0.98, Box([-0.8, -0.6], [0.8, 0.6]), Box([-1.0], [1.0]))


@pytest.mark.parametrize(("name", "plant", "units"), [
    ("clipped LQR", PAIR, 3), ("static gain", ONE, 3), ("clipped gain", ONE, 3), ("stabilizing gain", ONE, 3),
    ("halfway gain", ONE, 3), ("sector inequality", CALM, 1), ("certified linear", ONE, 1),
    ("MPC", PAIR, None), ("explicit MPC", PAIR, None), ("random", ONE, 3)])
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


def test_explicit_mpc_is_the_law_of_some_horizon_without_loops():
    law = STARTS["explicit MPC"](PAIR, SPEC, 3, ReLU(), 0.9, 0)
    horizon = min(5, predictive_start(PAIR, SPEC, registry.MOST_MPC_UNITS).horizon)
    same = predictive_start(PAIR, SPEC, horizon=horizon).inc
    x = SPEC.initial.sample(200, np.random.default_rng(0))
    assert law.contraction.radius == 0.0 and law(x) == pytest.approx(same(x), abs=1e-8)


def test_explicit_mpc_takes_a_shorter_horizon_where_regions_are_many(monkeypatch):
    monkeypatch.setattr(registry, "EXPLICIT_PIECES", 40)
    calls = []

    def watched(plant, spec, horizon, *rest, **more):
        calls.append(horizon)
        return explicit_start(plant, spec, horizon, *rest, **more)

    monkeypatch.setattr("synthesis.starts.explicit.explicit_start", watched)
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]])
    spec = Spec(np.eye(2), 0.1, 0.95, Box([-3, -1.5], [3, 1.5]), Box(-0.5, 0.5))
    monkeypatch.setattr("synthesis.starts.predictive.predictive_start", lambda *_: SimpleNamespace(horizon=9))
    law = STARTS["explicit MPC"](plant, spec, 3, ReLU(), 0.9, 0)
    assert calls[0] == 5 and calls == sorted(calls, reverse=True) and len(calls) > 1
    assert law.q == explicit_start(plant, spec, calls[-1]).inc.q


def test_explicit_mpc_is_refused_where_states_are_many():
    four = Plant(np.diag([0.9, 0.8, 0.7, 0.6]), np.ones((4, 1)))
    spec = Spec(np.eye(4), [[1.0]], 0.9, Box(-np.ones(4), np.ones(4)), Box([-1.0], [1.0]))
    assert not registry.may_suit("explicit MPC", four, spec) and registry.may_suit("MPC", four, spec)
    with pytest.raises(INCError, match="too many regions with 4 states"):
        STARTS["explicit MPC"](four, spec, 3, ReLU(), 0.9, 0)


def test_explicit_mpc_looks_no_farther_than_mpc_itself_needs(monkeypatch):
    same = predictive_start(PAIR, SPEC, horizon=2).inc
    monkeypatch.setattr("synthesis.starts.predictive.predictive_start", lambda *_: SimpleNamespace(horizon=2))
    calls = []

    def watched(plant, spec, horizon, *rest, **more):
        calls.append(horizon)
        return explicit_start(plant, spec, horizon, *rest, **more)

    monkeypatch.setattr("synthesis.starts.explicit.explicit_start", watched)
    law = STARTS["explicit MPC"](PAIR, SPEC, 3, ReLU(), 0.9, 0)
    x = SPEC.initial.sample(100, np.random.default_rng(1))
    assert calls == [2] and law(x) == pytest.approx(same(x), abs=1e-8)
