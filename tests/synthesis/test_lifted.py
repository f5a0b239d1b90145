"""The lifted form: its derivatives, that it is the same problem, and that what it reports is the law itself."""

from dataclasses import replace

import casadi as ca
import numpy as np
import oracles
import pytest
from training_problems import posed, small, true_cost

from inc_casadi import INC, Box, LeakyReLU, Plant, Polytope, ReLU, Saturation, Spec, Tanh
from inc_casadi.linear.regulator import discounted_lqr
from synthesis.lifted import minimize_lifted, outside
from synthesis.lifted_stages import Lifted, rounded_clip
from synthesis.objective import Layout
from synthesis.rollout import Parameters, Scenario, roll
from synthesis.starts.random_start import linear_start, random_start
from synthesis.training import train
from synthesis.training_setup import setup

MIXED = (ReLU(), Tanh(), Saturation(), LeakyReLU(0.3))
QUICK = {"horizon": 8, "order": 3, "max_iterations": 24, "form": "lifted"}


def lifted(anchored=True, readout=True, units=MIXED, seed=0, frozen=(), sides=True):
    """Three states, two inputs of which one is free to one side, four measurements, five nodes, three steps."""
    rng = np.random.default_rng(seed)
    n, m, p, q, N = 3, 2, 4, len(units), 5
    plant = Plant(0.5 * rng.normal(size=(n, n)), rng.normal(size=(n, m)), rng.normal(size=(p, n)))
    weights = rng.uniform(0.5, 1.5, N)
    H, h = (rng.normal(size=(3, m)), rng.uniform(1, 2, 3)) if sides else (np.zeros((0, m)), np.zeros(0))
    scenario = Scenario(plant.A, plant.B, plant.C, np.diag([1.0, 2.0, 0.5]), np.diag([0.1, 0.3]), 0.9,
                        np.diag([3.0, 1.0, 2.0]), rng.normal(size=(n, N)), weights / weights.sum(), 3,
                        np.array([-0.5, -0.4]), np.array([0.3, np.inf]), H, h, 0.0, units, anchored)
    W = rng.normal(size=(q, q))
    law = Parameters(0.5 * W / np.abs(W).sum(axis=1).max(initial=1e-9), rng.normal(size=(q, p)), rng.normal(size=(m, q)),
                     rng.normal(size=(m, p)), rng.normal(size=q), rng.normal(size=m))
    scales = Parameters(*[np.full(part.shape, 1.0 if name == "W" else 0.5 + 0.1 * i)
                          for i, (name, part) in enumerate(law._asdict().items())])
    layout = Layout.of(law, scales, (*frozen, "d") if anchored else frozen, 0.8)
    return Lifted(scenario, layout, 2.0, readout, (rng.normal(size=(2, n)), np.ones(2)) if sides else None), law


CASES = [{}, {"anchored": False}, {"readout": False}, {"frozen": ("W", "V")}, {"units": ()}, {"sides": False}]


