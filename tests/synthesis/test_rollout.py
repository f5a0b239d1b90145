"""The batched rollout and its derivatives against plain loops, differences and the CasADi graph."""

from dataclasses import replace

import casadi as ca
import draws
import numpy as np
import oracles
import pytest

from inc_casadi import INC, LeakyReLU, ReLU, Saturation, Tanh
from synthesis.ipopt import Stop, Watch
from synthesis.nlp import graph_value
from synthesis.objective import Layout, Objective, flat, unflat
from synthesis.outcome import Track
from synthesis.rollout import Parameters, Scenario, gradient, hidden, roll
from synthesis.sensitivities import gauss_newton

N_STATES, M, P, NODES, STEPS = 3, 2, 4, 7, 5
MIXED = (ReLU(), Tanh(), Saturation(), LeakyReLU(0.3), ReLU())
STEP = 1e-6
HALFSPACES = np.array([[1.0, 0.5], [-0.4, 1.0], [-1.0, -1.0]])


def scenario(seed=0, units=MIXED, anchored=True, steps=STEPS, limit=0.4, penalty=0.0):
    rng = np.random.default_rng(seed)
    plant = draws.plant(rng, radius=1.1)
    Q, R, terminal = (part @ part.T for part in (rng.normal(size=shape) for shape in ((3, 2), (2, 2), (3, 3))))
    weights = rng.uniform(0.5, 1.5, NODES)
    rows = HALFSPACES if penalty else np.zeros((0, M))
    return plant, Scenario(plant.A, plant.B, plant.C, Q, R, 0.9, terminal, rng.normal(size=(N_STATES, NODES)),
                           weights / weights.sum(), steps, np.array([-limit, -2 * limit]), np.array([limit, 3 * limit]),
                           rows, np.full(len(rows), 0.1), penalty, units, anchored)


def law(seed=1, units=MIXED, norm=0.8):
    inc = draws.controller(np.random.default_rng(seed), M, P, units, gain=0.5, norm=norm, bias=0.5)
    return inc, Parameters.of(inc)


def plain_cost(inc, task):
    """The cost of a task by loops over plain formulas."""
    d = -(inc.V @ oracles.hidden(inc, np.zeros((P, 1))))[:, 0] if task.anchored else inc.d
    total, x = 0.0, task.nodes
    for k in range(task.steps):
        y = task.C @ x
        v = inc.K @ y + inc.V @ oracles.hidden(inc, y) + d[:, None]
        u = np.minimum(np.maximum(v, task.lower[:, None]), task.upper[:, None])
        stage = (oracles.quadratic(task.Q, x) + oracles.quadratic(task.R, u)) @ task.weights
        outside = np.maximum(task.H @ u - task.h[:, None], 0.0)
        total += task.discount**k * (stage + task.penalty * np.mean(np.sum(outside**2, axis=0)))
        x = task.A @ x + task.B @ u
    return total + task.discount**task.steps * oracles.quadratic(task.terminal, x) @ task.weights


@pytest.mark.parametrize("anchored", [True, False])
@pytest.mark.parametrize("penalty", [0.0, 3.0])
def test_cost_is_that_of_the_plain_loop(anchored, penalty):
    _, task = scenario(anchored=anchored, penalty=penalty)
    inc, parameters = law()
    assert roll(task, parameters).cost == pytest.approx(plain_cost(inc, task), rel=1e-10)


def test_motion_is_that_of_the_controller_with_saturated_output():
    from inc_casadi import Box, simulate
    plant, task = scenario(anchored=False)
    inc, parameters = law()
    run = simulate(plant, inc.with_saturated_output(Box(task.lower, task.upper)), task.nodes, steps=STEPS)
    motion = roll(task, parameters)
    np.testing.assert_allclose(motion.x.transpose(2, 1, 0), run.x, atol=1e-9)
    np.testing.assert_allclose(motion.u.transpose(2, 1, 0), run.u[:, :, :STEPS], atol=1e-9)


