"""The BMI loop: bounds never rise, all of them hold, the best linear gain is reached, and budgets and masks are kept."""

from dataclasses import replace

import numpy as np
import oracles
import pytest
from bmi_draws import draw

from inc_casadi import INC, Box, DiscountedCost, L2Gain, LeakyReLU, Plant, ReLU, Spec, Tanh, certify
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.linear.static_gain import best_static_gain
from synthesis import bmi_search
from synthesis.alternation import alternate
from synthesis.certified_cost import cost_at
from synthesis.law_family import readout

CASES = {"relu": (2, 1, 1, 4, ReLU()), "tanh": (3, 2, 2, 6, Tanh()), "leaky": (3, 1, 1, 6, LeakyReLU(0.3)),
         "four states": (4, 1, 2, 8, ReLU())}


def bounds(found):
    return [found.start_bound, *(row["bound"] for row in found.history if row["phase"] == "cost")]


def simulated(plant, inc, claim, steps=250):
    """The mean cost over points whose second moment is S0 exactly."""
    root = np.linalg.cholesky(claim.initial.second_moment) * np.sqrt(plant.n)
    x, u = oracles.roll_out(plant, inc, np.hstack([root, -root]), steps)
    return float(np.mean(oracles.discounted_cost(x, u, claim.Q, claim.R, claim.discount)))


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.slow] * (name in ("leaky", "four states"))) for name in CASES])
def test_bound_falls_to_the_best_static_linear_gain_and_is_proved(name):
    plant, inc, claim = draw(*CASES[name], seed=1)
    found = alternate(plant, inc, claim, multiplier="sector")
    floor = best_static_gain(plant, Spec(claim.Q, claim.R, claim.discount, claim.initial)).cost
    assert np.all(np.diff(bounds(found)) <= 0) and found.improvement > 0.01
    assert found.certificate.holds() and found.certificate.prove()
    assert floor * (1 - 1e-6) <= found.certificate.bound <= 1.03 * floor
    assert simulated(plant, found.inc, claim) <= found.certificate.bound
    assert np.max(np.abs(found.inc.W).sum(axis=1)) <= 0.95
    assert found.start_bound == pytest.approx(certify(plant, inc, claim, multiplier="sector").bound, rel=1e-4)


@pytest.mark.parametrize("way", ["joint", "gradient", "fixed"])
def test_every_way_lowers_the_bound(way):
    plant, inc, claim = draw(*CASES["relu"], seed=1)
    found = alternate(plant, inc, claim, multiplier="slope", way=way, max_rounds=6)
    assert np.all(np.diff(bounds(found)) <= 0) and found.certificate.holds()
    assert found.improvement > 0.05


def test_a_step_without_constraints_lowers_the_bound_too():
    """With W frozen and no inequality imposed, the program of the step has no constraint at all."""
    plant, inc, claim = draw(*CASES["relu"], seed=1)
    found = alternate(plant, inc, claim, multiplier="slope", way="gradient", frozen=("W", "U", "K"), max_rounds=4)
    assert found.certificate.holds() and found.improvement > 0.01 and np.array_equal(found.inc.W, inc.W)


@pytest.mark.parametrize("name, size", [("relu", 2.0), pytest.param("tanh", 1.0, marks=pytest.mark.slow)])
def test_refused_start_is_made_acceptable(name, size):
    plant, inc, claim = draw(*CASES[name], size=size, seed=3)
    assert not certify(plant, inc, claim, multiplier="sector").holds()
    found = alternate(plant, inc, claim, multiplier="sector", max_rounds=20)
    assert np.isinf(found.start_bound) and found.certificate.prove()
    assert {row["phase"] for row in found.history} == {"feasibility", "cost"}
    assert simulated(plant, found.inc, claim) <= found.certificate.bound


def test_refused_start_on_an_unstable_plant_is_made_acceptable():
    plant, inc, claim = draw(3, 1, 2, 4, Tanh(), 0.3, seed=3)
    plant = Plant(1.25 * plant.A, plant.B, plant.C)
    assert np.max(np.abs(np.linalg.eigvals(plant.A))) > 1.1
    found = alternate(plant, inc, claim, multiplier="sector", max_rounds=4)
    assert np.isinf(found.start_bound) and found.certificate.prove()


