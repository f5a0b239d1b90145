"""The controller as a map: evaluation, derivatives, constructions and refusals."""

from dataclasses import replace

import numpy as np
import posed
import pytest

from inc_casadi import INC, Box, Identity, LeakyReLU, Logistic, ReLU, Saturation, Tanh
from inc_casadi.errors import ConvergenceError, DimensionError, InvalidInputError, NotWellPosedError
from inc_casadi.fixed_point import feedforward_levels, solve

P, Q, M = 3, 7, 2
MIXED = (ReLU(), LeakyReLU(0.2), Saturation(), Tanh(), Logistic(), Identity(), ReLU())


def draw(seed, kappa=0.8):
    rng = np.random.default_rng(seed)
    W = rng.standard_normal((Q, Q))
    W *= kappa / np.abs(W).sum(axis=1, keepdims=True)
    return INC(W, rng.standard_normal((Q, P)), rng.standard_normal((M, Q)), rng.standard_normal((M, P)),
               rng.standard_normal(Q), rng.standard_normal(M), MIXED)


def by_picard(inc, y):
    """The controller by plain iteration of its definition, one point, nothing shared with the package."""
    scalar = [lambda z: max(z, 0), lambda z: max(z, 0.2 * z), lambda z: min(1, max(-1, z)), np.tanh,
              lambda z: 1 / (1 + np.exp(-z)), lambda z: z, lambda z: max(z, 0)]
    eta = np.zeros(Q)
    for _ in range(400):
        z = inc.W @ eta + inc.U @ y + inc.b
        eta = np.array([f(r) for f, r in zip(scalar, z, strict=True)])
    return eta, inc.K @ y + inc.V @ eta + inc.d


@pytest.mark.parametrize("seed", range(4))
def test_values_agree_with_plain_iteration_for_points_and_columns(seed):
    inc = draw(seed)
    points = np.random.default_rng(100 + seed).standard_normal((P, 5)) * 3
    outputs = inc(points)
    assert outputs.shape == (M, 5) and inc.hidden(points).shape == (Q, 5)
    for k in range(5):
        eta, u = by_picard(inc, points[:, k])
        np.testing.assert_allclose(inc.hidden(points[:, k]), eta, atol=1e-10)
        np.testing.assert_allclose(inc(points[:, k]), u, atol=1e-10)
        np.testing.assert_allclose(outputs[:, k], u, atol=1e-10)


@pytest.mark.parametrize("method", ["auto", "picard", "newton"])
def test_each_method_states_a_residual_that_is_true(method):
    inc, y = draw(9), np.random.default_rng(9).standard_normal((P, 20))
    found = inc.solve(y, method=method)
    eta = found.eta
    z = inc.W @ eta + inc.U @ y + inc.b[:, None]
    values = np.stack([phi(z[i]) for i, phi in enumerate(MIXED)])
    assert found.residual == pytest.approx(np.max(np.abs(values - eta)), abs=1e-15)
    assert found.residual < 1e-11


def test_the_cheaper_method_is_taken_and_does_not_show_in_the_answer():
    rng = np.random.default_rng(11)
    W = rng.standard_normal((60, 60))
    W *= 0.5 / np.abs(W).sum(axis=1, keepdims=True)
    inc = INC(W, rng.standard_normal((60, 2)), rng.standard_normal((1, 60)), [[0.0, 0.0]], rng.standard_normal(60))
    y = rng.standard_normal((2, 40))
    assert inc.solve(y).method == "picard" and inc.solve(y[:, 0]).method == "newton"
    assert draw(0, 0.95).solve(rng.standard_normal((P, 40))).method == "newton"
    np.testing.assert_allclose(inc(y)[:, 0], inc(y[:, 0]), atol=1e-9)


def test_newton_reaches_fixed_points_where_the_contraction_is_slow():
    rng = np.random.default_rng(3)
    W = np.roll(np.eye(9), 1, axis=1) * 0.999
    inc = INC(W, rng.random((9, 1)), np.ones((1, 9)), [[0.0]], rng.random(9), activation=ReLU())
    newton, picard = inc.solve([0.7], method="newton"), inc.solve([0.7], method="picard")
    np.testing.assert_allclose(newton.eta, picard.eta, atol=1e-8)
    assert newton.iterations < 20 < 1000 < picard.iterations


