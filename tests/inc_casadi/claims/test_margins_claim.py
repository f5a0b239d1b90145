"""Margins: tight for linear loops of one input, true for gains and lags, in discrete and in continuous time."""

import draws
import numpy as np
import pytest
import uncertain

from inc_casadi import INC, InputSector, Margins, Plant, ReLU, Robust, Saturation, Stability, certify, close_loop
from inc_casadi.errors import InvalidInputError
from inc_casadi.multipliers import Sector

UNSTABLE = Plant([[1.2, 0.5], [0.0, 0.7]], [[0.3], [1.0]])
GAIN = np.array([[-0.7, -0.45]])
FLOWING = Plant([[0.4, 1.0], [-0.5, -0.6]], [[0.0], [1.0]], dt=0)
FLOW_GAIN = np.array([[-1.2, -1.6]])
CASES = [(UNSTABLE, GAIN), (FLOWING, FLOW_GAIN)]


def disk_margin(plant, K):
    """1 / max |S - 1/2| over the boundary, S = 1 / (1 + L), L = -K (z I - A)^{-1} B, and where the maximum is.

    With the gain f = (1 + d/2) / (1 - d/2) at the input, 1 + f L = 0 means (1 + L) - (1 - L) d/2 = 0, so
    d = 2 / (T - S) = -1 / (S - 1/2) (Seiler, Packard, Gahinet 2020). Since S = 1 + K (z I - A - B K)^{-1} B, the
    response to measure is K (z I - A - B K)^{-1} B + 1/2.
    """
    size, at = uncertain.peak(plant.A + plant.B @ K, plant.B, K, 0.5, discrete=plant.discrete)
    return 1 / size, at


@pytest.mark.parametrize(("plant", "K"), CASES)
def test_it_is_the_disk_margin_of_a_linear_loop(plant, K):
    assert np.max(np.abs(np.linalg.eigvals(plant.A))) > 1 or np.max(np.linalg.eigvals(plant.A).real) > -0.2
    found = certify(plant, INC.linear(K), Margins())
    exact, _ = disk_margin(plant, K)
    assert 0.1 < exact < 2 and found.prove()
    assert exact * (1 - 3e-4) <= found.bound <= exact * (1 + 1e-9)
    assert certify(plant, INC.linear(K), Margins(0.999 * exact)).prove()
    assert not certify(plant, INC.linear(K), Margins(1.001 * exact)).holds()


def with_filter(plant, K, a, b, c, d):
    """The state matrix of the loop with the filter c (z - a)^{-1} b + d between K and the plant."""
    return np.block([[plant.A + d * plant.B @ K, c * plant.B], [b * K, np.array([[a]])]])


def test_all_passes_about_the_center_of_the_disk():
    """psi = c + r (1 - p z)/(z - p) lies on the disk's edge at every frequency, so its phase reaches the phase margin."""
    alpha, at = disk_margin(UNSTABLE, GAIN)
    largest = {}
    for factor in (0.999, 1.01):
        sector = InputSector.disk(factor * alpha)
        center, r = (sector.low + sector.high) / 2, (sector.high - sector.low) / 2
        # The worst phase at the critical frequency: (1 - p z)/(z - p) = -p + (1 - p^2)/(z - p).
        sensitivity = uncertain.response(UNSTABLE.A + center * UNSTABLE.B @ GAIN, UNSTABLE.B, GAIN, 0.0,
                                         uncertain.circle(4000))[:, 0, 0]
        i = int(np.argmax(np.abs(sensitivity)))
        critical = uncertain.all_pass(uncertain.circle(4000)[i], -np.angle(sensitivity[i]))
        radii = []
        for sign, p in [critical, *((s, p) for s in (1, -1) for p in np.linspace(-0.99, 0.99, 41))]:
            closed = with_filter(UNSTABLE, GAIN, p, 1.0, r * sign * (1 - p**2), center - r * sign * p)
            radii.append(np.max(np.abs(np.linalg.eigvals(closed))))
        largest[factor] = max(radii)
    assert largest[0.999] < 1 < largest[1.01] and abs(at) == pytest.approx(1)
    phase = InputSector.disk(alpha).phase
    assert phase == pytest.approx(np.degrees(2 * np.arctan(alpha / 2)))


