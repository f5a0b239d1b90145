"""Training: what it reaches where the optimum is known, what it promises always, and how it ends when it must."""

import sys

import numpy as np
import oracles
import pytest

from inc_casadi import INC, Box, Empirical, Gaussian, Logistic, Plant, Polytope, ReLU, Saturation, Spec, Tanh
from inc_casadi.errors import DimensionError, InvalidInputError, NotStabilizableError, SolverError
from inc_casadi.linear.regulator import discounted_lqr
from synthesis.ball import balanced
from synthesis.input_box import inscribed_box
from synthesis.rollout import Parameters
from synthesis.starts.random_start import linear_start, random_start
from synthesis.training import train
from synthesis.training_nodes import nodes_of
from synthesis.training_setup import setup

# sec. two-state example: no open-loop sequence beats the saturated LQR from any of 60 x 60 Gauss nodes (the sequence
# meets the optimality conditions of the convex program), so its cost is the optimum.
TWO_STATE_OPTIMUM = 1.3649619
# Optimum of the open-loop programs from 8^3 Gauss nodes, by accelerated projected gradients.
THREE_STATE_OPTIMUM, THREE_STATE_CLIPPED = 2.6139, 3.0334


def two_state():
    plant = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
    return plant, Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box(-1, 1))


def three_state(inputs=None):
    plant = Plant([[1.0, 0.5, 0.1], [-0.5, 1.0, 0.3], [0.0, 0.1, 0.9]], [[0.0, 0.2], [1.0, 0.0], [0.3, 1.0]])
    initial = Box([-1.0, -0.8, -1.2], [1.0, 0.8, 1.2])
    inputs = inputs or Box([-0.4, -0.4], [0.4, 0.4])
    return plant, Spec(np.diag([1.0, 2.0, 0.5]), np.diag([0.1, 0.3]), 0.95, initial, inputs)


def small(p=2):
    """A cheap problem with output feedback for p = 1: few nodes, short horizon."""
    C = None if p == 2 else [[1.0, 0.5]]
    plant = Plant([[1.0, 0.2], [0.0, 1.0]], [[0.02], [0.2]], C)
    return plant, Spec(np.eye(2), 0.1, 0.95, Box([-2.0, -1.0], [2.0, 1.0]), Box(-1, 0.5))


QUICK = {"horizon": 12, "order": 4, "max_iterations": 8}


def posed(plant, spec, start):
    return setup(plant, spec, start, kappa=0.9, horizon=None, order=None, anchored=True, frozen=(), terminal=None,
                 seed=0)


def true_cost(plant, spec, inc, order=11, steps=60):
    nodes, weights = spec.initial.quadrature(order)
    x, u = oracles.roll_out(plant, inc, nodes, steps)
    return float(oracles.discounted_cost(x, u, spec.Q, spec.R, spec.discount) @ weights), u


def test_random_start_reaches_the_optimum_of_the_two_state_example():
    plant, spec = two_state()
    result = train(plant, spec, random_start(plant, spec, 8, seed=0))
    cost, u = true_cost(plant, spec, result.inc, order=20)
    assert TWO_STATE_OPTIMUM - 2e-5 < cost < 1.366
    assert result.cost == pytest.approx(cost, abs=2e-5) and result.start_cost > 1e6
    assert np.max(np.abs(u)) <= 1.0 and np.max(np.abs(result.inc(np.zeros(2)))) < 1e-12
    assert result.inner.W.any() and result.inner.well_posedness().norm <= 0.95
    assert result.seconds < 15 and result.improved


def test_an_optimal_start_is_kept():
    plant, spec = two_state()
    K, _ = discounted_lqr(plant, spec)
    start = linear_start(K, plant, spec, 8)
    result = train(plant, spec, start, order=8)
    assert result.status.startswith("the start is kept") and not result.improved
    assert np.array_equal(result.inner.U, start.U) and np.array_equal(result.inner.V, start.V)
    assert true_cost(plant, spec, result.inc, order=20)[0] == pytest.approx(TWO_STATE_OPTIMUM, abs=2e-5)


def test_clipped_lqr_is_improved_nearly_to_the_optimum():
    plant, spec = three_state()
    K, _ = discounted_lqr(plant, spec)
    result = train(plant, spec, linear_start(K, plant, spec, 8), max_iterations=20)
    cost, u = true_cost(plant, spec, result.inc, order=8)
    assert result.start_cost == pytest.approx(THREE_STATE_CLIPPED, rel=1e-3)
    assert THREE_STATE_OPTIMUM - 1e-3 < cost < 2.63
    assert np.max(np.abs(u)) <= 0.4 + 1e-12