@pytest.mark.parametrize("options", CASES, ids=str)
def test_derivatives_are_those_of_differences(options):
    form, _ = lifted(**options)
    problem = form.problem(0.1)
    x, f, g = problem.expressions()
    plain = ca.Function("plain", [x], [f, g])
    rng, step = np.random.default_rng(1), 1e-6
    at, lam = 0.5 * rng.normal(size=problem.size), rng.normal(size=g.numel())
    slope = problem.gradient()(at, [])[1].full().ravel()
    J = problem.jacobian()(at, [])[1]
    upper = problem.hessian()(at, [], 1.7, lam).full()
    H = upper + np.triu(upper, 1).T
    assert np.array_equal(upper, np.triu(upper))

    def lagrangian(point):
        return 1.7 * problem.gradient()(point, [])[1].full().ravel() + problem.jacobian()(point, [])[1].full().T @ lam

    for direction in rng.normal(size=(3, problem.size)):
        (f1, g1), (f0, g0) = (plain(at + sign * step * direction) for sign in (1.0, -1.0))
        assert slope @ direction == pytest.approx(float(f1 - f0) / (2 * step), rel=1e-5, abs=1e-7)
        np.testing.assert_allclose((J @ direction).full(), (g1 - g0).full() / (2 * step), rtol=1e-5, atol=1e-7)
        ahead, behind = (lagrangian(at + sign * step * direction) for sign in (1.0, -1.0))
        np.testing.assert_allclose(H @ direction, (ahead - behind) / (2 * step), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("anchored", [True, False])
def test_along_its_own_motion_a_law_meets_the_equations_and_costs_what_a_rollout_costs(anchored):
    form, law = lifted(anchored=anchored, sides=False)
    x = form.layout.start(law)
    law = form.layout.parameters(x)
    motion = roll(form.scenario, law)
    problem, bounds = form.problem(0.0), form.bounds()
    point = form.point(x, law, motion)
    symbol, f, g = problem.expressions()
    cost, residuals = (part.full().ravel() for part in ca.Function("plain", [symbol], [f, g])(point))
    assert np.all(residuals <= bounds["ubg"] + 1e-9) and np.all(residuals >= bounds["lbg"] - 1e-9)
    assert np.sum(bounds["ubg"] == bounds["lbg"]) == 5 * 3 * (4 + 2 + 3) + 4**2 + (6 if anchored else 0)
    task = form.scenario
    first = oracles.quadratic(task.Q, task.nodes) @ task.weights
    assert form.scale * cost[0] + first == pytest.approx(motion.cost, rel=1e-10)


def test_the_rounded_clip_stays_inside_and_tends_to_the_clip():
    v = np.linspace(-5, 5, 81)
    for low, high in ((-1.0, 0.5), (-np.inf, 0.5), (-1.0, np.inf), (-np.inf, np.inf)):
        errors = []
        for width in (0.1, 0.01, 0.0):
            limits = np.full(v.size, low), np.full(v.size, high)
            out = rounded_clip(ca.DM(v), *limits, width).full().ravel()
            assert np.all((out >= low - 1e-15) & (out <= high + 1e-15)) and np.all(np.diff(out) >= -1e-15)
            errors.append(np.max(np.abs(out - np.clip(v, low, high))))
        assert errors[0] <= 0.1 and errors[1] <= 0.01 and errors[2] <= 1e-15


@pytest.mark.parametrize("unit", [ReLU(), pytest.param(Tanh(), marks=pytest.mark.slow)], ids=str)
def test_all_forms_end_at_the_same_cost(unit):
    plant, spec = small()
    start = random_start(plant, spec, 3, unit, seed=1)
    options = {"horizon": 8, "order": 3, "max_iterations": 45}
    costs = [true_cost(plant, spec, train(plant, spec, start, form=form, **options).inc)[0]
             for form in ("shooting", "lifted", "projected")]
    assert max(costs) <= 1.01 * min(costs) and true_cost(plant, spec, start.with_saturated_output(spec.inputs))[0] > 20


@pytest.mark.slow
def test_a_start_that_diverges_is_no_obstacle():
    plant = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
    spec = Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box(-1, 1))
    result = train(plant, spec, random_start(plant, spec, 3), form="lifted", max_iterations=40, order=5)
    cost, _, u = true_cost(plant, spec, result.inc, order=20)
    assert result.start_cost > 1e6 and 1.36494 < cost < 1.37
    assert result.cost == pytest.approx(cost, abs=1e-4) and np.max(np.abs(u)) <= 1.0
    assert result.inner.well_posedness().norm <= 0.95


def test_the_history_is_of_the_law_itself_and_its_best_is_returned():
    objective, start = posed()
    found = minimize_lifted(objective, start, max_iterations=20)
    rolled = roll(objective.scenario, found.law).cost
    assert rolled == pytest.approx(min(cost for _, cost, _ in found.history), rel=1e-9)
    assert np.max(np.abs(found.law.W).sum(axis=1)) <= 0.6 + 1e-8
    # One level with much rounding: the NLP's own optimum is another law's, but the costs stay those of rollouts.
    coarse = minimize_lifted(objective, start, levels=(1.0,), max_iterations=15)
    assert roll(objective.scenario, coarse.law).cost == pytest.approx(min(c for _, c, _ in coarse.history), rel=1e-9)


