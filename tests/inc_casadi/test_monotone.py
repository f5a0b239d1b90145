"""The multiplier T: both sides of its edge by hand, its consequences by sampling, and no trust in the solver."""

from dataclasses import replace

import numpy as np
import oracles
import posed
import pytest

from inc_casadi import INC, CenteredLogistic, Identity, LeakyReLU, Logistic, ReLU, Saturation, Tanh, monotone
from inc_casadi.activations.stack import as_units, lipschitz, slopes
from inc_casadi.monotone import Multiplier, condition, error_from_residual, find_multiplier, lipschitz_bounds, lmi_well_posed

RELU = (np.zeros(2), np.ones(2))
UNIFORM = (ReLU(), LeakyReLU(0.3), Saturation(), Tanh(), Logistic(), CenteredLogistic())
MIXED = (ReLU(), LeakyReLU(0.2), Saturation(), Tanh(), Logistic(), Identity(), CenteredLogistic())


def unsure(rng, q=6):
    """Slopes with negative lower ends and constant units among them, and a W that some T may admit."""
    low = rng.uniform(-0.5, 0.5, q) * (rng.random(q) < 0.6)
    high = low + rng.uniform(0.1, 2.0, q) * (rng.random(q) < 0.85)
    low, high = (np.where(np.arange(q) == 0, 0.0, ends) for ends in (low, high))  # unit 0 is constant
    return (low, high), 0.5 * rng.normal(size=(q, q)) - 0.8 * np.eye(q)


def between(rng, ends):
    """A diagonal of slopes, at an end half of the time."""
    share = rng.random(ends[0].size) if rng.random() < 0.5 else rng.integers(0, 2, ends[0].size)
    return ends[0] + share * (ends[1] - ends[0])


@pytest.mark.parametrize("exactly", [True, False])
def test_both_sides_of_the_edge_by_hand(exactly):
    # One ReLU: 2T(1 - w) > 0, so w < 1. Two in a ring: 4 > (a + b)^2 with T = I.
    for w, holds in ((1 - 1e-9, True), (1.0, False), (1 + 1e-9, False), (-50.0, True)):
        assert lmi_well_posed((np.zeros(1), np.ones(1)), np.array([[w]]), np.ones(1), exactly) == holds
    for a, holds in ((-1.5, True), (1 - 1e-9, True), (1 + 1e-9, False)):
        assert lmi_well_posed(RELU, np.array([[0.0, a], [1.0, 0.0]]), np.ones(2), exactly) == holds
    # slopes in [l, s]: (1 - l w)(1 - s w) > 0
    for w, holds in ((0.4, True), (0.51, False), (-0.9, True), (-1.1, False)):
        assert lmi_well_posed((np.array([-1.0]), np.array([2.0])), np.array([[w]]), np.ones(1), exactly) == holds
    # with a monotonicity: 2(1 - w) > 2 m
    assert lmi_well_posed((np.zeros(1), np.ones(1)), np.array([[-3.0]]), np.ones(1), exactly, 3.99)
    assert not lmi_well_posed((np.zeros(1), np.ones(1)), np.array([[-3.0]]), np.ones(1), exactly, 4.01)


@pytest.mark.parametrize("exactly", [True, False])
def test_a_wrong_T_is_refused(exactly):
    W = np.array([[0.0, 3.0], [-0.2, 0.0]])
    assert lmi_well_posed(RELU, W, np.array([0.2, 3.0]), exactly)
    for T in ([1.0, 1.0], [3.0, 0.2], [0.0, 3.0], [-0.2, -3.0], [0.2, np.nan], [0.2, np.inf]):
        assert not lmi_well_posed(RELU, W, np.array(T), exactly), T
    assert not lmi_well_posed(RELU, W, np.array([0.2, 3.0]), exactly, -1.0)
    # eta = relu(2 eta + c) has no solution or two, yet -2 - 2 (-2) > 0: T must be positive.
    assert not lmi_well_posed((np.zeros(1), np.ones(1)), np.array([[2.0]]), -np.ones(1), exactly)
    assert lmi_well_posed((np.zeros(0), np.zeros(0)), np.zeros((0, 0)), np.zeros(0), exactly)


