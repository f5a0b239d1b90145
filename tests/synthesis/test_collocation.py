"""The collocated form: its order, its motions against an integrator, its derivatives, and what its search keeps."""

import numpy as np
import oracles
import pytest
from scipy.integrate import solve_ivp

from inc_casadi import INC, Box, Plant, Saturation, Spec, Tanh
from synthesis.collocation import Collocated, radau
from synthesis.collocation_search import minimize_collocated
from synthesis.continuous_setup import continuous_lqr, continuous_setup
from synthesis.flow import follow, gain_control, law_control, true_cost
from synthesis.ipopt import ca
from synthesis.rollout import Parameters

PLANT = Plant([[0.0, 1.0], [-1.0, 0.2]], [[0.1], [1.0]], [[1.0, 0.3], [0.2, -1.0], [0.4, 0.4]], dt=0)
SPEC = Spec(np.diag([1.0, 0.4]), 0.2, 0.7, Box([-1.0, -0.5], [1.5, 1.0]), Box(-1.0, 0.6))
SMOOTH = INC([[0.2, -0.3], [0.1, 0.25]], [[0.5, 0.1, -0.4], [-0.3, 0.6, 0.2]], [[0.4, -0.7]], [[-0.3, 0.2, -0.1]],
             b=[0.1, -0.2], activation=Tanh())
FREE = Spec(SPEC.Q, SPEC.R, SPEC.discount, SPEC.initial)


def posed(inc=SMOOTH, spec=FREE, horizon=2.0, steps=6, degree=3, order=2, anchored=True, frozen=(), plant=PLANT):
    return continuous_setup(plant, spec, inc, kappa=0.6, horizon=horizon, steps=steps, degree=degree, order=order,
                            anchored=anchored, frozen=frozen, seed=0)


def solved(form, law):
    """The collocated motion of a fixed law, by a root of the NLP's own equations, and the NLP's cost."""
    problem = form.problem(1e-9)
    x, f, g = problem.expressions()
    path = follow(form.scenario, law_control(form.scenario, law), form.step, form.points.c)
    origin = oracles.hidden(INC(*law, activation=form.scenario.units), np.zeros((form.scenario.C.shape[0], 1)))[:, 0]
    start = form.point(np.zeros(0), law, path, origin)
    equations = g[:start.size]
    root = ca.rootfinder("root", "newton", {"x": x, "g": equations}, {"abstol": 1e-13})
    found = root(start, [])
    return found.full().ravel(), float(ca.Function("f", [x], [f])(found)) * form.scale


ALL = ("W", "U", "V", "K", "b", "d")


def by_integrator(plant, spec, inc, nodes, weights, duration, terminal, rtol=1e-12):
    """The states at `duration` and the mean cost, from SciPy's integrator and the law as plain NumPy."""
    n, N = nodes.shape

    def velocity(t, flat):
        x = flat[:-1].reshape(n, N)
        u = oracles.control(inc, plant.C @ x)
        rate = (oracles.quadratic(spec.Q, x) + oracles.quadratic(spec.R, u)) @ weights
        return np.append((plant.A @ x + plant.B @ u).ravel(), spec.discount**t * rate)

    run = solve_ivp(velocity, (0.0, duration), np.append(nodes.ravel(), 0.0), "DOP853", rtol=rtol, atol=rtol / 10)
    x = run.y[:-1, -1].reshape(n, N)
    return x, run.y[-1, -1] + spec.discount**duration * oracles.quadratic(terminal, x) @ weights


@pytest.mark.slow
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_halving_the_step_shows_the_order(degree):
    errors = []
    for steps in (4, 8, 16):
        problem = posed(frozen=ALL[1:], steps=steps, degree=degree, anchored=False)
        form = frozen_form(problem, steps)
        variables, cost = solved(form, Parameters.of(SMOOTH))
        x, expected = by_integrator(PLANT, FREE, SMOOTH, form.scenario.nodes, form.scenario.weights, 2.0,
                                    form.scenario.terminal)
        errors.append((np.max(np.abs(form.states(variables)[-1, -1] - x.T)), abs(cost - expected)))
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(orders[-1] > 2 * degree - 1.3), (errors, orders)
    assert np.all(orders[-1] < 2 * degree + 0.7)