@pytest.mark.slow
def test_quasi_newton_model_learns_the_curvature():
    plant, inc, claim = draw(*CASES["tanh"], seed=1)
    found = alternate(plant, inc, claim, multiplier="slope", way="gradient", max_rounds=15)
    floor = best_static_gain(plant, Spec(claim.Q, claim.R, claim.discount, claim.initial)).cost
    assert found.certificate.bound <= 1.4 * floor  # 1.25; with the first model throughout 1.94


def test_auto_climbs_and_never_ends_above_a_single_rung():
    plant, inc, claim = draw(2, 1, 1, 3, ReLU(), 0.3, seed=5)
    found = alternate(plant, inc, claim, frozen=("K", "U"), max_rounds=25)
    rungs = list(dict.fromkeys(row["rung"] for row in found.history))
    assert rungs == ["sector", "slope", "relu"]
    assert found.certificate.bound <= alternate(plant, inc, claim, frozen=("K", "U"), multiplier="sector").certificate.bound


def test_frozen_names_and_entries_stay():
    plant, inc, claim = draw(3, 1, 2, 4, Tanh(), seed=2)
    mask = np.random.default_rng(0).random(inc.U.shape) < 0.5
    found = alternate(plant, inc, claim, multiplier="sector", frozen={"U": mask, "W": True}, max_rounds=3)
    assert found.improvement > 0
    assert np.array_equal(found.inc.W, inc.W) and np.array_equal(found.inc.U[mask], inc.U[mask])
    assert not np.any(found.inc.U[~mask] == inc.U[~mask])


def test_limited_law_keeps_its_limits_and_comes_to_the_open_loops_cost_and_no_further():
    plant, inc, claim = draw(3, 2, 2, 4, ReLU(), 0.3, seed=1)
    limits = Box([-0.4, -0.6], [0.4, 0.6])
    start = inc.with_saturated_output(limits)
    found = alternate(plant, start, claim, multiplier="sector", frozen=readout(start), max_rounds=12)
    P = np.zeros((3, 3))
    for _ in range(2000):
        P = claim.Q + claim.discount * plant.A.T @ P @ plant.A
    open_loop = float(np.trace(P @ claim.initial.second_moment))
    assert found.certificate.prove()
    assert open_loop * (1 - 1e-6) <= found.certificate.bound <= 1.001 * open_loop
    u = oracles.control(found.inc, 50.0 * np.random.default_rng(0).normal(size=(plant.p, 200)))
    assert np.all(np.abs(u) <= limits.upper[:, None] * (1 + 1e-12))
    assert np.array_equal(found.inc.V, start.V) and not found.inc.W[:, -2:].any()


def test_biases_follow_so_that_the_origin_stays_at_rest():
    plant, inc, claim = draw(2, 1, 1, 3, Tanh(), 0.05, seed=1)
    b = np.array([0.3, -0.2, 0.4])
    d = -inc.V @ INC(inc.W, inc.U, inc.V, inc.K, b, activation=Tanh()).hidden(np.zeros(1))
    found = alternate(plant, INC(inc.W, inc.U, inc.V, inc.K, b, d, Tanh()), claim, multiplier="sector", max_rounds=3)
    assert found.improvement > 0 and found.certificate.holds()
    assert found.inc(np.zeros(1)) == pytest.approx(np.zeros(1), abs=1e-12) and found.inc.b.any()


def test_weighted_norm_serves_a_start_with_large_rows():
    plant, inc, claim = draw(2, 1, 1, 2, ReLU(), 0.05, seed=1)
    start = INC([[0.0, 0.0], [3.0, 0.0]], inc.U, inc.V, inc.K, activation=ReLU())
    found = alternate(plant, start, claim, multiplier="sector", kappa=0.6, max_rounds=4)
    assert found.improvement > 0 and found.inc.contraction.radius <= 0.6


def test_interruption_and_budgets_return_the_best_so_far():
    plant, inc, claim = draw(*CASES["tanh"], seed=1)

    def stop(row):
        if row["accepted"]:
            raise KeyboardInterrupt

    stopped = alternate(plant, inc, claim, multiplier="sector", progress=stop)
    assert stopped.status == "interrupted" and stopped.improvement > 0 and stopped.certificate.holds()
    none = alternate(plant, inc, claim, multiplier="sector", max_rounds=0)
    assert none.status == "round limit" and none.certificate.holds() and none.improvement == pytest.approx(0.0)
    late = alternate(plant, inc, claim, multiplier="sector", seconds=0.0)
    assert late.status == "time limit" and late.certificate.holds()


