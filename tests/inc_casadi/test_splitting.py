"""The splitting: its resolvents by their definition, its stated contraction measured, its limit against a QP solver."""

import numpy as np
import oracles
import posed
import pytest
from scipy.optimize import lsq_linear

from inc_casadi import INC, CenteredLogistic, Identity, LeakyReLU, Logistic, ReLU, Saturation, Tanh, fixed_point
from inc_casadi.activations import Activation
from inc_casadi.errors import ConvergenceError, InvalidInputError, NotWellPosedError
from inc_casadi.fixed_point import solve
from inc_casadi.splitting import prepare, resolvent


class Bent(Activation):
    """tilt z + tanh(z) + 0.5: smooth, not zero at zero, with slopes within [tilt, tilt + 1] of either sign."""

    def __init__(self, tilt):
        self.tilt = tilt

    def formula(self, z, ops):
        return self.tilt * z + ops.tanh(z) + 0.5

    def derivative(self, z):
        return self.tilt + 1.0 - np.tanh(z) ** 2

    @property
    def slopes(self):
        return (self.tilt, self.tilt + 1.0)


UNITS = (ReLU(), LeakyReLU(0.2), Saturation(), Tanh(), Logistic(), CenteredLogistic(), Bent(0.3), Bent(-0.6))
MIXED = (ReLU(), LeakyReLU(0.2), Saturation(), Tanh(), Logistic(), Identity(), CenteredLogistic())


def drawn(seed, units=MIXED):
    rng = np.random.default_rng(seed)
    inc = posed.controller(rng, units, kind=("symmetric", "skew")[seed % 2])
    return inc, inc.well_posedness().T, inc.U @ rng.normal(size=(3, 40)) + inc.b[:, None]


def cycling():
    """Three ReLUs among which Newton's full steps go round for this c: found by drawing, and asserted below."""
    for seed in range(1000):
        rng = np.random.default_rng(seed)
        H = rng.normal(size=(3, 3))
        W, c = 0.3 * np.eye(3) + 4.0 * (H - H.T), 3 * rng.normal(size=(3, 50))
        eta, _ = fixed_point._newton(W, c, (ReLU(),) * 3, 9.0, np.ones(3), 1e-12, safeguarded=False)
        left = fixed_point._is_open(W, c, (ReLU(),) * 3, eta, 1e-12)
        if left.any():
            return W, c[:, left]
    raise AssertionError("no cycle was found")


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: type(unit).__name__)
@pytest.mark.parametrize("alpha", [1e-3, 0.3, 1.0, 2.5, 1e3])
def test_the_resolvent_solves_its_equation(unit, alpha):
    r = np.concatenate([np.linspace(-30, 30, 301), [-1e-9, 0.0, 1e-9]])[None]
    v = resolvent((unit,), alpha, r)
    low, high = unit.slopes
    z = (r - (1 - alpha) * v) / (alpha * (high - low))
    size = (1 + np.abs(r)) / min(alpha, 1.0)  # z is taken back from v, which magnifies its rounding by 1 / alpha
    with np.errstate(over="ignore"):
        assert np.all(np.abs(oracles.phi(unit, z) - low * z - v) <= 1e-14 * size)
    assert np.all(np.diff(v[0, :301]) >= -1e-13) and np.all(np.diff(v[0, :301]) <= np.diff(r[0, :301]) + 1e-12)


def test_the_resolvent_of_a_unit_without_bend_is_constant():
    assert resolvent((Identity(),), 0.7, np.array([[5.0, -3.0]])).tolist() == [[0.0, 0.0]]


@pytest.mark.parametrize("seed", range(8))
def test_an_iteration_contracts_by_the_stated_factor_and_that_by_its_bound(seed):
    inc, T, c = drawn(seed)
    splitting = prepare(inc.W, inc.activations, T)
    rng = np.random.default_rng(seed)
    assert splitting.rate <= splitting.bound + 1e-12 < 1
    worst = 0.0
    for size in (1e-2, 1.0, 1e2):
        a, b = size * rng.normal(size=(2, 7, 40))
        after = splitting.iterate(a, c, 1)[0] - splitting.iterate(b, c, 1)[0]
        ratio = np.sqrt(T @ after**2) / np.sqrt(T @ (a - b) ** 2)
        worst = max(worst, ratio.max())
    assert 0.3 * splitting.rate < worst <= splitting.rate + 1e-12


@pytest.mark.parametrize("seed", range(4))
def test_the_distance_to_the_limit_falls_as_stated(seed):
    inc, T, c = drawn(seed)
    splitting = prepare(inc.W, inc.activations, T)
    limit = splitting.begin(inc.solve(np.zeros(3)).eta, inc.b[:, None], inc.W)
    w, b = np.ones((7, 1)), inc.b[:, None]
    first = np.sqrt(T @ (w - limit) ** 2)[0]
    for k in range(1, 30):
        w, _ = splitting.iterate(w, b, 1)
        assert np.sqrt(T @ (w - limit) ** 2)[0] <= splitting.rate**k * first + 1e-10


def test_a_symmetric_problem_reaches_the_better_factor():
    H = np.diag([1.0, 9.0])  # m = 1, M = 9: (3 - 1) / (3 + 1)
    splitting = prepare(np.eye(2) - H, (Saturation(),) * 2, np.ones(2))
    assert splitting.rate == pytest.approx(0.5) and splitting.bound == pytest.approx(np.sqrt(0.8))
    slow = prepare(np.eye(2) - H, (Saturation(),) * 2, np.ones(2), alpha=1.0)
    assert slow.alpha == 1.0 and slow.rate == pytest.approx(0.8)


