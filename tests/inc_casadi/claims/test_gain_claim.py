"""The l2 gain: its condition by hand, tight on linear loops, kept by every disturbance that was tried."""

import draws
import numpy as np
import oracles
import pytest
import uncertain

from inc_casadi import INC, L2Gain, Plant, ReLU, Saturation, Tanh, certify, close_loop
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.multipliers import LADDER, Lifted, Relu, Sector

LAW = INC([[0.0]], [[2.0]], [[-0.3]], [[0.1]], activation=ReLU())
FULL = L2Gain([[1.0]], C_e=[[2.0]], D_u=[[0.5]], D_w=[[0.25]], D=[[0.1]])


def test_discrete_condition_by_hand():
    # x+ = 0.6 x - 0.3 eta + 1.01 w, u = 0.1 x - 0.3 eta + 0.01 w, e = 2.05 x - 0.15 eta + 0.255 w over s = (x, eta, w).
    loop = close_loop(Plant([[0.5]], [[1.0]]), LAW)
    graphs = FULL.graphs(loop, Sector())
    M = np.diag([0.1, 0.2, 0.3])
    found = FULL.conditions(graphs, {"P": np.array([[2.0]]), "gain^2": np.array([9.0])}, {"decrease": M})["decrease"]
    ahead, e = np.array([[0.6, -0.3, 1.01]]), np.array([[2.05, -0.15, 0.255]])
    expected = np.diag([2.0, 0.0, 9.0]) - 2 * ahead.T @ ahead - e.T @ e - M
    np.testing.assert_allclose(found, expected)
    named = L2Gain(FULL.E, FULL.C_e, FULL.D_u, FULL.D_w, FULL.D, gain=3.0)
    np.testing.assert_allclose(named.conditions(graphs, {"P": np.array([[2.0]])}, {"decrease": M})["decrease"], expected)
    assert graphs["decrease"].Z.tolist() == [[2.0, 0.0, 0.2]]


def test_continuous_condition_by_hand():
    loop = close_loop(Plant([[-0.5]], [[1.0]], dt=0), LAW)
    M = np.diag([0.1, 0.2, 0.3])
    values = {"P": np.array([[2.0]]), "gain^2": np.array([9.0])}
    found = FULL.conditions(FULL.graphs(loop, Sector()), values, {"decrease": M})
    x, flow, e = np.array([[1.0, 0, 0]]), np.array([[-0.4, -0.3, 1.01]]), np.array([[2.05, -0.15, 0.255]])
    expected = -2 * (x.T @ flow + flow.T @ x) - e.T @ e + np.diag([0.0, 0.0, 9.0]) - M
    np.testing.assert_allclose(found["decrease"], expected)


@pytest.mark.parametrize("dt", [1.0, 0.0])
def test_it_is_the_h_infinity_norm_of_a_linear_loop(dt):
    rng = np.random.default_rng(41)
    plant, K = draws.plant(rng, dt=dt), 0.05 * rng.normal(size=(2, 4))
    E, C_e, D_u, D_w, D = (rng.normal(size=shape) for shape in ((3, 2), (2, 3), (2, 2), (2, 2), (4, 2)))
    found = certify(plant, INC.linear(K), L2Gain(E, C_e, D_u, D_w, D))
    exact, _ = uncertain.peak(plant.A + plant.B @ K @ plant.C, E + plant.B @ K @ D, C_e + D_u @ K @ plant.C,
                              D_w + D_u @ K @ D, discrete=dt > 0)
    assert found.prove() and exact * (1 - 1e-9) <= found.bound <= exact * (1 + 1e-5)


def test_it_is_what_python_control_says():
    control = pytest.importorskip("control")
    plant = Plant([[0.9, 0.3], [-0.2, 0.7]], [[0.0], [1.0]])
    found = certify(plant, INC.linear([[0.0, 0.0]]), L2Gain([[1.0], [0.5]], [[1.0, 0.0]]))
    norm = control.norm(control.ss(plant.A, [[1.0], [0.5]], [[1.0, 0.0]], [[0.0]], True), "inf", tol=1e-7)
    assert found.bound == pytest.approx(norm, rel=1e-4)