@pytest.mark.parametrize("kappa", [0.5, 0.99])
def test_newton_needs_few_steps_on_hard_random_columns(kappa):
    for seed in range(10):
        inc = draw(seed, kappa)
        y = 5 * np.random.default_rng(seed).standard_normal((P, 300))
        assert inc.solve(y, method="newton").iterations <= 30


def test_the_safeguarded_steps_alone_reach_the_fixed_point(monkeypatch):
    monkeypatch.setattr("inc_casadi.fixed_point.FREE_STEPS", 0)
    inc, y = draw(2, 0.97), 5 * np.random.default_rng(2).standard_normal((P, 50))
    np.testing.assert_allclose(inc.solve(y, method="newton").eta, inc.solve(y, method="picard").eta, atol=1e-9)


def test_an_iteration_that_stops_early_is_an_error_with_its_residual():
    with pytest.raises(ConvergenceError, match=r"residual .* after 3 evaluations \(picard\)"):
        solve(np.array([[0.9]]), np.array([[1.0]]), (ReLU(),), rate=0.9, weights=np.ones(1), method="picard",
              max_iterations=3)
    with pytest.raises(ConvergenceError, match="after 150 evaluations"):  # the residual is 1e-7 by then
        solve(np.array([[0.9]]), np.array([[1.0]]), (ReLU(),), rate=0.9, weights=np.ones(1), method="picard",
              max_iterations=150)


def test_feedforward_order_is_found_in_permuted_structure():
    order = np.array([4, 1, 3, 0, 2])
    chain = np.diag([2.0, 3.0, 5.0, 7.0], -1)
    W = chain[np.ix_(order, order)]
    levels = feedforward_levels(W)
    assert [order[level].tolist() for level in levels] == [[0], [1], [2], [3], [4]]
    assert feedforward_levels(np.array([[0.0, 1.0], [1.0, 0.0]])) is None
    inc = INC(W, np.ones((5, 1)), np.ones((1, 5)), [[0.0]])
    assert inc.solve([1.0]).method == "feedforward" and inc.well_posedness().holds


def test_jacobian_and_adjoint_match_differences():
    inc, rng = draw(5), np.random.default_rng(5)
    y, g = rng.standard_normal((P, 4)), rng.standard_normal((M, 4))
    step = 1e-6
    jacobian = inc.jacobian(y)
    for j in range(P):
        e = np.zeros((P, 1))
        e[j] = step
        np.testing.assert_allclose(jacobian[:, :, j].T, (inc(y + e) - inc(y - e)) / (2 * step), atol=1e-6)
    adjoint = inc.adjoint(y, g)
    np.testing.assert_allclose(adjoint.y, np.einsum("nmp,mn->pn", jacobian, g), atol=1e-9)
    for name in ("W", "U", "V", "K", "b", "d"):
        direction = rng.standard_normal(getattr(inc, name).shape)
        values = []
        for sign in (1, -1):
            parts = {key: getattr(inc, key) for key in ("W", "U", "V", "K", "b", "d")}
            parts[name] = parts[name] + sign * step * direction
            values.append(np.sum(g * INC(**parts, activation=MIXED)(y)))
        slope = (values[0] - values[1]) / (2 * step)
        assert np.sum(getattr(adjoint, name) * direction) == pytest.approx(slope, abs=1e-5), name


def test_jacobian_of_one_point_and_without_hidden_units():
    assert draw(1).jacobian(np.ones(P)).shape == (M, P)
    law = INC.linear([[1.0, 2.0, 3.0], [0.0, 1.0, 0.0]])
    np.testing.assert_array_equal(law.jacobian(np.ones(3)), law.K)
    np.testing.assert_array_equal(law.adjoint(np.ones(3), np.array([1.0, 2.0])).y, [1, 4, 3])


def test_lipschitz_bounds_of_the_theorem_hold_on_samples_and_are_reached_by_a_chain():
    inc, rng = draw(6), np.random.default_rng(6)
    test = inc.well_posedness()
    a, b = rng.standard_normal((P, 500)), rng.standard_normal((P, 500))
    assert np.all(np.abs(inc(a) - inc(b)) <= test.lipschitz @ np.abs(a - b) + 1e-9)
    assert np.all(np.abs(inc.hidden(a) - inc.hidden(b)) <= test.hidden_lipschitz @ np.abs(a - b) + 1e-9)
    chain = INC([[0.5]], [[1.0]], [[3.0]], [[1.0]])
    assert chain([2.0]) - chain([1.0]) == pytest.approx(chain.well_posedness().lipschitz[0, 0])