@pytest.mark.parametrize("hessian", ["gauss-newton", "limited-memory"])
def test_without_limits_training_finds_the_regulator(hessian):
    plant, spec = three_state()
    free = Spec(spec.Q, spec.R, spec.discount, spec.initial)
    K, P = discounted_lqr(plant, free)
    optimum = np.trace(P @ spec.initial.second_moment)
    result = train(plant, free, random_start(plant, free, 3, seed=1), order=3, horizon=15, hessian=hessian)
    assert optimum - 1e-9 <= true_cost(plant, free, result.inc, order=4, steps=300)[0] <= 1.01 * optimum
    assert result.inc is result.inner


def test_numpy_and_casadi_take_the_same_steps():
    plant, spec = small()
    start = random_start(plant, spec, 3, seed=2)
    adjoint, graph = (train(plant, spec, start, method=method, hessian="limited-memory", **QUICK)
                      for method in ("adjoint", "graph"))
    costs = [[row["cost"] for row in result.history][:6] for result in (adjoint, graph)]
    np.testing.assert_allclose(costs[0], costs[1], rtol=1e-6)
    assert costs[0][-1] < costs[0][0] and adjoint.improved and graph.improved


def test_output_feedback_improves_a_static_gain():
    plant, spec = small(p=1)
    K, _ = discounted_lqr(plant, spec)
    result = train(plant, spec, linear_start(K @ np.linalg.pinv(plant.C), plant, spec, 4), **QUICK)
    assert result.cost < 0.999 * result.start_cost
    assert true_cost(plant, spec, result.inc)[0] == pytest.approx(result.cost, rel=1e-2)


@pytest.mark.parametrize("unit", [Tanh(), Saturation(), Logistic()], ids=str)
def test_other_activations_keep_the_origin_and_never_make_it_worse(unit):
    plant, spec = small()
    for seed, form in ((0, "shooting"), (1, "projected")):
        result = train(plant, spec, random_start(plant, spec, 3, unit, seed=seed), form=form, **QUICK)
        assert result.cost <= result.start_cost
        assert np.max(np.abs(result.inc(np.zeros(2)))) < 1e-9
        assert result.inner.well_posedness().norm <= 0.95


@pytest.mark.parametrize("initial", [Gaussian([0.5, 0.0], [[0.4, 0.1], [0.1, 0.3]]),
                                     Empirical([[1.0, -2.0], [0.5, 0.7]])], ids=["gaussian", "empirical"])
def test_other_distributions_train_too(initial):
    plant, spec = small()
    spec = Spec(spec.Q, spec.R, spec.discount, initial, spec.inputs)
    result = train(plant, spec, random_start(plant, spec, 2, seed=1), horizon=10, max_iterations=6)
    assert result.cost < result.start_cost


def test_a_law_that_is_not_anchored_may_have_an_offset():
    plant, spec = small()
    spec = Spec(spec.Q, spec.R, spec.discount, spec.initial, Box(0.2, 1.0))
    result = train(plant, spec, random_start(plant, spec, 2, seed=1), **QUICK)
    assert np.all(result.inc(np.zeros(2)) >= 0.2) and not posed(plant, spec, random_start(plant, spec, 2)).anchored
    free = train(*small(), random_start(*small(), 2, seed=1), anchored=False, **QUICK)
    assert free.inner.d.any() and abs(free.inc(np.zeros(2))[0]) > 1e-12


def test_frozen_matrices_stay():
    plant, spec = small()
    start = random_start(plant, spec, 3, seed=3)
    result = train(plant, spec, start, frozen=("W", "U"), **QUICK)
    assert result.improved
    assert np.array_equal(result.inner.W, start.W) and np.array_equal(result.inner.U, start.U)


@pytest.mark.slow
def test_a_polytope_of_inputs_is_kept_on_unseen_states_and_used_beyond_its_box():
    diamond = Polytope([[1, 1], [1, -1], [-1, 1], [-1, -1]], [0.8] * 4)
    plant, spec = three_state(diamond)
    K, _ = discounted_lqr(plant, spec)
    result = train(plant, spec, linear_start(K, plant, spec, 4), max_iterations=15)
    cost, u = true_cost(plant, spec, result.inc, order=7)
    assert result.violation == 0.0 and np.max(diamond.H @ u.reshape(2, -1)) <= 0.8 + 1e-3
    assert cost < THREE_STATE_OPTIMUM - 0.2