def frozen_form(problem, steps):
    """The collocated form with no variable of the law at all."""
    form = problem.form(25, steps)
    layout = form.layout
    fixed = np.concatenate([np.ravel(part) for part in Parameters.of(SMOOTH)])
    none = type(layout)(layout.shapes, fixed, np.zeros(0, dtype=int), np.zeros(0), np.zeros((0, 0)), layout.kappa)
    return Collocated(form.scenario, none, form.scale, form.step, form.points)


def test_radau_integrates_polynomials_up_to_its_degree():
    for s in (1, 2, 3, 5):
        points = radau(s)
        for power in range(2 * s - 1):
            assert points.weights @ points.c**power == pytest.approx(1 / (power + 1), rel=1e-12)
        assert abs(points.weights @ points.c ** (2 * s - 1) - 1 / (2 * s)) > 1e-6
        for power in range(s + 1):
            values = np.append(0.0**power, points.c**power)
            np.testing.assert_allclose(values @ points.derivative, power * points.c ** max(power - 1, 0), atol=1e-11)


@pytest.mark.parametrize("anchor", [True, False])
def test_the_variables_of_a_motion_nearly_satisfy_the_constraints(anchor):
    clipped = INC(SMOOTH.W, SMOOTH.U, 4 * SMOOTH.V, SMOOTH.K, SMOOTH.b, SMOOTH.d, (Saturation(), Tanh()))
    form = posed(inc=clipped, spec=SPEC, steps=40, anchored=anchor).form(9, 40)
    x = form.layout.start(Parameters.of(clipped))
    law = form.layout.parameters(x)
    path = follow(form.scenario, law_control(form.scenario, law), form.step, form.points.c)
    origin = oracles.hidden(INC(*law, activation=form.scenario.units), np.zeros((3, 1)))[:, 0]
    symbols, f, g = form.problem(1e-7).expressions()
    point = form.point(x, law, path, origin)
    if anchor:
        np.testing.assert_allclose(point[form.layout.size:form.head], np.append(-law.V @ origin, law.W @ origin + law.b))
    value, residual = ca.Function("fg", [symbols], [f, g])(point)
    bounds, residual = form.bounds(), residual.full().ravel()
    assert np.all(residual >= bounds["lbg"] - 2e-3) and np.all(residual <= bounds["ubg"] + 2e-3)
    assert float(value) * form.scale == pytest.approx(path.cost, rel=1e-3)


def test_derivatives_against_casadi_of_the_whole():
    problem = posed(spec=SPEC, steps=3, degree=2)
    form = problem.form(4, 3)
    nlp = form.problem(0.05)
    x, f, g = nlp.expressions()
    rng = np.random.default_rng(0)
    point, lam = rng.normal(size=nlp.size), rng.normal(size=g.numel())
    np.testing.assert_allclose(nlp.jacobian()(point, [])[1].full(), ca.Function("J", [x], [ca.jacobian(g, x)])(point).full(),
                               atol=1e-9)
    np.testing.assert_allclose(nlp.gradient()(point, [])[1].full().ravel(),
                               ca.Function("G", [x], [ca.gradient(f, x)])(point).full().ravel(), atol=1e-9)
    whole = ca.Function("H", [x], [ca.triu(ca.hessian(0.7 * f + ca.dot(ca.DM(lam), g), x)[0])])(point).full()
    np.testing.assert_allclose(nlp.hessian()(point, [], 0.7, lam).full(), whole, atol=1e-8)