@pytest.mark.parametrize("T", [[1.0, 1.0], [3.0, 0.2]])
def test_a_T_that_is_no_multiplier_is_refused(T):
    with pytest.raises(NotWellPosedError, match="T is no multiplier of W .2 x 2.: the monotonicity is -"):
        prepare(np.array([[0.0, 3.0], [-0.2, 0.0]]), (ReLU(),) * 2, np.array(T))


@pytest.mark.parametrize("method", ["auto", "splitting"])
def test_smooth_units_with_slopes_of_either_sign_are_solved(method):
    rng = np.random.default_rng(8)
    units, H = (Bent(0.3), Bent(-0.6), Bent(-0.2), Bent(-0.6)), rng.normal(size=(4, 4))
    W = np.diag([-0.2, 0.1, 0.1, 0.1]) + 0.6 * (H - H.T)
    inc = INC(W, rng.normal(size=(4, 2)), np.ones((1, 4)), [[0.0, 0.0]], activation=units)
    assert not inc.well_posedness().contracts and inc.well_posedness().T is not None
    y = 5 * rng.normal(size=(2, 50))
    eta = inc.solve(y, method).eta
    z = inc.W @ eta + inc.U @ y
    values = np.array([unit.tilt * z[i] + np.tanh(z[i]) + 0.5 for i, unit in enumerate(units)])
    np.testing.assert_allclose(eta, values, atol=1e-10)


@pytest.mark.parametrize("method", ["auto", "newton", "splitting"])
@pytest.mark.parametrize("seed", range(4))
def test_the_fixed_point_is_the_minimizer_of_a_box_constrained_qp(method, seed):
    """eta = sat((I - g H) eta - g f) is the minimizer of eta'H eta / 2 + f'eta over |eta_i| <= 1, whatever g > 0."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(9, 5))
    H, f = root.T @ root + 0.1 * np.eye(5), 8 * rng.normal(size=(5, 6))
    R = np.linalg.cholesky(H).T
    inc = INC(np.eye(5) - 0.3 * H, -0.3 * np.eye(5), np.eye(5), np.zeros((5, 5)), activation=Saturation())
    assert inc.well_posedness().radius > 1
    found = inc.solve(f, method=method)
    for k in range(6):
        true = lsq_linear(R, -np.linalg.solve(R.T, f[:, k]), (-1, 1), method="bvls", tol=1e-14).x
        np.testing.assert_allclose(found.eta[:, k], true, atol=1e-8)
    assert np.any(np.abs(found.eta) == 1) and np.any(np.abs(found.eta) < 1)


def test_picard_diverges_where_splitting_converges_and_auto_never_takes_picard():
    W, c = np.array([[-3.0, 1.0], [-1.0, -3.0]]), np.outer([3.0, 5.0], np.linspace(0.5, 2.0, 60))
    at = {"rate": 4.0, "weights": np.ones(2), "T": np.ones(2)}
    with pytest.raises(ConvergenceError, match=r"\(picard\)"):
        solve(W, c, (LeakyReLU(0.9),) * 2, method="picard", **at)  # grows without bound, and stops there
    for unit in (ReLU(), Saturation()):  # these go round for ever
        with pytest.raises(ConvergenceError, match=r"after 2000 evaluations \(picard\)"):
            solve(W, c, (unit,) * 2, method="picard", max_iterations=2000, **at)
    expected = np.linalg.solve(np.eye(2) - W, c)  # both units are active
    assert np.all(expected > 0)
    for method in ("auto", "newton", "splitting"):
        found = solve(W, c, (ReLU(),) * 2, method=method, **at)
        np.testing.assert_allclose(found.eta, expected, atol=1e-11)
        assert found.method == {"auto": "newton"}.get(method, method)


def test_columns_on_which_newton_goes_round_are_solved_by_splitting():
    W, c = cycling()
    at = {"rate": 9.0, "weights": np.ones(3)}
    with pytest.raises(ConvergenceError, match=r"\(newton\)"):
        solve(W, c, (ReLU(),) * 3, **at)
    found = solve(W, c, (ReLU(),) * 3, T=np.ones(3), **at)
    assert found.method == "newton and splitting" and found.residual < 1e-10
    np.testing.assert_allclose(found.eta, np.maximum(W @ found.eta + c, 0.0), atol=1e-10)
    alone = solve(W, c, (ReLU(),) * 3, T=np.ones(3), method="splitting", **at)
    np.testing.assert_allclose(alone.eta, found.eta, atol=1e-9)


def test_splitting_serves_where_perron_frobenius_holds_and_without_hidden_units():
    rng = np.random.default_rng(1)
    W = 0.2 * rng.normal(size=(7, 7))
    inc = INC(W, rng.normal(size=(7, 3)), rng.normal(size=(1, 7)), np.zeros((1, 3)), activation=MIXED)
    y = rng.normal(size=(3, 30))
    assert inc.well_posedness().contracts
    np.testing.assert_allclose(inc.solve(y, "splitting").eta, oracles.hidden(inc, y), atol=1e-10)
    assert INC.linear([[1.0]]).solve([1.0], "splitting").eta.size == 0


def test_what_cannot_be_done_is_said():
    with pytest.raises(InvalidInputError, match="no multiplier T is given"):
        solve(np.array([[-3.0]]), np.ones((1, 1)), (ReLU(),), rate=3.0, weights=np.ones(1), method="splitting")
    with pytest.raises(InvalidInputError, match="'picard', 'newton' or 'splitting'"):
        solve(np.array([[-3.0]]), np.ones((1, 1)), (ReLU(),), rate=3.0, weights=np.ones(1), method="bisection")
    inc, T, c = drawn(0)
    with pytest.raises(ConvergenceError, match=r"after 3 evaluations \(splitting\)"):
        solve(inc.W, c, inc.activations, rate=9.0, weights=np.ones(7), T=T, method="splitting", max_iterations=3)
