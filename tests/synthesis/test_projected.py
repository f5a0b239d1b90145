"""Projected gradients: what they reach, that every iterate is well posed, and how they end."""

from dataclasses import replace

import numpy as np
import pytest
from training_problems import posed

from inc_casadi import INC
from synthesis.objective import Objective, flat
from synthesis.projected import _Space, _Value, descend
from synthesis.rollout import roll

KAPPA = 0.6


def watched(monkeypatch):
    """Keep every law that is rolled out."""
    seen = []

    def roll_and_keep(scenario, law, guess=None):
        seen.append(law)
        return roll(scenario, law, guess)

    monkeypatch.setattr("synthesis.projected.roll", roll_and_keep)
    return seen


@pytest.mark.parametrize("steps", ["spectral", "adam"])
def test_every_law_on_the_way_is_well_posed_and_the_bound_is_met(monkeypatch, steps):
    seen = watched(monkeypatch)
    objective, start = posed()
    large = start._replace(W=5 * start.W)
    found = descend(objective, large, steps=steps, max_iterations=60)
    norms = [np.max(np.abs(law.W).sum(axis=1)) for law in seen]
    assert max(norms) <= KAPPA and max(norms) > 0.99 * KAPPA
    assert found.history[-1][1] < 0.6 * found.history[0][1]


@pytest.mark.parametrize("p", [1, 2])
def test_the_slope_is_that_of_differences(p):
    objective, start = posed(p=p)
    space = _Space.of(objective.layout)
    value = _Value(objective, space)
    x = space.point(start)
    _, law, motion = value.at(x)
    slope, step = value.slope(law, motion), 1e-6
    for direction in np.random.default_rng(0).normal(size=(4, x.size)):
        ahead, behind = (value.at(x + sign * step * direction)[0] for sign in (1.0, -1.0))
        assert slope @ direction == pytest.approx((ahead - behind) / (2 * step), rel=1e-5)


def test_the_law_of_a_point_is_the_law_it_came_from():
    objective, start = posed()
    space = _Space.of(objective.layout)
    back = space.law(space.point(start))
    np.testing.assert_allclose(flat(back._replace(d=start.d)), flat(start), atol=1e-15)


def test_frozen_matrices_stay():
    objective, start = posed(frozen=("W", "U"))
    found = descend(objective, start, max_iterations=20).law
    assert np.array_equal(found.W, start.W) and np.array_equal(found.U, start.U) and np.any(found.V != start.V)


def test_the_best_law_is_returned_and_is_worth_what_the_history_says():
    objective, start = posed()
    found = descend(objective, start, max_iterations=40)
    assert roll(objective.scenario, found.law).cost == pytest.approx(min(cost for _, cost, _ in found.history), rel=1e-9)


def test_limits_end_it():
    objective, start = posed()
    assert descend(objective, start, max_iterations=3).status == "iteration limit"
    assert len(descend(objective, start, max_iterations=3).history) == 4
    late = descend(objective, start, time_limit=0.0)
    assert late.status == "time limit" and len(late.history) == 1


def test_an_interruption_keeps_the_best():
    objective, start = posed()

    def interrupt(iteration, cost, seconds):
        if iteration == 5:
            raise KeyboardInterrupt

    found = descend(objective, start, progress=interrupt)
    assert found.status == "interrupted" and len(found.history) == 6
    assert roll(objective.scenario, found.law).cost == pytest.approx(min(c for _, c, _ in found.history), rel=1e-9)


@pytest.mark.parametrize("steps", ["spectral", "adam"])
def test_a_start_that_loses_the_state_comes_back(steps):
    objective, start = posed()
    lost = replace(objective.scenario, A=1e200 * np.eye(2))
    found = descend(Objective(lost, objective.layout, objective.scale), start, steps=steps, max_iterations=5)
    assert np.array_equal(found.law.V, start.V) and found.history[0][1] == np.inf
    INC(*found.law)