def test_well_posedness_names_the_test_and_uses_the_slopes_of_the_units():
    assert "infinity norm 0.8" in draw(2).well_posedness().test
    steep = INC([[0.0, 5.0], [0.1, 0.0]], [[1.0], [1.0]], [[1.0, 1.0]], [[0.0]])
    test = steep.well_posedness()
    assert test.holds and test.norm == 5.0 and test.radius == pytest.approx(np.sqrt(0.5))
    assert np.all(np.abs(steep.W) @ test.weights < test.weights)
    flat = INC([[3.0]], [[1.0]], [[1.0]], [[0.0]], activation=Logistic())
    assert flat.well_posedness().radius == pytest.approx(0.75) and flat.well_posedness().holds
    assert flat([0.3])[0] == pytest.approx(by_fixed_point(3.0, 0.3))


def by_fixed_point(w, y):
    eta = 0.0
    for _ in range(500):
        eta = 1 / (1 + np.exp(-(w * eta + y)))
    return eta


@pytest.mark.parametrize("W", [[[1.0]], [[1.2]], [[0.0, 2.0], [0.5, 0.0]]])
def test_an_ill_posed_w_is_described_but_not_evaluated(W):
    q = len(W)
    inc = INC(W, np.ones((q, 1)), np.ones((1, q)), [[0.0]])
    assert not inc.well_posedness().holds and np.all(np.isinf(inc.well_posedness().lipschitz))
    with pytest.raises(NotWellPosedError, match=r"lambda_pf\(S\|W\|\) = .* not below 1"):
        inc([1.0])


def test_layers_agree_with_a_plain_forward_pass():
    rng = np.random.default_rng(8)
    sizes = [3, 5, 4, 2]
    layers = [(rng.standard_normal((b, a)), rng.standard_normal(b)) for a, b in zip(sizes, sizes[1:], strict=False)]
    net = INC.from_layers(layers, Tanh())
    y = rng.standard_normal((3, 6))
    h = y
    for weight, bias in layers[:-1]:
        h = np.tanh(weight @ h + bias[:, None])
    np.testing.assert_allclose(net(y), layers[-1][0] @ h + layers[-1][1][:, None], atol=1e-13)
    assert net.q == 9 and net.well_posedness().radius == 0.0
    affine = INC.from_layers(layers[:1])
    np.testing.assert_allclose(affine(y), layers[0][0] @ y + layers[0][1][:, None])


def test_saturated_output_clips_and_stays_within_awkward_limits_exactly():
    from fractions import Fraction
    rng = np.random.default_rng(4)
    for _ in range(50):
        low = -rng.random(M)
        box = Box(low, low + rng.random(M) + 0.01)
        law = draw(4).with_saturated_output(box)
        center, half = law.d, np.diag(law.V[:, -M:])
        for i in range(M):
            assert Fraction(center[i]) + Fraction(half[i]) <= Fraction(box.upper[i])
            assert Fraction(center[i]) - Fraction(half[i]) >= Fraction(box.lower[i])
    y = 3 * rng.standard_normal((P, 40))
    np.testing.assert_allclose(law(y), np.clip(draw(4)(y), box.lower[:, None], box.upper[:, None]), atol=1e-9)
    assert law.well_posedness().radius == pytest.approx(draw(4).well_posedness().radius)


def test_saturated_linear_law_by_hand():
    law = INC.saturated([[-1.5, 0.5]], 2.0)
    np.testing.assert_allclose(law([[0.0, 1.0, 4.0], [1.0, 1.0, 0.0]]), [[0.5, -1.0, -2.0]])
    assert law.preserves_origin and not INC.linear([[1.0]]).with_saturated_output(Box([0.0], [1.0])).preserves_origin


def test_idle_units_change_nothing_and_can_be_left_out():
    inc = draw(7)
    parts = {key: getattr(inc, key) for key in ("W", "U", "V", "K", "b", "d")}
    V = parts["V"].copy()
    W = parts["W"].copy()
    V[:, [0, 3]] = 0
    W[np.ix_([1, 2, 4, 5, 6], [3])] = 0
    W[np.ix_([1, 2, 4, 5, 6], [0])] = 0
    law = INC(**{**parts, "V": V, "W": W}, activation=MIXED)
    smaller = law.without_idle_units()
    y = np.random.default_rng(7).standard_normal((P, 30))
    assert smaller.q == 5
    np.testing.assert_allclose(smaller(y), law(y), atol=1e-10)
    assert inc.without_idle_units().q == Q
    chain = INC(np.diag([2.0, 3.0], -1), np.ones((3, 1)), [[0.0, 0.0, 1.0]], [[0.0]])
    assert chain.without_idle_units().q == 3  # the first two are read by the third only