def test_the_true_cost_is_that_of_an_integrator_with_the_clipped_law():
    law = Parameters(SMOOTH.W, SMOOTH.U, 2 * SMOOTH.V, 4 * SMOOTH.K, SMOOTH.b,
                     -2 * SMOOTH.V @ oracles.hidden(SMOOTH, np.zeros((3, 1)))[:, 0])
    calm = Plant(PLANT.A - np.diag([0.0, 1.0]), PLANT.B, PLANT.C, dt=0)
    problem = posed(inc=INC(*law, activation=Tanh()), spec=SPEC, order=2, anchored=False, plant=calm)
    scenario = problem.form(4, 6).scenario
    inc = INC(*law, activation=Tanh()).with_saturated_output(SPEC.inputs)
    expected = by_integrator(calm, SPEC, inc, scenario.nodes, scenario.weights, 15.0, scenario.terminal, 1e-8)[1]
    assert true_cost(scenario, law, 5.0) == pytest.approx(expected, rel=1e-6)
    unclipped = by_integrator(calm, SPEC, INC(*law, activation=Tanh()), scenario.nodes, scenario.weights, 15.0,
                              scenario.terminal, 1e-8)[1]
    assert abs(unclipped / expected - 1) > 1e-3


def test_a_lost_motion_costs_infinitely_much_and_warns_nobody():
    plant = Plant([[2.0]], [[1.0]], dt=0)
    spec = Spec(1.0, 1.0, 1.0, Box(-1, 1), Box(-0.1, 0.1))
    problem = posed(inc=INC.linear([[-3.0]]), spec=spec, plant=plant, horizon=5.0, order=3)
    assert problem.judge(Parameters.of(INC.linear([[-3.0]]))) == np.inf


def test_the_path_along_a_gain_is_clipped():
    problem = posed(spec=SPEC)
    form = problem.form(4, 6)
    path = follow(form.scenario, gain_control(form.scenario, Parameters.of(SMOOTH), np.array([[-5.0, -5.0]])), form.step,
                  form.points.c)
    assert path.v.min() == -1.0 and path.v.max() == 0.6


def test_the_regulator_solves_its_equation():
    K, P = continuous_lqr(PLANT, FREE)
    gamma = -np.log(FREE.discount)
    residual = FREE.Q + PLANT.A.T @ P + P @ PLANT.A - gamma * P - P @ PLANT.B @ PLANT.B.T @ P / 0.2
    np.testing.assert_allclose(residual, 0.0, atol=1e-10)
    np.testing.assert_allclose(K, -PLANT.B.T @ P / 0.2, atol=1e-10)


def test_the_search_returns_the_start_when_nothing_is_better():
    problem = posed(inc=INC.linear(continuous_lqr(PLANT, FREE)[0] @ np.linalg.pinv(PLANT.C)), anchored=True, horizon=8.0,
                    steps=16)
    form = problem.form(4, 16)
    start = Parameters.of(INC.linear(continuous_lqr(PLANT, FREE)[0] @ np.linalg.pinv(PLANT.C)))
    outcome = minimize_collocated(form, start, gain=problem.base.gain, levels=(0.01,), max_iterations=5)
    first, best = outcome.history[0][1], min(cost for _, cost, _ in outcome.history)
    law = follow(form.scenario, law_control(form.scenario, outcome.law), form.step, form.points.c).cost
    assert law == best and best <= first <= best * (1 + 1e-5)


def test_the_rows_of_W_are_bounded_in_the_NLP_itself():
    form = posed().form(4, 6)
    nlp = form.problem(0.1)
    x, _, g = nlp.expressions()
    rows = ca.Function("g", [x], [g])(np.arange(1.0, nlp.size + 1)).full().ravel()[-2:]
    bounds = form.bounds()
    # the first eight variables are W+ and W-, each row by row
    np.testing.assert_array_equal(rows, [1 + 2 + 5 + 6, 3 + 4 + 7 + 8])
    np.testing.assert_array_equal(bounds["ubg"][-2:], 0.6)
    np.testing.assert_array_equal(bounds["lbx"][:8], 0.0)


def test_a_law_that_is_chosen_keeps_the_bound_and_has_the_cost_that_is_noted():
    form = posed(spec=SPEC).form(4, 6)
    outcome = minimize_collocated(form, Parameters.of(SMOOTH), gain=posed(spec=SPEC).base.gain, levels=(0.05,),
                                  max_iterations=6)
    assert np.max(np.abs(outcome.law.W).sum(axis=1)) <= 0.6
    noted = min(cost for _, cost, _ in outcome.history)
    assert follow(form.scenario, law_control(form.scenario, outcome.law), form.step, form.points.c).cost == noted
    assert noted < outcome.history[0][1]