@pytest.mark.parametrize("units", [MIXED, (ReLU(),) * 5, ()], ids=["mixed", "relu", "linear"])
@pytest.mark.parametrize("anchored", [True, False])
@pytest.mark.parametrize("penalty", [0.0, 3.0])
def test_gradient_agrees_with_differences_of_the_plain_cost(units, anchored, penalty):
    _, task = scenario(units=units, anchored=anchored, penalty=penalty)
    inc, parameters = law(units=units)
    slope = flat(gradient(task, parameters, roll(task, parameters)))
    theta, shapes = flat(parameters), [part.shape for part in parameters]

    def cost(point):
        return plain_cost(INC(*unflat(point, shapes), activation=units), task)

    chosen = np.random.default_rng(5).permutation(theta.size)[:25]
    pushes = STEP * np.eye(theta.size)[chosen]
    differences = [(cost(theta + push) - cost(theta - push)) / (2 * STEP) for push in pushes]
    np.testing.assert_allclose(slope[chosen], differences, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("anchored", [True, False])
def test_value_and_gradient_are_those_of_the_casadi_graph(anchored):
    _, task = scenario(anchored=anchored, penalty=2.0)
    _, parameters = law()
    rng = np.random.default_rng(9)
    scales = Parameters(*(rng.uniform(0.5, 2.0, part.shape) for part in parameters))
    layout = Layout.of(parameters, scales, ("d",) if anchored else (), 0.9)
    objective = Objective(task, layout, 1.7)
    x = layout.start(parameters)
    symbol = ca.MX.sym("x", layout.size)
    value = graph_value(objective, symbol)
    expected, slope = ca.Function("graph", [symbol], [value, ca.gradient(value, symbol)])(x)
    assert objective.value(x) == pytest.approx(float(expected), rel=1e-12)
    np.testing.assert_allclose(objective.gradient(x), slope.full().ravel(), rtol=1e-9, atol=1e-12)


def test_gauss_newton_is_the_hessian_where_the_motion_is_linear_in_the_parameters():
    # One step and no terminal cost: u is linear in (K, d) inside the limits, so nothing is left out.
    _, task = scenario(units=(), anchored=False, steps=1, limit=100.0, penalty=2.0)
    task = replace(task, terminal=np.zeros((3, 3)))
    _, parameters = law(units=())
    theta, shapes = flat(parameters), [part.shape for part in parameters]
    H = gauss_newton(task, parameters, roll(task, parameters))
    columns = []
    for push in 1e-4 * np.eye(theta.size):
        ends = [unflat(theta + sign * push, shapes) for sign in (1.0, -1.0)]
        slopes = [flat(gradient(task, end, roll(task, end))) for end in ends]
        columns.append((slopes[0] - slopes[1]) / 2e-4)
    np.testing.assert_allclose(H, np.array(columns), atol=1e-6)


def test_gauss_newton_is_the_square_of_the_sensitivities():
    _, task = scenario(penalty=2.0)
    _, parameters = law()
    theta, shapes = flat(parameters), [part.shape for part in parameters]

    def points(at):
        motion = roll(task, unflat(at, shapes))
        return np.concatenate([motion.x.ravel(), motion.u.ravel()]), motion

    base = points(theta)[1]
    pushes = STEP * np.eye(theta.size)
    J = np.array([(points(theta + push)[0] - points(theta - push)[0]) / (2 * STEP) for push in pushes]).T
    size = base.x.size
    X, U = J[:size].reshape(*base.x.shape, -1), J[size:].reshape(*base.u.shape, -1)
    powers = task.discount ** np.arange(STEPS + 1)
    expected = np.einsum("k,i,kiap,ab,kibq->pq", powers[:-1], task.weights, X[:-1], task.Q, X[:-1], optimize=True)
    expected += np.einsum("k,i,kiap,ab,kibq->pq", powers[:-1], task.weights, U, task.R, U, optimize=True)
    expected += powers[-1] * np.einsum("i,iap,ab,ibq->pq", task.weights, X[-1], task.terminal, X[-1], optimize=True)
    active = base.u @ task.H.T > task.h
    HU = np.einsum("la,kiap->kilp", task.H, U) * active[..., None]
    expected += task.penalty / NODES * np.einsum("k,kilp,kilq->pq", powers[:-1], HU, HU, optimize=True)
    np.testing.assert_allclose(gauss_newton(task, parameters, base), 2 * expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("norm", [0.5, 0.999])
def test_fixed_points_are_found_near_the_norm_bound_from_any_guess(norm):
    units = (ReLU(), Saturation(), ReLU(), LeakyReLU(0.1), Saturation(), ReLU(), ReLU(), Tanh())
    _, task = scenario(units=units)
    for seed in range(5):
        rng = np.random.default_rng(seed)
        W = rng.normal(size=(8, 8)) * (rng.random((8, 8)) < 0.4) + 3 * np.roll(np.eye(8), 1, axis=0)
        W *= norm / np.abs(W).sum(axis=1, keepdims=True)
        r = 3 * rng.normal(size=(50, 8))
        eta, _ = hidden(task, W, r, 10 * rng.normal(size=r.shape))
        image = np.array([oracles.phi(unit, (eta @ W.T + r)[:, i]) for i, unit in enumerate(units)]).T
        assert np.max(np.abs(image - eta)) < 1e-9


class Misleading(ReLU):
    """A ReLU that lies about its slope, so that Newton's steps lead away."""

    def derivative(self, z):
        return np.full(np.shape(z), -5.0)


def test_picard_takes_over_where_newton_leads_away():
    _, task = scenario(units=(Misleading(),) * 3)
    rng = np.random.default_rng(2)
    W = rng.normal(size=(3, 3))
    W *= 0.7 / np.abs(W).sum(axis=1, keepdims=True)
    r = rng.normal(size=(20, 3))
    eta, _ = hidden(task, W, r, np.zeros_like(r))
    assert np.max(np.abs(np.maximum(eta @ W.T + r, 0.0) - eta)) < 1e-9


def test_a_fixed_point_that_does_not_exist_is_not_made_up():
    _, task = scenario(units=(ReLU(),))
    eta, _ = hidden(task, np.array([[2.0]]), np.array([[1.0], [-1.0]]), np.zeros((2, 1)))
    assert np.isnan(eta[0, 0]) and eta[1, 0] == 0.0


def test_the_track_keeps_the_best_iterate_and_not_the_last():
    _, parameters = law()
    layout, track, stop = Layout.of(parameters, parameters, ("d",), 0.9), Track(), Stop()
    watch = Watch(layout.size, len(layout.rows), lambda x, f: track.note(layout.parameters(x), f), stop)
    for cost in (3.0, 1.0, 2.0):
        watch.eval([ca.DM(np.full(layout.size, cost)), ca.DM(cost), ca.DM.zeros(len(layout.rows))])
    np.testing.assert_allclose(track.best.b, parameters.b)
    assert [cost for _, cost, _ in track.history] == [3.0, 1.0, 2.0]


def test_a_diverging_loop_has_an_infinite_cost_and_no_warning():
    plant, task = scenario(units=(), limit=1e300)
    task = replace(task, A=1e60 * task.A, steps=20)
    assert roll(task, law(units=())[1]).cost == np.inf
    layout = Layout.of(law(units=())[1], law(units=())[1], (), 0.9)
    assert np.isnan(Objective(task, layout, 1.0).value(np.ones(layout.size)))


def test_layout_keeps_the_norm_and_the_frozen_matrices():
    _, parameters = law(norm=1.0)
    ones = Parameters(*(np.ones_like(part) for part in parameters))
    layout = Layout.of(parameters, ones, ("K", "d"), 0.9)
    x = layout.start(parameters)
    back = layout.parameters(x)
    assert np.all(layout.rows @ x < 0.9) and np.all(x >= layout.lower)
    assert np.abs(back.W).sum(axis=1).max() == pytest.approx(0.995 * 0.9)
    assert np.array_equal(back.K, parameters.K) and np.array_equal(back.U, parameters.U)
    moved = layout.parameters(x + 1.0)
    assert np.array_equal(moved.K, parameters.K) and np.array_equal(moved.d, parameters.d)
    np.testing.assert_allclose(moved.W, back.W, atol=1e-12)
    np.testing.assert_allclose(moved.b, back.b + 1.0)