@pytest.mark.parametrize("form", ["shooting", "projected"])
def test_training_repeats_itself(form):
    plant, spec = small()
    first, again = (train(plant, spec, random_start(plant, spec, 3, seed=1), form=form, **QUICK) for _ in range(2))
    assert first.cost == again.cost and np.array_equal(first.inner.U, again.inner.U)


def test_progress_is_the_history():
    plant, spec = small()
    rows = []
    result = train(plant, spec, random_start(plant, spec, 2), progress=rows.append, **QUICK)
    assert rows == list(result.history) and result.iterations == sum(row["iteration"] > 0 for row in rows)
    assert [row["seconds"] for row in rows] == sorted(row["seconds"] for row in rows)
    assert set(rows[0]) == {"phase", "iteration", "cost", "seconds"}
    assert {row["phase"] for row in rows} == {"coarse", "fine"}


def test_an_interruption_returns_the_best_law_so_far():
    plant, spec = small()

    def interrupt(row):
        if row["phase"] == "coarse" and row["iteration"] == 3:
            raise KeyboardInterrupt

    result = train(plant, spec, random_start(plant, spec, 3, seed=1), progress=interrupt, **QUICK)
    assert result.status == "interrupted" and result.history[-1]["iteration"] == 3
    assert result.cost < result.start_cost


def test_an_error_of_progress_is_passed_on(capfd):
    plant, spec = small()

    def fail(row):
        raise ZeroDivisionError("mine")

    with pytest.raises(ZeroDivisionError, match="mine"):
        train(plant, spec, random_start(plant, spec, 3), progress=fail, **QUICK)
    assert capfd.readouterr() == ("", "")


def test_a_time_limit_ends_the_search():
    plant, spec = three_state()
    K, _ = discounted_lqr(plant, spec)
    start = linear_start(K, plant, spec, 8)
    nothing = train(plant, spec, start, time_limit=0.0, order=3)
    assert nothing.status == "the start is kept (nothing searched)" and nothing.cost == nothing.start_cost
    brief = train(plant, spec, start, time_limit=0.3, order=3)
    assert brief.status.endswith("time limit") or brief.status.endswith("time limit)")
    assert brief.history[-1]["seconds"] < 1.0 and brief.cost <= brief.start_cost


def test_silence(capfd):
    plant, spec = small()
    train(plant, spec, random_start(plant, spec, 2), **QUICK)
    assert capfd.readouterr() == ("", "")


def test_a_deep_start_is_rescaled_into_the_norm_bound_and_stays_the_same_law():
    rng = np.random.default_rng(0)
    sizes = ((2, 4), (4, 3), (3, 1))
    deep = INC.from_layers([(3 * rng.normal(size=(to, at)), rng.normal(size=to)) for at, to in sizes])
    mixed = deep.with_saturated_output(Box(-1, 0.5))
    y = 3 * rng.normal(size=(2, 50))
    for law in (deep, mixed):
        assert law.well_posedness().norm > 1
        even = balanced(law, 0.9)
        assert even.well_posedness().norm <= 0.9
        np.testing.assert_allclose(even(y), law(y), atol=1e-9)
    for W, unit in (([[0.0, 1.5], [0.0, 0.0]], Tanh()), ([[0.0, 1.5], [1.5, 0.0]], ReLU())):
        with pytest.raises(InvalidInputError, match="cannot be rescaled"):
            balanced(INC(W, np.ones((2, 2)), np.ones((1, 2)), np.ones((1, 2)), activation=unit), 0.9)


def test_inscribed_box_touches_the_polytope_from_inside():
    rng = np.random.default_rng(1)
    polytope = Polytope.from_vertices(rng.normal(size=(2, 9)) + np.array([[3.0], [0.0]]))
    box = inscribed_box(polytope)
    slack = polytope.h - box.support(polytope.H.T)
    assert np.min(slack) == pytest.approx(0.0, abs=1e-6) and np.all(slack > -1e-12)


