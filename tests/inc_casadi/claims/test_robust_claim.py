"""Robust claims: their inequality by hand, their promise for every perturbation that was tried, and what they refuse."""

import draws
import numpy as np
import oracles
import pytest
import uncertain

from inc_casadi import (
    INC,
    Box,
    DiscountedCost,
    InputSector,
    L2Gain,
    Margins,
    NormBounded,
    Plant,
    Polytopic,
    ReLU,
    Robust,
    Saturation,
    Stability,
    Together,
    certify,
    close_loop,
)
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.multipliers import LADDER, Lifted, Sector

PLANT = Plant([[0.5]], [[1.0]])
LAW = INC([[0.0]], [[2.0]], [[-0.3]], [[0.1]], activation=ReLU())
P = {"P": np.array([[2.0]])}


def test_input_sector_condition_by_hand():
    # s = (x, eta, w): x+ = 0.6 x - 0.3 eta + w, u = 0.1 x - 0.3 eta; 2 tau (w + 0.5 u)(u - w) with sector [0.5, 2].
    claim = Robust(Stability(0.5), InputSector(0.5, 2.0))
    graphs = claim.graphs(close_loop(PLANT, LAW), Sector())
    M = np.diag([0.1, 0.2, 0.3])
    found = claim.conditions(graphs, {**P, "tau": np.array([3.0])}, {"decrease": M})
    x, u, w = np.eye(3)[:1], np.array([[0.1, -0.3, 0.0]]), np.eye(3)[2:]
    ahead = 0.5 * x + u + w
    cross = (w + 0.5 * u).T @ (u - w)
    expected = 0.25 * 2 * x.T @ x - 2 * ahead.T @ ahead - M - 3 * (cross + cross.T)
    np.testing.assert_allclose(found["decrease"], expected)
    assert set(found) == {"P", "decrease"}


def test_norm_bounded_condition_by_hand():
    # w = D v, v = 0.1 x + 0.2 u, |D| <= 0.5, enters by E = 3.
    claim = Robust(Stability(0.5), NormBounded([[3.0]], [[0.1]], [[0.2]], size=0.5))
    M = np.diag([0.1, 0.2, 0.3])
    found = claim.conditions(claim.graphs(close_loop(PLANT, LAW), Sector()), {**P, "tau": np.array([3.0])}, {"decrease": M})
    x, u, w = np.eye(3)[:1], np.array([[0.1, -0.3, 0.0]]), np.eye(3)[2:]
    ahead, v = 0.5 * x + u + 3 * w, 0.1 * x + 0.2 * u
    expected = 0.25 * 2 * x.T @ x - 2 * ahead.T @ ahead - M - 3 * (0.25 * v.T @ v - w.T @ w)
    np.testing.assert_allclose(found["decrease"], expected)


def test_the_gain_of_a_robust_loop_by_hand():
    # The uncertainty's w comes first, then the disturbance's: the two must not be mixed up.
    claim = Robust(L2Gain([[5.0]], gain=3.0), NormBounded([[3.0]], [[0.1]], size=0.5))
    M = np.diag([0.1, 0.2, 0.3, 0.4])
    found = claim.conditions(claim.graphs(close_loop(PLANT, LAW), Sector()), {**P, "tau": np.array([3.0])}, {"decrease": M})
    x, w, d = np.eye(4)[:1], np.eye(4)[2:3], np.eye(4)[3:]
    ahead = np.array([[0.6, -0.3, 3.0, 5.0]])
    expected = 2 * x.T @ x - 2 * ahead.T @ ahead - x.T @ x + 9 * d.T @ d - M - 3 * (0.0025 * x.T @ x - w.T @ w)
    np.testing.assert_allclose(found["decrease"], expected)


UNITS = (ReLU(), ReLU(), Saturation())


def loop_with_relus(seed, gain=0.1, units=UNITS):
    rng = np.random.default_rng(seed)
    return draws.plant(rng, n=2, m=1, p=2), draws.controller(rng, m=1, p=2, norm=0.3, units=units, gain=gain), rng


@pytest.mark.parametrize("multiplier", LADDER, ids=lambda multiplier: multiplier.name)
def test_every_gain_in_the_sector_keeps_the_rate(multiplier):
    plant, inc, rng = loop_with_relus(51, 0.1)
    found = certify(plant, inc, Robust(Stability(0.95), InputSector(0.5, 1.5)), multiplier=multiplier).require()
    assert found.prove()
    x0 = draws.points(rng, 2, 300)
    gains = rng.choice([0.5, 1.5], size=(40, 300)), rng.uniform(0.5, 1.5, size=(40, 300))
    for drawn in gains:
        x, _ = uncertain.varying(inc, x0, 40, lambda k: plant, lambda k, u, drawn=drawn: drawn[k] * u)
        v = x
        if multiplier == Lifted():
            eta = np.stack([oracles.hidden(inc, plant.C @ x[..., k]) for k in range(41)], axis=-1)
            v = np.concatenate([x, eta])
        V = oracles.quadratic(found.values["P"], v)
        assert np.all(V[:, 1:] <= 0.95**2 * V[:, :-1] * (1 + 1e-9) + 1e-300)


