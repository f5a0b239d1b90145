"""nu against the inequality typed again, its derivative against differences, and what the penalty does to a training."""

import numpy as np
import pytest
from bmi_draws import along, direction_of, draw, moved

from inc_casadi import INC, Box, Plant, ReLU, Spec, Stability, Tanh, certify
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.multipliers import Sector
from synthesis.condition_graph import condition_graph
from synthesis.nlp import minimize
from synthesis.objective import Objective
from synthesis.rollout import Parameters
from synthesis.training_setup import setup
from synthesis.violation import Penalized, violation, violation_at


def typed(plant, inc, P, Lambda, decay, stage_x, stage_u, factor):
    """The left side of eq:stab_violation or eq:perf_violation for units in [0, 1]."""
    n, q = plant.n, inc.q
    F = np.hstack([plant.A + plant.B @ inc.K @ plant.C, plant.B @ inc.V])
    G, Z = np.hstack([inc.K @ plant.C, inc.V]), np.hstack([inc.U @ plant.C, inc.W])
    X, H = np.eye(n, n + q), np.eye(q, n + q, n)
    M = H.T @ np.diag(Lambda) @ Z
    return (factor * F.T @ P @ F - decay * X.T @ P @ X + X.T @ stage_x @ X + G.T @ stage_u @ G + M + M.T
            - 2 * H.T @ np.diag(Lambda) @ H)


def numbers(plant, inc, seed=3):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(plant.n, plant.n))
    return {"P": root @ root.T + np.eye(plant.n), "Lambda": rng.uniform(0.5, 2.0, inc.q)}


def test_nu_is_the_largest_eigenvalue_of_the_papers_inequalities():
    plant, inc, claim = draw(3, 2, 2, 4, ReLU(), 0.3, seed=2)
    v = numbers(plant, inc)
    stability = typed(plant, inc, v["P"], v["Lambda"], 0.97**2, np.zeros((3, 3)), np.zeros((2, 2)), 1.0)
    cost = typed(plant, inc, v["P"], v["Lambda"], 1.0, claim.Q, claim.R, claim.discount)
    assert violation(plant, inc, Stability(0.97), "sector", v).value == pytest.approx(np.linalg.eigvalsh(stability)[-1])
    assert violation(plant, inc, claim, "sector", v).value == pytest.approx(np.linalg.eigvalsh(cost)[-1])


@pytest.mark.parametrize("unit, multiplier", [(Tanh(), "sector"), (ReLU(), "relu"), (ReLU(), "lifted")])
def test_derivative_is_that_of_differences(unit, multiplier):
    plant, inc, claim = draw(2, 1, 1, 3, unit, 0.1, seed=1)
    values = certify(plant, inc, claim, multiplier=multiplier).values
    direction = direction_of(inc)
    ahead, behind = (violation(plant, moved(inc, direction, 0.05 + step), claim, multiplier, values)
                     for step in (1e-6, -1e-6))
    here = violation(plant, moved(inc, direction, 0.05), claim, multiplier, values)
    assert here.value > 0 and here.multiplicity == 1
    assert along(here.gradient, direction) == pytest.approx((ahead.value - behind.value) / 2e-6, rel=1e-5)


def test_nu_is_negative_exactly_where_the_certificate_holds():
    plant, inc, claim = draw(3, 1, 2, 4, Tanh(), seed=1)
    values = certify(plant, inc, claim, multiplier="sector").values
    assert violation(plant, inc, claim, "sector", values).value < 0
    assert violation(plant, inc, claim, "sector", {**values, "P": 0.9 * values["P"]}).value > 0


def test_multiple_eigenvalue_takes_the_mean_over_its_eigenvectors():
    plant = Plant(0.5 * np.eye(2), np.eye(2))
    law = INC.linear(0.1 * np.eye(2))
    found = violation(plant, law, Stability(0.9), "sector", {"P": np.eye(2), "Lambda": np.zeros(0)})
    # nu = lambda_max((A + K)'(A + K)) - 0.81: along K = t I its derivative is 2 (0.6), half of it on each diagonal entry.
    assert found.multiplicity == 2 and found.value == pytest.approx(0.36 - 0.81)
    assert found.gradient.K == pytest.approx(0.6 * np.eye(2))


def test_values_that_are_missing_and_claims_that_are_not_read_are_refused():
    plant, inc, claim = draw(2, 1, 1, 3, Tanh())
    with pytest.raises(DimensionError, match="Lambda"):
        violation(plant, inc, claim, "sector", {"P": np.eye(2)})
    with pytest.raises(InvalidInputError, match="does not apply"):
        violation(plant, inc, claim, "relu", {"P": np.eye(2)})


@pytest.fixture
def training():
    """A training in which inputs are dear, so that it prefers slow loops; a rate that a fast law has, and its numbers."""
    plant, inc, claim = draw(2, 1, 2, 3, Tanh(), 0.1, seed=1)
    K = -np.linalg.lstsq(plant.B, plant.A, rcond=None)[0] @ np.linalg.inv(plant.C)
    fast = certify(plant, INC(inc.W, inc.U, 0.1 * inc.V, K, activation=Tanh()), Stability(), multiplier="sector").require()
    slower = Stability(1.1 * fast.bound)
    spec = Spec(0.01 * claim.Q, 10 * claim.R, claim.discount, Box([-1.0, -1.5], [1.0, 1.5]))
    problem = setup(plant, spec, inc, kappa=0.95, horizon=10, order=4, anchored=True, frozen=(), terminal=None, seed=0)
    objective = Objective(problem.scenario(130), problem.layout, problem.scale)
    return objective, condition_graph(plant, inc, slower, Sector()), fast.values, inc


def test_penalty_adds_its_square_and_its_gradient(training):
    objective, graph, values, start = training
    x = objective.layout.start(Parameters.of(start))
    penalized = Penalized(objective, graph, values, rho=3.0, margin=0.1)
    nu = violation_at(graph, start, values)[0]
    J = objective.scale * np.expm1(objective.value(x))
    assert penalized.value(x) == pytest.approx(np.log1p((J + 3.0 * (nu + 0.1) ** 2) / objective.scale), rel=1e-9)
    d = np.random.default_rng(0).normal(size=x.size)
    slope = (penalized.value(x + 1e-6 * d) - penalized.value(x - 1e-6 * d)) / 2e-6
    assert penalized.gradient(x) @ d == pytest.approx(slope, rel=1e-5)
    assert np.linalg.eigvalsh(penalized.hessian(x))[0] > 0
    assert Penalized(objective, graph, values, rho=3.0, margin=-2 * nu).value(x) == pytest.approx(objective.value(x))


def test_the_graph_of_the_objective_alone_is_not_taken_for_the_penalized_one(training):
    objective, graph, values, start = training
    with pytest.raises(InvalidInputError, match="a Penalized has no graph"):
        minimize(Penalized(objective, graph, values, rho=1.0), Parameters.of(start), method="graph")


def test_training_with_the_penalty_ends_less_violated_than_without(training):
    objective, graph, values, start = training
    ends = [minimize(each, Parameters.of(start), hessian="gauss-newton", max_iterations=40).law
            for each in (objective, Penalized(objective, graph, values, rho=1e2))]
    plain, aware = (violation_at(graph, INC(*law[:4], activation=Tanh()), values)[0] for law in ends)
    assert plain > 0.3 and aware < 0.5 * plain
