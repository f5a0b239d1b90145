"""The controller as a CasADi graph: same values, same derivatives, same motions as the NumPy one and as plain loops."""

import casadi as ca
import draws
import numpy as np
import oracles
import posed
import pytest

from inc_casadi import (
    INC,
    Box,
    CenteredLogistic,
    Identity,
    LeakyReLU,
    Logistic,
    Plant,
    ReLU,
    Saturation,
    Tanh,
    simulate,
)
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.graph import _implicit, activation_graph, inc_function, parametric_inc, residual_function, rollout

ALL = (ReLU(), LeakyReLU(0.3), Tanh(), Saturation(), Logistic(), CenteredLogistic(), Identity())
STEP = 1e-6


def controller(seed, units=ALL, norm=0.9):
    return draws.controller(np.random.default_rng(seed), m=2, p=4, units=units, gain=1.0, norm=norm, bias=1.0)


def by_columns(function, points):
    return [part.full() for part in function.map(points.shape[1])(points)]


@pytest.mark.parametrize("units", [ALL, (ReLU(),) * 6, (Saturation(),) * 3], ids=["mixed", "relu", "saturation"])
@pytest.mark.parametrize("norm", [0.3, 0.95])
def test_implicit_graph_gives_the_values_of_plain_iteration(units, norm):
    for seed in range(4):
        inc = controller(seed, units, norm)
        y = draws.points(np.random.default_rng(50 + seed), 4, 40)
        u, eta = by_columns(inc_function(inc), y)
        np.testing.assert_allclose(u, oracles.control(inc, y), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(eta, oracles.hidden(inc, y), rtol=1e-9, atol=1e-9)


def test_feedforward_graph_needs_no_rootfinder_and_keeps_the_order_of_units():
    rng = np.random.default_rng(3)
    layers = [(rng.normal(size=(to, at)), rng.normal(size=to)) for at, to in ((4, 5), (5, 3), (3, 2))]
    deep = INC.from_layers(layers, Tanh())
    inc = deep.with_saturated_output(Box([-1.0, -0.5], [0.5, 2.0]))
    order = rng.permutation(inc.q)
    shuffled = INC(inc.W[np.ix_(order, order)], inc.U[order], inc.V[:, order], inc.K, inc.b[order], inc.d,
                   [inc.activations[i] for i in order])
    function = inc_function(shuffled)
    assert function.is_a("SXFunction")
    y = draws.points(rng, 4, 30)
    u, eta = by_columns(function, y)
    np.testing.assert_allclose(u, oracles.control(inc, y), atol=1e-12)
    np.testing.assert_allclose(eta, oracles.hidden(inc, y)[order], atol=1e-12)


def test_linear_law_has_no_hidden_units():
    u, eta = inc_function(INC.linear([[1.0, -2.0, 0.5]]))([1.0, 2.0, 4.0])
    assert u.full().item() == -1.0 and eta.shape == (0, 1)
    law = parametric_inc(0, 3, 1, ())
    none = [ca.DM(0, 0), ca.DM(0, 3), ca.DM(1, 0)]
    u, eta = law([1.0, 2.0, 4.0], *none, ca.DM([[1.0, -2.0, 0.5]]), ca.DM(0, 1), 3.0)
    assert u.full().item() == 2.0 and eta.shape == (0, 1)


def test_jacobian_agrees_with_differences_and_with_the_controllers_own():
    for seed in range(3):
        inc = controller(seed)
        y = np.random.default_rng(80 + seed).normal(size=4)
        symbol = ca.MX.sym("y", 4)
        jacobian = ca.Function("jacobian", [symbol], [ca.jacobian(inc_function(inc)(symbol)[0], symbol)])(y).full()
        pushes = STEP * np.eye(4)
        ends = [oracles.control(inc, y[:, None] + sign * pushes) for sign in (1.0, -1.0)]
        differences = (ends[0] - ends[1]) / (2 * STEP)
        np.testing.assert_allclose(jacobian, differences, atol=1e-7)
        np.testing.assert_allclose(jacobian, inc.jacobian(y), atol=1e-9)


def test_casadi_takes_half_of_both_slopes_at_a_kink():
    relu = INC(W=[[0.0]], U=[[1.0]], V=[[1.0]], K=[[0.0]])
    y = ca.MX.sym("y")
    slope = ca.Function("slope", [y], [ca.jacobian(inc_function(relu)(y)[0], y)])
    assert slope(0.0).full().item() == 0.5
    assert relu.jacobian([0.0]).item() == 1.0


def test_parameter_gradients_are_those_of_the_adjoint_and_of_differences():
    inc = controller(7)
    y, weight = np.random.default_rng(8).normal(size=4), np.array([0.7, -1.3])
    law = parametric_inc(inc.q, inc.p, inc.m, inc.activations)
    names = ["W", "U", "V", "K", "b", "d"]
    symbols = [ca.MX.sym(name, law.sparsity_in(1 + i)) for i, name in enumerate(names)]
    loss = ca.dot(ca.DM(weight), law(ca.DM(y), *symbols)[0])
    values = [getattr(inc, name) for name in names]
    gradients = ca.Function("gradients", symbols, [ca.gradient(loss, s) for s in symbols])(*values)
    adjoint = inc.adjoint(y, weight)
    for name, value, gradient in zip(names, values, gradients, strict=True):
        found = gradient.full().reshape(value.shape)
        np.testing.assert_allclose(found, getattr(adjoint, name), atol=1e-9, err_msg=name)
        entry = tuple(np.array(value.shape) - 1)
        ends = []
        for sign in (1.0, -1.0):
            moved = value.copy()
            moved[entry] += sign * STEP
            others = {**dict(zip(names, values, strict=True)), name: moved}
            ends.append(weight @ oracles.control(INC(**others, activation=inc.activations), y[:, None])[:, 0])
        assert found[entry] == pytest.approx((ends[0] - ends[1]) / (2 * STEP), abs=1e-6), name


def test_residual_is_zero_at_the_fixed_point_only():
    inc = controller(5)
    y = np.random.default_rng(1).normal(size=4)
    r = inc.U @ y + inc.b
    eta = oracles.hidden(inc, y[:, None])[:, 0]
    residual = residual_function(inc.activations)
    assert np.max(np.abs(residual(eta, r, inc.W).full())) < 1e-12
    off = residual(eta + 0.1, r, inc.W).full().ravel()
    z = inc.W @ (eta + 0.1) + r
    np.testing.assert_allclose(off, eta + 0.1 - [oracles.phi(unit, z[i]) for i, unit in enumerate(ALL)], atol=1e-12)


@pytest.mark.parametrize("unit", [ReLU(), LeakyReLU(0.3), Saturation()], ids=str)
def test_smoothing_stays_near_keeps_zero_and_the_slopes(unit):
    z = np.concatenate([np.linspace(-4, 4, 801), [0.0]])
    symbol = ca.MX.sym("z")
    width = 0.05
    rounded = activation_graph(unit, symbol, width)
    value, slope = ca.Function("rounded", [symbol], [rounded, ca.jacobian(rounded, symbol)]).map(z.size)(z[None])
    steps = np.abs(np.diff(unit.pieces.slopes)).sum()
    gap = value.full().ravel() - oracles.phi(unit, z)
    assert np.max(np.abs(gap)) <= width * steps and gap[-1] == pytest.approx(0.0, abs=1e-15)
    low, high = unit.slopes
    assert np.all(slope.full() >= low - 1e-12) and np.all(slope.full() <= high + 1e-12)


def test_smoothed_controller_tends_to_the_law():
    inc = controller(2)
    y = np.random.default_rng(4).normal(size=(4, 20))
    gaps = [np.max(np.abs(by_columns(inc_function(inc, smoothing=width), y)[0] - oracles.control(inc, y)))
            for width in (1e-1, 1e-3, 1e-5)]
    assert gaps[0] > gaps[1] > gaps[2] and gaps[2] < 1e-4


def test_rollout_is_the_plain_loop_for_one_and_for_several_samples():
    rng = np.random.default_rng(11)
    plant, inc = draws.plant(rng), draws.controller(rng, bias=0.2)
    x0 = rng.normal(size=(3, 5))
    x, u = oracles.roll_out(plant, inc, x0, 6)
    states, inputs = rollout(plant, inc_function(inc), 6, samples=5)(x0)
    np.testing.assert_allclose(states.full().reshape(3, 5, 7), x, atol=1e-9)
    np.testing.assert_allclose(inputs.full().reshape(2, 5, 6), u[:, :, :6], atol=1e-9)
    alone = rollout(plant, inc_function(inc), 6)(x0[:, 2])[0].full()
    np.testing.assert_allclose(alone, simulate(plant, inc, x0[:, 2], steps=6).x, atol=1e-9)


def test_rollout_holds_parameters_and_differentiates_through_time():
    rng = np.random.default_rng(12)
    plant, inc = draws.plant(rng), draws.controller(rng, bias=0.2)
    law = parametric_inc(inc.q, inc.p, inc.m, inc.activations)
    values = [inc.W, inc.U, inc.V, inc.K, inc.b, inc.d]
    symbols = [ca.MX.sym(law.name_in(1 + i), law.sparsity_in(1 + i)) for i in range(6)]
    x0 = rng.normal(size=(3, 4))
    states, _ = rollout(plant, law, 5, samples=4)(x0, *symbols)
    gradient = ca.Function("gradient", symbols, [ca.gradient(ca.sumsqr(states), symbols[0])])(*values).full()

    def cost(W):
        x, _ = oracles.roll_out(plant, INC(W, *values[1:], inc.activations), x0, 5)
        return np.sum(x**2)

    for i, j in ((0, 1), (4, 2), (5, 5)):
        push = np.zeros_like(inc.W)
        push[i, j] = STEP
        difference = (cost(inc.W + push) - cost(inc.W - push)) / (2 * STEP)
        assert gradient[i, j] == pytest.approx(difference, rel=1e-5, abs=1e-8)


def test_the_controller_hands_itself_over():
    inc = controller(1)
    y = np.array([0.3, -1.0, 2.0, 0.1])
    np.testing.assert_allclose(inc.to_casadi()(y)[0].full().ravel(), inc(y), atol=1e-9)


def test_refusals():
    law = inc_function(INC.linear([[1.0]]))
    with pytest.raises(InvalidInputError, match="sampled"):
        rollout(Plant(-1.0, 1.0, dt=0.0), law, 3)
    with pytest.raises(InvalidInputError, match="at least one step"):
        rollout(Plant(0.5, 1.0), law, 0)
    with pytest.raises(InvalidInputError, match="smoothing"):
        inc_function(controller(0), smoothing=-1.0)
    with pytest.raises(DimensionError, match="3 entries"):
        parametric_inc(2, 1, 1, [ReLU()] * 3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_a_graph_posed_by_a_multiplier_converges_where_newton_alone_may_cycle(seed):
    rng = np.random.default_rng(seed)
    inc = posed.controller(rng, ALL, p=4, kind=("symmetric", "skew")[seed % 2])
    assert not inc.well_posedness().contracts
    y = 4 * rng.normal(size=(4, 30))
    law = inc_function(inc)
    u, eta = law(y)
    np.testing.assert_allclose(eta.full(), inc.hidden(y), atol=1e-8)
    np.testing.assert_allclose(u.full(), inc(y), atol=1e-8)
    slope = law.jacobian()(y[:, 0], *[part[:, 0] for part in law(y)])[0].full()
    np.testing.assert_allclose(slope, inc.jacobian(y[:, 0]), atol=1e-7)


def test_the_start_by_splitting_is_what_makes_it_converge():
    """A ring of large skew gain on which Newton from phi(r) ends in a RuntimeError, for this many of 60 points."""
    rng = np.random.default_rng(1)
    H = rng.normal(size=(6, 6))
    inc = INC(0.3 * np.eye(6) + 4.0 * (H - H.T), rng.normal(size=(6, 2)), np.ones((1, 6)), [[0.0, 0.0]], rng.normal(size=6))
    y = 5 * rng.normal(size=(2, 60))
    plain = _implicit(inc.activations, 0.0)
    failures = 0
    for k in range(60):
        try:
            plain(inc.U @ y[:, k] + inc.b, inc.W)
        except RuntimeError:
            failures += 1
    assert failures > 0
    np.testing.assert_allclose(inc_function(inc)(y)[1].full(), inc.hidden(y), atol=1e-8)