def test_an_error_of_progress_is_passed_on():
    plant, inc, claim = draw(*CASES["relu"], seed=1)

    def fail(row):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        alternate(plant, inc, claim, multiplier="sector", progress=fail)


@pytest.mark.parametrize("factor", [0.0, 0.5])
def test_numbers_that_prove_nothing_are_never_accepted(monkeypatch, factor):
    """A cost that claims less by a P that is singular, or too small, does not count."""
    plant, inc, claim = draw(*CASES["relu"], seed=1)

    def lying(graph, law):
        point = cost_at(graph, law)
        if point is None:
            return None
        old = point.certificate
        values = {**old.values, "P": factor * old.values["P"]}
        fake = MatrixCertificate(old.plant, old.inc, old.claim, old.multiplier, values)
        return replace(point, certificate=fake, value=factor * point.value)

    monkeypatch.setattr(bmi_search, "cost_at", lying)
    found = alternate(plant, inc, claim, multiplier="sector", max_rounds=4)
    assert not any(row["accepted"] for row in found.history)
    assert found.certificate.holds() and found.improvement == pytest.approx(0.0)


def test_what_cannot_be_searched_is_refused_at_the_door():
    plant, inc, claim = draw(2, 1, 1, 3, ReLU())
    with pytest.raises(InvalidInputError, match="no cost to lower"):
        alternate(plant, inc, L2Gain(E=[[1.0], [0.0]]))
    with pytest.raises(InvalidInputError, match="way is"):
        alternate(plant, inc, claim, way="downhill")
    with pytest.raises(InvalidInputError, match="cannot be certified"):
        alternate(plant, INC(inc.W, inc.U, inc.V, inc.K, d=[0.5]), claim)
    with pytest.raises(InvalidInputError, match="frozen"):
        alternate(plant, inc, claim, frozen=("W", "U", "V", "K"))
    with pytest.raises(InvalidInputError, match="frozen must name"):
        alternate(plant, inc, claim, frozen=("b",))
    with pytest.raises(DimensionError, match="mask of U"):
        alternate(plant, inc, claim, frozen={"U": np.zeros((2, 2), dtype=bool)})
    with pytest.raises(InvalidInputError, match="kappa"):
        alternate(plant, INC(1.6 * np.eye(3), inc.U, inc.V, inc.K, activation=ReLU()), claim)
    with pytest.raises(InvalidInputError, match="INC"):
        alternate(plant, "law", claim)
    with pytest.raises(InvalidInputError, match="discrete"):
        alternate(Plant(plant.A - np.eye(2), plant.B, plant.C, dt=0.0), inc, claim)


def test_a_plant_that_no_output_feedback_certifies_ends_without_a_certificate():
    plant = Plant([[1.5, 0.0], [0.0, 0.5]], [[0.0], [1.0]], [[1.0, 1.0]])  # the unstable mode is not reached
    law = INC([[0.1]], [[1.0]], [[0.1]], [[0.0]])
    claim = DiscountedCost(np.eye(2), 0.1, 0.9, Box([-1, -1], [1, 1]))
    found = alternate(plant, law, claim, multiplier="sector", max_rounds=8)
    assert not found.certificate.holds() and found.improvement == 0.0
    assert "Not certified" in found.certificate.sentence


def test_the_history_holds_the_law_of_each_accepted_round_and_no_other():
    plant, inc, claim = draw(*CASES["relu"], seed=1)
    seen = []
    found = alternate(plant, inc, claim, multiplier="sector", way="fixed", max_rounds=5, progress=seen.append)
    assert [row["law"] is not None for row in found.history] == [row["accepted"] for row in found.history]
    laws = [row for row in found.history if row["accepted"]]
    for row in (laws[0], laws[-1]):
        assert certify(plant, row["law"], claim, multiplier="sector").bound == pytest.approx(row["bound"], rel=1e-4)
    assert laws[-1]["law"].V == pytest.approx(found.inc.V) and seen[0]["law"] is found.history[0]["law"]