@pytest.mark.parametrize("multiplier", ["sector", "lifted"])
def test_the_cost_holds_for_every_actuator_and_every_matrix(multiplier):
    plant, inc, rng = loop_with_relus(52, 0.1)
    cost = DiscountedCost(np.diag([1.0, 0.4]), [[0.3]], 0.97, Box([-1, -1], [1, 1]))
    x0 = draws.points(rng, 2, 100)
    found = certify(plant, inc, Robust(cost, InputSector(0.5, 1.6)), multiplier=multiplier).require()
    form = found.values.get("P_0", found.values["P"])
    gains = rng.choice([0.5, 1.0, 1.6], size=(80, 100))
    x, u = uncertain.varying(inc, x0, 80, lambda k: plant, lambda k, u: gains[k] * u)
    paid = oracles.discounted_cost(x[..., :-1], u, cost.Q, cost.R, cost.discount)
    assert found.prove() and np.all(paid <= oracles.quadratic(form, x0) * (1 + 1e-9))

    box = NormBounded(0.1 * rng.normal(size=(2, 2)), rng.normal(size=(3, 2)), rng.normal(size=(3, 1)), size=0.2)
    found = certify(plant, inc, Robust(cost, box), multiplier=multiplier).require()
    form = found.values.get("P_0", found.values["P"])
    assert found.prove()
    for _ in range(5):
        D = rng.normal(size=(40, 2, 3))
        D *= 0.2 / np.linalg.norm(D, ord=2, axis=(1, 2))[:, None, None]

        def at(k, D=D):
            change = box.E @ D[k % 40]
            return Plant(plant.A + change @ box.N_x, plant.B + change @ box.N_u, plant.C)

        x, u = uncertain.varying(inc, x0, 80, at)
        paid = oracles.discounted_cost(x[..., :-1], u, cost.Q, cost.R, cost.discount)
        assert np.all(paid <= oracles.quadratic(form, x0) * (1 + 1e-9))


@pytest.mark.parametrize("dt", [1.0, 0.0])
def test_a_linear_loop_breaks_right_above_its_stability_radius(dt):
    rng = np.random.default_rng(53)
    plant = draws.plant(rng, n=3, m=1, p=2, dt=dt)
    K = 0.05 * rng.normal(size=(1, 2))
    E, N_x, N_u = rng.normal(size=(3, 2)), rng.normal(size=(2, 3)), rng.normal(size=(2, 1))
    closed, N = plant.A + plant.B @ K @ plant.C, N_x + N_u @ K @ plant.C
    size, at = uncertain.peak(closed, E, N, 0.0, discrete=dt > 0)
    radius = 1 / size
    for factor, expected in ((0.999, True), (1.001, False)):
        claim = Robust(Stability(), NormBounded(E, N_x, N_u, size=factor * radius))
        found = certify(plant, INC.linear(K), claim)
        assert found.holds() == expected and bool(found.prove()) == expected
    # The complex D of the small gain theorem puts an eigenvalue on the boundary.
    response = N @ np.linalg.solve(at * np.eye(3) - closed, E)
    left, values, right = np.linalg.svd(response)
    D = np.outer(right[0].conj(), left[:, 0].conj()) / values[0]
    assert np.linalg.norm(D, 2) == pytest.approx(radius, rel=1e-9)
    assert np.min(np.abs(np.linalg.eigvals(closed + E @ D @ N) - at)) < 1e-6


def test_a_positive_loop_breaks_at_a_real_matrix():
    A, E, N = np.array([[0.5, 0.2], [0.1, 0.6]]), np.array([[1.0], [0.3]]), np.array([[0.2, 1.0]])
    plant = Plant(A, [[0.0], [0.0]])
    radius = 1 / float((N @ np.linalg.solve(np.eye(2) - A, E)).item())
    holds = [certify(plant, INC.linear([[0.0, 0.0]]), Robust(Stability(), NormBounded(E, N, size=f * radius))).holds()
             for f in (0.999, 1.001)]
    assert holds == [True, False]
    assert np.max(np.abs(np.linalg.eigvals(A + 1.001 * radius * E @ N))) > 1