def test_the_norm_bound_is_met_where_it_is_active(monkeypatch):
    seen = []
    monkeypatch.setattr("synthesis.lifted.roll", lambda task, law: seen.append(law) or roll(task, law))
    objective, start = posed(kappa=0.02, frozen=("U", "V", "K"))
    minimize_lifted(objective, start, max_iterations=45)
    norms = [np.max(np.abs(law.W).sum(axis=1)) for law in seen]
    assert 0.02 * (1 - 1e-4) < max(norms) <= 0.02 + 1e-8  # IPOPT's allowance; `train` projects what it returns


def test_without_readout_the_inner_law_keeps_the_limits_at_the_nodes():
    objective, start = posed(p=1, order=3)
    task = objective.scenario
    free = replace(task, lower=-np.inf * np.ones(1), upper=np.inf * np.ones(1))
    found = minimize_lifted(objective, start, readout=False, max_iterations=60)
    v = roll(free, found.law).u
    assert np.min(v) >= -1.0 - 0.02 and np.max(v) <= 0.5 + 0.02
    assert found.history[-1][1] < 0.8 * found.history[0][1]
    assert np.max(np.abs(roll(free, minimize_lifted(objective, start, max_iterations=60).law).u)) > 1.1


@pytest.mark.slow
def test_states_are_kept_by_the_law_itself_on_unseen_nodes():
    plant, spec = small()
    K, _ = discounted_lqr(plant, spec)
    start = linear_start(K, plant, spec, 4)
    box = Box([-9.0, -1.05], [9.0, 1.05])
    free = train(plant, spec, start, **QUICK)
    kept = train(plant, spec, start, states=box, **QUICK)
    x = {name: true_cost(plant, spec, run.inc)[1][1, :, 1:] for name, run in (("free", free), ("kept", kept))}
    assert np.max(np.abs(x["free"])) > 1.09 and free.state_violation == 0.0
    assert np.max(np.abs(x["kept"])) <= 1.05 + 1e-3 and kept.state_violation <= 1e-3
    assert kept.cost > free.cost


@pytest.mark.slow
def test_states_that_cannot_be_kept_are_reported():
    plant, spec = small()
    start = linear_start(discounted_lqr(plant, spec)[0], plant, spec, 2)
    result = train(plant, spec, start, states=Polytope([[1, 0], [-1, 0], [0, 1], [0, -1]], [1, 1, 1, 1]), **QUICK)
    _, x, _ = true_cost(plant, spec, result.inc)
    assert result.state_violation >= np.max(np.abs(x[:, :, 1:])) - 1.0 > 0.5