def test_arrays_are_copied_and_frozen():
    W = np.array([[0.5]])
    inc = INC(W, [[1.0]], [[1.0]], [[0.0]])
    W[0, 0] = 9.0
    assert inc.W[0, 0] == 0.5
    with pytest.raises(ValueError, match="read-only"):
        inc.W[0, 0] = 1.0


@pytest.mark.parametrize(("change", "error", "words"), [
    ({"W": [[np.nan, 0], [0, 0]]}, InvalidInputError, "W holds a NaN"),
    ({"K": [[np.inf]]}, InvalidInputError, "K holds a NaN or an infinity"),
    ({"W": [[0.1, 0.2]]}, DimensionError, r"W has shape \(1, 2\), but must be square"),
    ({"U": [[1.0]]}, DimensionError, r"U has shape \(1, 1\), but must be a matrix of 2 x 1"),
    ({"V": [[1.0]]}, DimensionError, "V has shape"),
    ({"b": [1.0]}, DimensionError, r"b has shape \(1,\), but must be a vector of size 2"),
    ({"d": [1.0, 2.0]}, DimensionError, "d has shape"),
    ({"activation": [ReLU()]}, DimensionError, "activation has 1 entries"),
    ({"activation": "relu"}, InvalidInputError, "must be an Activation"),
])
def test_bad_arguments_name_the_culprit(change, error, words):
    good = {"W": np.zeros((2, 2)), "U": [[1.0], [2.0]], "V": [[1.0, 1.0]], "K": [[0.0]]}
    with pytest.raises(error, match=words):
        INC(**{**good, **change})


def test_bad_measurements_are_refused():
    inc = draw(0)
    with pytest.raises(DimensionError, match=r"y has shape \(2,\), but must be \(3,\) or \(3, N\)"):
        inc([1.0, 2.0])
    with pytest.raises(InvalidInputError, match="y holds a NaN"):
        inc([1.0, np.nan, 0.0])
    with pytest.raises(InvalidInputError, match="limit must be positive"):
        INC.saturated([[1.0]], -1.0)
    with pytest.raises(DimensionError, match="layer 2 reads 3 values, but layer 1 gives 2"):
        INC.from_layers([(np.zeros((2, 1)), np.zeros(2)), (np.zeros((1, 3)), np.zeros(1))])


def test_a_law_posed_by_a_multiplier_has_derivatives_too():
    rng = np.random.default_rng(8)
    inc = posed.controller(rng, MIXED, kind="skew")
    y, g, step = rng.standard_normal((P, 5)), rng.standard_normal((M, 5)), 1e-6
    assert not inc.well_posedness().contracts and inc.solve(y).method.startswith("newton")
    jacobian = inc.jacobian(y)
    for j in range(P):
        e = step * np.eye(P)[:, [j]]
        np.testing.assert_allclose(jacobian[:, :, j].T, (inc(y + e) - inc(y - e)) / (2 * step), atol=1e-6)
    adjoint, direction = inc.adjoint(y, g), rng.standard_normal(inc.W.shape)
    np.testing.assert_allclose(adjoint.y, np.einsum("nmp,mn->pn", jacobian, g), atol=1e-9)
    values = [np.sum(g * replace(inc, W=inc.W + sign * step * direction)(y)) for sign in (1, -1)]
    assert np.sum(adjoint.W * direction) == pytest.approx((values[0] - values[1]) / (2 * step), rel=1e-5, abs=1e-6)


def test_idle_units_of_a_law_posed_by_a_multiplier_can_be_left_out():
    inc = posed.controller(np.random.default_rng(2), MIXED, kind="symmetric")
    W = np.block([[inc.W, np.zeros((Q, 1))], [np.ones((1, Q)), np.full((1, 1), -5.0)]])
    grown = INC(W, np.vstack([inc.U, inc.U[:1]]), np.hstack([inc.V, np.zeros((M, 1))]), inc.K, np.append(inc.b, 1.0), inc.d,
                (*MIXED, ReLU()))
    y = np.random.default_rng(3).standard_normal((P, 20))
    assert grown.well_posedness().T is not None and grown.without_idle_units().well_posedness().T is not None
    np.testing.assert_allclose(grown(y), inc(y), atol=1e-9)