def test_gains_to_the_ends_and_lags_to_the_phase_margin():
    alpha, _ = disk_margin(UNSTABLE, GAIN)
    sector = InputSector.disk(alpha)
    for gain in np.linspace(sector.low, sector.high, 31)[1:-1]:
        assert np.max(np.abs(np.linalg.eigvals(UNSTABLE.A + gain * UNSTABLE.B @ GAIN))) < 1
    theta = np.radians(np.linspace(0, sector.phase * (1 - 1e-9), 50))
    for turn in np.exp(-1j * theta):  # a pure phase at every frequency: a complex gain on the unit circle
        assert np.max(np.abs(np.linalg.eigvals(UNSTABLE.A + turn * UNSTABLE.B @ GAIN))) < 1


@pytest.mark.parametrize("dt", [1.0, 0.0])
def test_a_sector_from_zero_covers_every_first_order_lag(dt):
    # 1/(tau s + 1), and Tustin's lag (1 - a)/2 (z + 1)/(z - a), run on the circle with diameter [0, 1].
    rng = np.random.default_rng(61)
    plant = draws.plant(rng, n=2, m=1, p=2, dt=dt)
    K = 0.3 * rng.normal(size=(1, 2))
    found = certify(plant, INC.linear(K), Robust(Stability(), InputSector(0.0, 1.0)))
    assert found.prove() and "phase lag" in found.sentence
    inputs = Plant(plant.A, plant.B, np.eye(2), plant.dt)
    for slowness in np.logspace(-3, 3, 60):
        if dt:
            a = 1 - 2 / (1 + 10**3 * slowness)
            modes = np.linalg.eigvals(with_filter(inputs, K @ plant.C, a, 1.0, (1 - a) * (1 + a) / 2, (1 - a) / 2))
            assert np.max(np.abs(modes)) < 1
        else:
            modes = np.linalg.eigvals(with_filter(inputs, K @ plant.C, -1 / slowness, 1 / slowness, 1.0, 0.0))
            assert np.max(modes.real) < 0


def test_a_nonlinear_loop_forgives_gains_and_lags():
    rng = np.random.default_rng(62)
    plant = draws.plant(rng, n=2, m=1, p=2)
    inc = draws.controller(rng, m=1, p=2, norm=0.3, units=(ReLU(), ReLU(), Saturation()), gain=0.15)
    found = certify(plant, inc, Margins(), multiplier="relu")
    assert found.prove() and 0.1 < found.bound < 2
    sector, P = InputSector.disk(found.bound), found.values["P"]
    x0 = draws.points(rng, 2, 200)
    gains = rng.choice([sector.low, sector.high], size=(100, 200))
    x, _ = uncertain.varying(inc, x0, 100, lambda k: plant, lambda k, u: gains[k] * u)
    V = np.einsum("int,ij,jnt->nt", x, P, x)
    assert np.all(V[:, 1:] <= V[:, :-1] * (1 + 1e-9) + 1e-300)
    center, r = (sector.low + sector.high) / 2, (sector.high - sector.low) / 2
    for p in (-0.9, -0.3, 0.0, 0.5, 0.95):
        memory = np.zeros((1, 200))

        def lag(k, u, p=p):
            nonlocal memory
            passed, memory = (1 - p * p) * memory - p * u, p * memory + u
            return center * u + r * passed

        x, _ = uncertain.varying(inc, x0, 150, lambda k: plant, lag)
        assert np.all(np.linalg.norm(x[..., -1], axis=0) <= 1e-3 * (1 + np.linalg.norm(x0, axis=0)))


def test_it_is_a_robust_claim():
    loop, claim = close_loop(UNSTABLE, INC.linear(GAIN)), Margins(0.5)
    twin = Robust(Stability(), InputSector.disk(0.5))
    values, M = {"P": np.diag([2.0, 3.0]), "tau": np.array([4.0])}, {"decrease": np.diag([0.1, 0.2, 0.3])}
    mine, its = (what.conditions(what.graphs(loop, Sector()), values, M) for what in (claim, twin))
    assert set(mine) == set(its) and all(np.array_equal(mine[name], its[name]) for name in mine)
    assert claim.sentence(loop, values) == twin.sentence(loop, values)
    assert claim.merit(loop, values) == claim.bound(loop, values) == 0.5 and claim.yes_or_no and not claim.tunable
    assert Margins().tunable and not Margins().yes_or_no and Margins().at(0.3, loop).alpha == 0.3
    assert Margins().ceiling(loop) == 2.0 and Margins().bound(loop, values) == 0.0
    for alpha in (-0.1, 2.0, 2.5):
        with pytest.raises(InvalidInputError, match="alpha"):
            Margins(alpha)