@pytest.mark.parametrize("gain", [0.3, pytest.param(1.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("readout", [True, False])
def test_a_polytope_of_inputs_is_kept(gain, readout):
    plant = Plant([[1.0, 0.3], [0.0, 0.95]], [[0.2, 0.0], [0.1, 0.3]])
    diamond = Polytope([[1, 1], [1, -1], [-1, 1], [-1, -1]], [0.6] * 4)
    spec = Spec(np.eye(2), 0.1 * np.eye(2), 0.95, Box([-1.0, -0.8], [1.0, 0.8]), diamond)
    start = linear_start(gain * discounted_lqr(plant, spec)[0], plant, spec, 3)
    result = train(plant, spec, start, readout=readout, **QUICK | {"horizon": 10, "order": 4})
    _, _, u = true_cost(plant, spec, result.inc, order=7)
    assert np.max(np.abs(u).sum(axis=0)) <= 0.6 + 2e-3 and result.violation <= 2e-3
    assert result.cost < 0.9 * result.start_cost


def test_the_worst_starts_are_those_from_which_the_half_spaces_are_left_farthest():
    plant, spec = small()
    start = linear_start(discounted_lqr(plant, spec)[0], plant, spec, 2)
    problem = setup(plant, spec, start, kappa=0.9, horizon=10, order=4, anchored=True, frozen=(), terminal=None, seed=0,
                    states=Polytope([[0, 1], [0, -1], [1, 0], [-1, 0]], [1.0, 1.1, 9.0, 9.0]))
    law, nodes = Parameters.of(start), problem._judge.nodes
    worst = problem.worst_starts(law)
    x = roll(problem._judge, law).x[1:]
    reached = [np.sort(np.max(sign * x[:, :, 1], axis=0))[::-1] for sign in (1, -1)]
    assert worst.shape == (2, 4) and reached[0][1] > 1.0 and reached[1][1] > 1.1
    for state in worst.T:
        motion = np.flatnonzero(np.all(nodes.T == state, axis=1))[0]
        assert np.max(x[:, motion, 1]) >= reached[0][1] or np.max(-x[:, motion, 1]) >= reached[1][1]
    inside = linear_start(0.0 * discounted_lqr(plant, spec)[0], plant, spec, 2)
    assert replace(problem, states=(np.eye(2), np.full(2, 99.0))).worst_starts(Parameters.of(inside)).shape == (2, 0)


def test_how_far_a_motion_leaves_its_half_spaces_is_a_share_of_their_size():
    form, law = lifted()
    motion = roll(form.scenario, form.layout.parameters(form.layout.start(law)))
    G, H = form.states[0], form.scenario.H
    inputs, states = np.max(motion.u @ H.T, axis=(0, 1)), np.max(motion.x[1:] @ G.T, axis=(0, 1))
    for side, tight in ((inputs - np.array([0.5, 0.0, 0.0]), True), (inputs + 1.0, False)):
        case = replace(form, scenario=replace(form.scenario, h=side), states=(G, states + 1.0))
        assert outside(case, motion) == pytest.approx(0.5 / max(1.0, abs(side[0])) if tight else 0.0)
    case = replace(form, scenario=replace(form.scenario, h=inputs + 1.0), states=(G, np.array([states[0] - 0.7, states[1]])))
    assert outside(case, motion) == pytest.approx(0.7 / max(1.0, abs(states[0] - 0.7)))


def test_nodes_beside_the_quadrature_have_no_weight():
    plant, spec = small()
    problem = setup(plant, spec, random_start(plant, spec, 2), kappa=0.9, horizon=3, order=2, anchored=True, frozen=(),
                    terminal=None, seed=0)
    wide = problem.scenario(25, beside=np.array([[3.0], [4.0]]))
    assert wide.nodes[:, -1].tolist() == [3.0, 4.0] and wide.weights[-1] == 0.0 and wide.weights.sum() == pytest.approx(1.0)


def test_it_ends_when_it_must_and_keeps_the_best():
    objective, start = posed()

    def interrupt(iteration, cost, seconds):
        if iteration == 6:
            raise KeyboardInterrupt

    found = minimize_lifted(objective, start, progress=interrupt)
    assert found.status == "interrupted" and len(found.history) == 7
    assert roll(objective.scenario, found.law).cost == pytest.approx(min(c for _, c, _ in found.history), rel=1e-9)
    late = minimize_lifted(objective, start, time_limit=0.05)
    assert late.status == "time limit" and len(late.history) < 30
    assert len(minimize_lifted(objective, start, max_iterations=7).history) <= 7 + 3

    def fail(iteration, cost, seconds):
        raise ZeroDivisionError("mine")

    with pytest.raises(ZeroDivisionError, match="mine"):
        minimize_lifted(objective, start, progress=fail)


def test_it_repeats_itself_in_silence(capfd):
    plant, spec = small(1)
    start = random_start(plant, spec, 3, seed=2)
    first, again = (train(plant, spec, start, **QUICK | {"max_iterations": 9}) for _ in range(2))
    assert first.cost == again.cost and np.array_equal(first.inner.U, again.inner.U)
    assert capfd.readouterr() == ("", "") and isinstance(first.inc, INC)