def test_exact_arithmetic_decides_where_floats_leave_it_open():
    slopes_of_one, T = (np.zeros(1), np.ones(1)), np.ones(1)
    just_below = np.array([[np.nextafter(1.0, 0.0)]])
    assert lmi_well_posed(slopes_of_one, just_below, T, True) and not lmi_well_posed(slopes_of_one, just_below, T, False)


def test_the_condition_is_the_published_one_for_lower_slopes_zero():
    rng = np.random.default_rng(0)
    W, T, S = rng.normal(size=(4, 4)), rng.random(4), rng.random(4)
    expected = 2 * np.diag(T) - np.diag(T * S) @ W - W.T @ np.diag(S * T)
    np.testing.assert_allclose(condition((np.zeros(4), S), W, T), expected, atol=1e-14)


@pytest.mark.parametrize("seed", range(12))
def test_what_a_multiplier_implies_is_true_on_samples(seed):
    """I - DW is nonsingular with a determinant of one sign, and every (I - DW)^{-1} D U lies within the bounds."""
    rng = np.random.default_rng(seed)
    ends, W = unsure(rng)
    found = find_multiplier(ends, W)
    signs = {np.sign(np.linalg.det(np.eye(6) - between(rng, ends)[:, None] * W)) for _ in range(300)}
    if found is None:
        return
    assert len(signs) == 1 and 0.0 not in signs
    assert lmi_well_posed(ends, W, found.T, True, found.monotonicity)
    U, V, K = rng.normal(size=(6, 3)), rng.normal(size=(2, 6)), rng.normal(size=(2, 3))
    hidden, outer = lipschitz_bounds(ends, W, U, V, K, found.T)
    assert not hidden[0].any()  # the constant unit
    closest = 0.0
    for _ in range(300):
        D = between(rng, ends)
        X = np.linalg.solve(np.eye(6) - D[:, None] * W, D[:, None] * U)
        assert np.all(np.abs(X) <= hidden + 1e-7) and np.all(np.abs(K + V @ X) <= outer + 1e-7)
        closest = max(closest, np.max(np.abs(X[hidden > 0]) / hidden[hidden > 0]))
    assert closest > 0.2  # a bound, not a platitude


def test_a_constant_unit_an_idle_unit_and_a_good_share_of_random_W_are_admitted():
    found = [find_multiplier(*unsure(np.random.default_rng(seed))) for seed in range(12)]
    assert sum(multiplier is not None for multiplier in found) >= 6
    idle = np.zeros((3, 3))
    idle[:2, :2] = [[0.0, 3.0], [-0.2, 0.0]]
    assert find_multiplier((np.zeros(3), np.ones(3)), idle) is not None
    assert find_multiplier((np.zeros(0), np.zeros(0)), np.zeros((0, 0))) is not None