def test_nodes_fit_the_budget_and_the_mean():
    for budget in (40, 400):
        for dimension in (1, 2, 6):
            spec = Spec(np.eye(dimension), 1.0, 1.0, Box(np.zeros(dimension), np.ones(dimension)))
            nodes, weights = nodes_of(spec.initial, budget, seed=0)
            assert nodes.shape == (dimension, weights.size) and weights.size <= budget
            assert nodes @ weights == pytest.approx(0.5 * np.ones(dimension), abs=0.3 if dimension == 6 else 1e-12)


def test_the_judge_sees_other_nodes_than_training():
    plant, spec = small()
    start = random_start(plant, spec, 2)
    problem = posed(plant, spec, start)
    seen = np.hstack([problem.scenario(budget).nodes for budget in (130, 400)])
    gaps = np.abs(problem._judge.nodes[:, :, None] - seen[:, None, :]).max(axis=0)
    assert gaps.min() > 1e-4
    assert problem.judge(Parameters.of(start))[0] > 0


def test_a_settled_law_meets_the_norm_bound_to_the_last_bit():
    plant, spec = small()
    start = random_start(plant, spec, 3, seed=1)
    problem, law = posed(plant, spec, start), Parameters.of(start)
    over = law._replace(W=law.W * (0.9 + 1e-8) / np.abs(law.W).sum(axis=1, keepdims=True))
    assert np.max(np.abs(over.W).sum(axis=1)) > 0.9 >= np.max(np.abs(problem.settled(over).W).sum(axis=1))
    assert np.array_equal(problem.settled(law).W, law.W)


def test_the_work_of_a_hessian_is_bounded():
    plant, spec = three_state()
    sizes = []
    for hidden in (2, 10, 14, 40):
        problem = posed(plant, spec, random_start(plant, spec, hidden))
        sketch = problem.sketch(problem.scenario(400))
        sizes.append(0 if sketch is None else sketch.weights.size)
    assert sizes[0] >= sizes[1] > sizes[2] >= sizes[3] == 0 and sizes[0] <= 130


def test_casadi_missing(monkeypatch):
    for name in ("synthesis.nlp", "synthesis.ipopt", "inc_casadi.graph"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, "casadi", None)
    plant, spec = small()
    with pytest.raises(SolverError, match="pip install casadi"):
        train(plant, spec, random_start(plant, spec, 2), **QUICK)


def test_refusals():
    plant, spec = small()
    start = random_start(plant, spec, 2)
    for kappa in (0.0, 1.0, -0.5, np.nan):
        with pytest.raises(InvalidInputError, match="kappa"):
            train(plant, spec, start, kappa=kappa)
    with pytest.raises(InvalidInputError, match=r"plant.sampled\(dt\)"):
        train(Plant(plant.A, plant.B, dt=0.0), spec, start)
    with pytest.raises(DimensionError, match="states has dimension 1, but the plant has n = 2"):
        train(plant, spec, start, form="lifted", states=Box(-1, 1))
    with pytest.raises(DimensionError, match="start maps 1 measurements"):
        train(plant, spec, INC.linear([[1.0]]))
    with pytest.raises(InvalidInputError, match="start must be an INC"):
        train(plant, spec, np.eye(2))
    for options in ({"frozen": "W"}, {"frozen": ("w",)}, {"method": "magic"}, {"hessian": "exact"}, {"horizon": 0},
                    {"order": 0}, {"max_iterations": -1}, {"time_limit": -1.0}, {"terminal": -np.eye(2)},
                    {"frozen": ("W", "U", "V", "K", "b")}, {"form": "magic"}, {"form": "projected", "method": "graph"},
                    {"form": "lifted", "hessian": "limited-memory"}, {"form": "shooting", "steps": "adam"},
                    {"form": "shooting", "readout": False}, {"form": "projected", "steps": "sgd"},
                    {"form": "shooting", "states": Box([-1, -1], [1, 1])}, {"steps": "adam", "readout": False},
                    {"form": "lifted", "states": np.eye(2)}):
        with pytest.raises(InvalidInputError):
            train(plant, spec, start, **options)
    with pytest.raises(InvalidInputError, match="above the bound"):
        train(plant, spec, INC(1.5 * np.eye(2), np.ones((2, 2)), np.ones((1, 2)), np.ones((1, 2)), activation=ReLU()))
    with pytest.raises(NotStabilizableError):
        train(Plant(2 * np.eye(2), [[1.0], [0.0]]), spec, start)