def test_a_gain_that_is_named_is_proved_above_the_best_and_refused_below():
    plant, inc = Plant([[0.5]], [[1.0]]), INC.linear([[0.0]])  # sum 0.5^k = 2 at frequency zero
    assert certify(plant, inc, L2Gain([[1.0]], gain=2.001)).prove()
    assert not certify(plant, inc, L2Gain([[1.0]], gain=1.999)).holds()
    assert L2Gain([[1.0]], gain=2.0).bound(close_loop(plant, inc), {}) == 2.0


def waves(rng, r, N, K, frequency):
    """Disturbances (r, N, K): noise, bursts, and sinusoids at and about a frequency, in random directions."""
    w = rng.normal(size=(r, N, K))
    w[:, : N // 4, K // 3:] = 0.0
    turns = np.where(np.arange(N) % 2, frequency, rng.uniform(0, np.pi, N))
    tone = np.cos(turns[:, None] * np.arange(K) + rng.uniform(0, 6, N)[:, None])
    w[:, N // 2:] = rng.normal(size=(r, N - N // 2, 1)) * tone[N // 2:]
    return w * 10.0 ** rng.uniform(-2, 2, size=(N, 1))


@pytest.mark.parametrize("multiplier", LADDER, ids=lambda multiplier: multiplier.name)
def test_no_disturbance_exceeds_it(multiplier):
    rng = np.random.default_rng(42)
    plant = draws.plant(rng, n=2, m=1, p=2)
    inc = draws.controller(rng, m=1, p=2, norm=0.3, units=(ReLU(), ReLU(), Saturation()), gain=0.15)
    noisy = multiplier != Lifted()
    E, C_e, D_u, D_w = rng.normal(size=(2, 2)), rng.normal(size=(3, 2)), rng.normal(size=(3, 1)), rng.normal(size=(3, 2))
    D = 0.3 * rng.normal(size=(2, 2)) if noisy else None
    found = certify(plant, inc, L2Gain(E, C_e, D_u, D_w, D), multiplier=multiplier).require()
    assert found.prove() and found.multiplier == multiplier
    _, at = uncertain.peak(plant.A, E, C_e, D_w)
    w = waves(rng, 2, 200, 120, float(np.angle(at)))
    x, u = uncertain.disturbed(plant, inc, np.zeros((2, 200)), w, E, D)
    x = x[..., :-1]
    e = np.einsum("ij,jnk->ink", C_e, x) + np.einsum("ij,jnk->ink", D_u, u) + np.einsum("ij,jnk->ink", D_w, w)
    energy, spent = np.cumsum(np.sum(e**2, axis=0), axis=-1), np.cumsum(np.sum(w**2, axis=0), axis=-1)
    assert np.all(energy <= found.bound**2 * spent * (1 + 1e-9))
    assert np.max(energy[:, -1] / spent[:, -1]) > (0.5 * found.bound) ** 2


def test_from_elsewhere_V_pays_for_the_start():
    rng = np.random.default_rng(43)
    plant = draws.plant(rng, n=2, m=1, p=2)
    inc = draws.controller(rng, m=1, p=2, norm=0.3, units=(Tanh(), ReLU()), gain=0.15)
    found = certify(plant, inc, L2Gain(np.eye(2)), multiplier="relu").require()
    x0, w = draws.points(rng, 2, 100), 0.1 * waves(rng, 2, 100, 80, 0.3)
    x, _ = uncertain.disturbed(plant, inc, x0, w, np.eye(2))
    energy, spent = np.cumsum(np.sum(x[..., :-1]**2, axis=0), axis=-1), np.cumsum(np.sum(w**2, axis=0), axis=-1)
    V0 = oracles.quadratic(found.values["P"], x0)
    assert np.all(energy <= (V0[:, None] + found.bound**2 * spent) * (1 + 1e-9))


def test_continuous_time_on_trajectories():
    rng = np.random.default_rng(44)
    plant = draws.plant(rng, n=2, m=1, p=2, dt=0.0)
    inc = draws.controller(rng, m=1, p=2, norm=0.3, units=(ReLU(), Tanh(), ReLU()), gain=0.3)
    E = rng.normal(size=(2, 1))
    found = certify(plant, inc, L2Gain(E)).require()
    assert found.prove()
    h, steps = 0.02, 400
    tone = np.cos(np.outer(np.linspace(0, 3, 20), h * np.arange(steps)))
    x = energy = spent = 0.0
    for k in range(steps):  # w is held over a step, so its energy is exact; that of x by the trapezoidal rule
        w = tone[None, :, k]

        def velocity(x, w=w):
            return plant.A @ x + plant.B @ oracles.control(inc, plant.C @ x) + E @ w

        x = np.zeros((2, 20)) if k == 0 else x
        k1 = velocity(x)
        k2 = velocity(x + h / 2 * k1)
        k3 = velocity(x + h / 2 * k2)
        new = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + velocity(x + h * k3))
        energy, spent = energy + h / 2 * np.sum(x**2 + new**2, axis=0), spent + h * np.sum(w**2, axis=0)
        x = new
    assert np.all(energy <= found.bound**2 * spent * (1 + 1e-3))
    assert np.max(energy / spent) > (0.5 * found.bound) ** 2


def test_incremental_for_a_biased_loop():
    rng = np.random.default_rng(45)
    plant = draws.plant(rng, n=2, m=1, p=2)
    inc = draws.controller(rng, m=1, p=2, norm=0.3, units=(ReLU(), Tanh(), ReLU()), gain=0.15, bias=1.0)
    D = 0.3 * rng.normal(size=(2, 2))
    found = certify(plant, inc, L2Gain(np.eye(2), D=D))
    assert found.prove() and "incremental" in found.sentence and found.multiplier == Sector()
    x0, w = draws.points(rng, 2, 100), waves(rng, 2, 100, 80, 0.3)
    v = w + 10.0 ** rng.uniform(-3, 0, size=(100, 1)) * waves(rng, 2, 100, 80, 0.3)
    (one, _), (two, _) = (uncertain.disturbed(plant, inc, x0, drive, np.eye(2), D) for drive in (w, v))
    gap = np.cumsum(np.sum((one - two)[..., :-1]**2, axis=0), axis=-1)
    assert np.all(gap <= found.bound**2 * np.cumsum(np.sum((w - v)**2, axis=0), axis=-1) * (1 + 1e-9))


def test_what_it_refuses():
    loop = close_loop(Plant([[0.5]], [[1.0]]), LAW)
    assert "measurement is disturbed" in L2Gain([[1.0]], D=[[1.0]]).refusal(loop, Lifted())
    assert L2Gain([[1.0]], D=[[0.0]]).refusal(loop, Lifted()) is None
    assert "one step ahead only" in L2Gain([[1.0]]).refusal(loop, Lifted(2))
    biased = close_loop(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[2.0]], [[-0.3]], [[0.1]], b=[1.0]))
    assert "compares two motions" in L2Gain([[1.0]]).refusal(biased, Relu())
    assert L2Gain([[1.0]]).refusal(biased, Sector()) is None
    with pytest.raises(InvalidInputError, match="gain = 0"):
        L2Gain([[1.0]], gain=0.0)
    for culprit, claim in (("E", L2Gain([[1.0], [1.0]])), ("C_e", L2Gain([[1.0]], C_e=[[1.0, 2.0]])),
                           ("D_u", L2Gain([[1.0]], D_u=[[1.0, 2.0]])), ("D_w", L2Gain([[1.0]], D_w=[[1.0, 2.0]])),
                           ("D", L2Gain([[1.0]], D=[[1.0], [2.0]]))):
        with pytest.raises(DimensionError, match=f"^{culprit} has shape"):
            claim.check(Plant([[0.5]], [[1.0]]), LAW)


def test_the_bound_is_rounded_up():
    loop = close_loop(Plant([[0.5]], [[1.0]]), INC.linear([[0.0]]))
    for square in (2.0, 3.0, 0.1, 1e-12):
        bound = L2Gain([[1.0]]).bound(loop, {"gain^2": np.array([square])})
        assert bound**2 >= square and bound <= np.sqrt(square) * (1 + 1e-15)