@pytest.mark.parametrize("units", [*((unit,) * 6 for unit in UNIFORM), MIXED], ids=lambda units: type(units[0]).__name__)
@pytest.mark.parametrize("kind", ["symmetric", "skew"])
def test_perron_frobenius_rejects_and_T_accepts_with_every_activation(units, kind):
    rng = np.random.default_rng(3)
    inc = posed.controller(rng, units, kind=kind)
    test = inc.well_posedness()
    S = lipschitz(as_units(units, len(units)))
    assert np.max(np.abs(np.linalg.eigvals(S[:, None] * np.abs(inc.W)))) > 1
    assert test.holds and not test.contracts and test.T is not None
    y = 3 * rng.normal(size=(3, 300))
    eta = inc.hidden(y)
    z = inc.W @ eta + inc.U @ y + inc.b[:, None]
    np.testing.assert_allclose(eta, np.array([oracles.phi(unit, z[i]) for i, unit in enumerate(units)]), atol=1e-9)
    a, b = y[:, :150], y[:, 150:]
    assert np.all(np.abs(inc(a) - inc(b)) <= test.lipschitz @ np.abs(a - b) + 1e-9)
    assert np.all(np.abs(inc.hidden(a) - inc.hidden(b)) <= test.hidden_lipschitz @ np.abs(a - b) + 1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_a_residual_bounds_the_error(seed):
    rng = np.random.default_rng(seed)
    inc = posed.controller(rng, MIXED, kind=("symmetric", "skew")[seed % 2])
    test, ends = inc.well_posedness(), slopes(inc.activations)
    y = rng.normal(size=(3, 200))
    eta = inc.hidden(y)
    guess = eta + 10.0 ** rng.uniform(-3, 0, 200) * rng.normal(size=eta.shape)
    z = inc.W @ guess + inc.U @ y + inc.b[:, None]
    residual = np.abs(guess - np.array([oracles.phi(unit, z[i]) for i, unit in enumerate(MIXED)]))
    for k in range(200):
        bound = error_from_residual(ends, inc.W, test.multiplier, residual[:, k])
        assert np.all(np.abs(guess - eta)[:, k] <= bound + 1e-9)


def test_the_residual_bound_by_hand():
    # eta = phi(w eta + c), slopes in [0, 1], w = -1: a residual r leaves an error of r at most, where the unit is flat.
    ends, W, multiplier = (np.zeros(1), np.ones(1)), np.array([[-1.0]]), Multiplier(np.ones(1), 2.0)
    assert error_from_residual(ends, W, multiplier, np.array([2.0]))[0] == pytest.approx(3.0)
    same = replace(multiplier, T=np.array([4.0]))  # a multiple of T makes no difference
    assert error_from_residual(ends, W, same, np.array([2.0]))[0] == pytest.approx(3.0)
    halved = replace(multiplier, monotonicity=1.0)
    assert error_from_residual(ends, W, halved, np.array([2.0]))[0] == pytest.approx(6.0)


@pytest.mark.parametrize("W", [[[2.0]], [[1.0]], [[0.0, 2.0], [0.5, 0.0]], [[0.0, 2.0], [1.0, 0.0]]])
def test_an_ill_posed_W_has_no_multiplier(W):
    W = np.array(W)
    q = len(W)
    assert find_multiplier((np.zeros(q), np.ones(q)), W) is None
    # eta = relu(2 eta + c): none for c > 0, eta = 0 and eta = -c for c < 0; with D = I the matrix is singular at best.
    assert np.linalg.det(np.eye(q) - W) <= 0


def ring(gain, q=3):
    """Three ReLUs that feed each other round: the best T is the identity, and the condition holds for gain < 1 or so."""
    return gain * np.roll(np.eye(q), 1, axis=0)


def test_the_search_reaches_the_known_edge():
    # A ring of negative gain -g with T = I: 2I + g(P + P') has the smallest eigenvalue 2 - g, so it holds below g = 2.
    ends, scale = (np.zeros(3), np.ones(3)), np.array([1.0, 30.0, 0.2])
    for gain, holds in ((1.99, True), (2.01, False)):
        W = scale[:, None] * ring(-gain) / scale[None, :]
        assert (find_multiplier(ends, W) is not None) == holds


def test_scaling_the_hidden_units_changes_nothing_but_T():
    rng = np.random.default_rng(5)
    ends, W = (np.zeros(4), np.ones(4)), rng.normal(size=(4, 4)) - 1.5 * np.eye(4)
    plain = find_multiplier(ends, W)
    scale = 10.0 ** rng.uniform(-1, 1, 4)
    scaled = find_multiplier(ends, scale[:, None] * W / scale[None, :])
    assert plain is not None and scaled is not None and scaled.monotonicity > 0
    assert lmi_well_posed(ends, W, scaled.T * scale**2, True, scaled.monotonicity)


def test_what_the_solver_says_is_not_believed(monkeypatch):
    class Said:
        y, interior = np.array([1.0, 1.0, 9.0]), None

    W = np.array([[0.0, 30.0], [-0.02, 0.0]])
    assert find_multiplier(RELU, W) is not None
    monkeypatch.setattr(monotone, "_simple_scalings", lambda *_: iter(()))
    found = find_multiplier(RELU, W)
    assert found is not None and lmi_well_posed(RELU, W, found.T, True, found.monotonicity)
    monkeypatch.setattr("inc_casadi.interior_point.solve", lambda *_: Said())
    assert find_multiplier(RELU, W) is None  # T = I is no multiplier of this W
    monkeypatch.setattr(Said, "y", np.full(3, np.nan))
    assert find_multiplier(RELU, W) is None


def test_the_message_names_both_tests_and_their_figures():
    from inc_casadi.errors import NotWellPosedError
    inc = INC([[2.0]], [[1.0]], [[1.0]], [[0.0]])
    with pytest.raises(NotWellPosedError, match=r"lambda_pf\(S\|W\|\) = 2 is not below 1 \(thm:wellposed\), and no diagonal "
                                                r"T > 0 with 2T - TW - W'T > 0 was found"):
        inc([1.0])