def test_the_gain_holds_for_every_matrix():
    plant, inc, rng = loop_with_relus(54)
    box = NormBounded([[0.3], [0.1]], [[1.0, 0.5]], size=0.3)
    found = certify(plant, inc, Robust(L2Gain(np.eye(2)), box)).require()
    plain = certify(plant, inc, L2Gain(np.eye(2))).require()
    assert found.prove() and found.bound > plain.bound
    for delta in (0.3, -0.3, 0.1):
        moved = Plant(plant.A + delta * box.E @ box.N_x, plant.B, plant.C)
        w = rng.normal(size=(2, 100, 80)) * (0.95 ** np.arange(80))
        x, _ = uncertain.disturbed(moved, inc, np.zeros((2, 100)), w, np.eye(2))
        assert np.all(np.sum(x**2, axis=(0, 2)) <= found.bound**2 * np.sum(w**2, axis=(0, 2)) * (1 + 1e-9))


def test_a_named_rate_promises_no_phase_margin():
    # Weights rho^(-2k) grow: sums over time of what a dynamic perturbation does may then be negative.
    sector, loop = InputSector(0.5, 2.0), close_loop(PLANT, LAW)
    named, unnamed = Robust(Stability(0.9), sector), Robust(Stability(), sector)
    assert not named.sums and unnamed.sums and Robust(L2Gain([[1.0]]), sector).sums
    assert "phase" not in named.sentence(loop, P) and "gain between 0.5 and 2" in named.sentence(loop, P)
    assert "every phase lag up to 36.86" in unnamed.sentence(loop, P)
    matrices = NormBounded([[1.0]], [[1.0]], size=0.5)
    assert "dynamic" not in Robust(Stability(0.9), matrices).sentence(loop, P)
    assert "stable dynamic ones included" in Robust(Stability(), matrices).sentence(loop, P)
    assert not Polytopic(named, (PLANT,)).sums and "phase" not in Polytopic(named, (PLANT,)).sentence(loop, P)
    together = Together((named, L2Gain([[1.0]], gain=9.0)))
    assert not together.sums and "phase" not in together.sentence(loop, P)


def test_a_named_rate_is_broken_by_a_dynamic_perturbation():
    """Why: w_k = v_{k-1} has gain 1, so sums of v^2 - w^2 are nonnegative, but not with weights 0.3^(-2k)."""
    # x+ = 0.2 x + 0.19 w, v = x: for static |D| <= 1 the rate 0.4 is proved; with the delay, x+ = 0.2 x + 0.19 x_{-1}.
    plant, inc = Plant([[0.2]], [[1.0]]), INC.linear([[0.0]])
    assert certify(plant, inc, Robust(Stability(0.4), NormBounded([[0.19]], [[1.0]]))).prove()
    delayed = np.max(np.abs(np.linalg.eigvals([[0.2, 0.19], [1.0, 0.0]])))
    assert 0.4 < delayed < 1


def test_what_it_refuses():
    sector = InputSector(0.5, 2.0)
    for claim in (Robust(Stability(), sector), Margins(0.3), Margins(), Polytopic(Stability(), (PLANT,)),
                  Together((Stability(0.9), Stability(0.8))), "stable"):
        with pytest.raises(InvalidInputError, match="claim is .* but must be a Claim about one step"):
            Robust(claim, sector)
    with pytest.raises(InvalidInputError, match="must be an Uncertainty"):
        Robust(Stability(), 0.5)
    biased = INC([[0.0]], [[2.0]], [[-0.3]], [[0.1]], b=[1.0])
    for claim in (Robust(Stability(), sector), Margins(0.3), Margins()):
        with pytest.raises(InvalidInputError, match="robust claim cannot be made: it is about the origin"):
            certify(PLANT, biased, claim)
    with pytest.raises(DimensionError, match="E has shape"):
        Robust(Stability(), NormBounded([[1.0], [1.0]], [[1.0]])).check(PLANT, LAW)
    with pytest.raises(InvalidInputError, match="rate = 1 is outside"):
        Robust(Stability(1.0), sector).check(PLANT, LAW)
    loop = close_loop(Plant([[-0.5]], [[1.0]], dt=0), LAW)
    assert "needs discrete time" in Robust(Stability(), sector).refusal(loop, Lifted())
    # w enters from outside, so V may look one step ahead only.
    assert "not 2" in Robust(Stability(), sector).refusal(close_loop(PLANT, LAW), Lifted(2))
    assert Stability().refusal(close_loop(PLANT, LAW), Lifted(2)) is None
    noisy = Robust(L2Gain([[1.0]], D=[[1.0]]), sector)
    assert "measurement is disturbed" in noisy.refusal(close_loop(PLANT, LAW), Lifted())


def test_an_open_rate_is_not_tuned():
    claim = Robust(Stability(), InputSector(0.5, 2.0))
    assert claim.yes_or_no and not claim.tunable and not claim.compound and claim.uncertain
    assert claim.bound(close_loop(PLANT, LAW), P) == 1.0
    assert not Robust(L2Gain([[1.0]]), InputSector(0.5, 2.0)).yes_or_no
