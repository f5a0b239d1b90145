"""Certificates of random loops, harmless to unstable, on every rung: what holds is true on trajectories.

Also with corrupted numbers, where a certificate is refused or still true. Motions and Lyapunov functions are computed
here from the loop's matrices alone.
"""

from dataclasses import replace

import multiplier_draws as md
import numpy as np
import oracles
import pytest

from inc_casadi import (
    INC,
    CenteredLogistic,
    Gaussian,
    Identity,
    LeakyReLU,
    Logistic,
    Plant,
    ReLU,
    Saturation,
    Tanh,
    close_loop,
)
from inc_casadi.claims import DeviationCost, Stability
from inc_casadi.errors import InvalidInputError
from inc_casadi.lmi_search import search
from inc_casadi.multipliers import LADDER, Lifted, Sector

UNITS = (ReLU(), LeakyReLU(0.3), Tanh(), Saturation(), CenteredLogistic(), Identity(), md.DEAD_ZONE, md.THREE, md.Lopsided())
ROUNDING = 1e-9  # of sums of a few hundred terms
RUNGE_KUTTA = 1e-5  # of 40 steps of 0.02 s
FEW = (*range(12), 14, 15, 17, 19, 20, 24, 25, 27, 30, 45, 47, 52)  # seeds of loops of every kind; five of them grow
SIZES = [(1, 2, 3, 2), (2, 1, 3, 4), (3, 2, 1, 2), (2, 3, 4, 1), (4, 1, 2, 3)]  # n, m, p, q


def drawn(seed):
    """A plant and a controller: all sizes different, gains from harmless to destabilizing, about half of them biased."""
    rng = np.random.default_rng(seed)
    n, m, p, q = SIZES[seed % len(SIZES)]
    dt, biased = (0.0 if seed % 3 == 2 else 1.0), bool(rng.random() < 0.4)
    A = rng.normal(size=(n, n))
    modes = np.linalg.eigvals(A)
    speed = rng.uniform(0.3, 1.1)
    A = A * speed / np.max(np.abs(modes)) if dt else A - (np.max(modes.real) + 2 * (1 - speed)) * np.eye(n)
    plant = Plant(A, rng.normal(size=(n, m)), rng.normal(size=(p, n)), dt)
    few = [UNITS[i] for i in rng.integers(len(UNITS), size=2)] + ([Logistic()] if biased and rng.random() < 0.3 else [])
    units = tuple(few[i] for i in rng.integers(len(few), size=q))
    W, gain = rng.normal(size=(q, q)), 10.0 ** rng.uniform(-2, 0.5)
    W *= 0.35 / np.abs(W).sum(axis=1).max()
    bias = (rng.normal(size=q), rng.normal(size=m)) if biased else (None, None)
    U, V, K = rng.normal(size=(q, p)), gain * rng.normal(size=(m, q)), 0.1 * gain * rng.normal(size=(m, p))
    return plant, INC(W, U, V, K, *bias, units), rng


def claim_for(plant, rng):
    """A cost in discrete time for every other loop, else a rate."""
    n, m = plant.n, plant.m
    if plant.discrete and rng.random() < 0.5:
        root = rng.normal(size=(n, n))
        return DeviationCost(
            np.diag(rng.exponential(size=n)), 0.1 * np.eye(m), rng.choice([0.8, 1.0]), Gaussian(np.ones(n), root @ root.T)
        )
    return Stability(rng.choice([0.85, 0.97, 0.999])) if plant.discrete else Stability(rng.choice([0.02, 0.3]))


def hidden(inc, y):
    """eta by Picard iteration until it moves by 1e-14 of its size: ||W|| = 0.35, and slopes are at most 1."""
    eta, fixed = np.zeros((inc.q, y.shape[1])), inc.U @ y + inc.b[:, None]
    kinds = [(unit, [i for i in range(inc.q) if inc.activations[i] == unit]) for unit in dict.fromkeys(inc.activations)]
    for _ in range(40):
        z, old = inc.W @ eta + fixed, eta
        eta = np.empty_like(z)
        with np.errstate(over="ignore"):  # 1 / (1 + exp(-z)) is 0 far to the left, as it should be
            for unit, rows in kinds:
                eta[rows] = oracles.phi(unit, z[rows])
        if np.max(np.abs(eta - old), initial=0.0) <= 1e-14 * np.max(np.abs(eta), initial=0.0):
            break
    return eta


def ahead_of(plant, inc, x):
    """A x + B u, with u and eta."""
    y = plant.C @ x
    eta = hidden(inc, y)
    u = inc.K @ y + inc.V @ eta + inc.d[:, None]
    return plant.A @ x + plant.B @ u, u, eta


def motions(plant, inc, x, steps, h=0.02):
    """x (n, N, steps + 1), u and eta; in continuous time by the classical Runge-Kutta method, h seconds apart."""
    found = []
    for _ in range(steps + 1):
        k1, u, eta = ahead_of(plant, inc, x)
        found.append((x, u, eta))
        if plant.discrete:
            x = k1
            continue
        k2 = ahead_of(plant, inc, x + h / 2 * k1)[0]
        k3 = ahead_of(plant, inc, x + h / 2 * k2)[0]
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + ahead_of(plant, inc, x + h * k3)[0])
    return tuple(np.stack(parts, axis=-1) for parts in zip(*found, strict=True))


def is_true(certificate, rng, steps=14):
    """Whether the promise of a certificate is seen on 40 motions about the equilibrium, or about other motions."""
    plant, inc, claim = certificate.plant, certificate.inc, certificate.claim
    x0 = rng.normal(size=(plant.n, 40)) * 10.0 ** rng.uniform(-1.5, 1.5, size=40)
    x, u, eta = motions(plant, inc, x0, steps)
    if inc.preserves_origin:
        rest = np.zeros((plant.n, 1, 1)), np.zeros((plant.m, 1, 1)), np.zeros((inc.q, 1, 1))
    elif certificate.multiplier == Sector() and not isinstance(claim, DeviationCost):
        rest = x[:, ::-1], u[:, ::-1], eta[:, ::-1]  # two motions
    else:
        rest = tuple(part[:, None, None] for part in at_rest(plant, inc))
    x, u, eta = x - rest[0], u - rest[1], eta - rest[2]
    ahead = certificate.multiplier.steps
    length = steps + 1 - ahead
    v = np.concatenate([x[..., :length], *(eta[..., k : k + length] for k in range(ahead))])
    V = oracles.quadratic(certificate.values["P"], v)
    floor = 1e-9 * np.abs(certificate.values["P"]).max() * (1e-9 + np.sum(rest[0] ** 2))  # deviations lose digits
    if np.any(V < -floor) or not np.all(np.isfinite(V)):
        return False
    if isinstance(claim, DeviationCost):
        return pays(certificate, x[..., :length], u[..., :length], V, floor)
    if plant.discrete:
        return bool(np.all(V[:, 1:] <= claim.rate**2 * V[:, :-1] * (1 + ROUNDING) + floor))
    return bool(np.all(V[:, 1:] <= np.exp(-0.02 * claim.rate) * V[:, :-1] * (1 + RUNGE_KUTTA) + floor))


def pays(certificate, x, u, V, floor):
    """Whether V pays for every step, and its bound for the whole."""
    claim = certificate.claim
    stage = oracles.quadratic(claim.Q, x) + oracles.quadratic(claim.R, u)
    P_0 = certificate.values.get("P_0", certificate.values["P"])
    bound = oracles.quadratic(P_0, x[..., 0])
    paid = stage @ claim.discount ** np.arange(x.shape[-1])
    steps = stage[:, :-1] + claim.discount * V[:, 1:] <= V[:, :-1] * (1 + ROUNDING) + floor
    return bool(
        np.all(steps)
        and np.all(paid <= bound * (1 + ROUNDING) + floor)
        and np.all(V[:, 0] <= bound * (1 + ROUNDING) + floor)
    )


def at_rest(plant, inc):
    """x*, u*, eta* where a certified loop comes to rest, or where Newton's method on differences says."""
    shift = plant.A - np.eye(plant.n) if plant.discrete else plant.A
    x = np.zeros(plant.n)
    for _ in range(30):

        def gap(x):
            return (shift - plant.A) @ x + ahead_of(plant, inc, x)[0]

        around = x[:, None] + 1e-7 * np.eye(plant.n)
        slope = (gap(around) - gap(x[:, None])) / 1e-7
        step = np.linalg.lstsq(slope, -gap(x[:, None])[:, 0], rcond=None)[0]
        sizes = 0.5 ** np.arange(25)
        x = x + sizes[np.argmin(np.linalg.norm(gap(x[:, None] + step[:, None] * sizes), axis=0))] * step
    _, u, eta = ahead_of(plant, inc, x[:, None])
    return x, u[:, 0], eta[:, 0]


def grows(plant, inc, rng):
    """Whether two motions of a loop get a thousand times further apart than they were."""
    x = rng.normal(size=(plant.n, 6))
    first = np.max(np.linalg.norm(x - x[:, ::-1], axis=0))
    for _ in range(6):
        x = motions(plant, inc, x, 6, h=0.15)[0][..., -1]
        if np.max(np.linalg.norm(x - x[:, ::-1], axis=0)) > 1e3 * first:
            return True
    return False


def certificates(seed):
    """The certificates of one random loop and claim, on every rung that applies."""
    plant, inc, rng = drawn(seed)
    claim, loop = claim_for(plant, rng), close_loop(plant, inc)
    if claim.obstacle(plant, inc):
        claim = Stability(0.97)  # no equilibrium to count a cost from
    more = (Lifted(2),) if seed % 3 == 0 else ()
    rungs = [rung for rung in (*LADDER, *more) if claim.refusal(loop, rung) is None]
    return [search(plant, inc, claim, rung) for rung in rungs]


def tally(seeds):
    """How many certificates hold by rung and kind of loop; every one of them is checked on motions."""
    counts = {}
    for seed in seeds:
        plant, inc, rng = drawn(seed)
        unstable = grows(plant, inc, rng)
        counts["growing"] = counts.get("growing", 0) + unstable
        for certificate in certificates(seed):
            if certificate.holds():
                assert is_true(certificate, rng), (seed, certificate.multiplier.name)
                assert not (unstable and isinstance(certificate.claim, Stability)), (seed, certificate.multiplier.name)
                for key in (
                    certificate.multiplier.name,
                    "discrete" if plant.discrete else "continuous",
                    "about the origin" if inc.preserves_origin else "biased",
                    type(certificate.claim).__name__,
                ):
                    counts[key] = counts.get(key, 0) + 1
    return counts


def test_what_holds_is_true_on_trajectories_and_what_diverges_is_never_certified():
    counts = tally(FEW)
    assert counts["growing"] >= 5, counts
    for key in (
        "sector",
        "slope",
        "relu",
        "lifted",
        "lifted 2",
        "discrete",
        "continuous",
        "about the origin",
        "biased",
        "Stability",
        "DeviationCost",
    ):
        assert counts[key] > 2, (key, counts)


@pytest.mark.slow
def test_what_holds_is_true_on_many_more_trajectories():
    tally([*range(60), *range(1000, 1400)])


def corruptions(certificate, rng):
    """Changes to a certificate: values scaled or flipped, one or all of a kind, another plant, controller or claim."""
    values = dict(certificate.values)
    for name, value in values.items():
        for factor in (-1.0, 0.5, 1.5, 0.0):
            yield {"values": {**values, name: factor * value}}
        if value.size:
            place = tuple(rng.integers(size) for size in value.shape)
            for moved in (-1.0, 0.0, 3.0):
                other = value.copy()
                other[place] *= moved
                other = (
                    np.triu(other) + np.triu(other, 1).T
                    if name in ("P", "P_0", "N", "N (positive)", "N (initial)")
                    else other
                )
                yield {"values": {**values, name: other}}
    plant, inc = certificate.plant, certificate.inc
    for size in (0.01, 0.1, 0.5):
        yield {"plant": Plant(plant.A + size * rng.normal(size=plant.A.shape), plant.B, plant.C, plant.dt)}
        yield {"plant": Plant(plant.A, plant.B * (1 + size), plant.C, plant.dt)}
        yield {"inc": replace(inc, V=inc.V * (1 + size), activation=inc.activations)}
        yield {"inc": replace(inc, W=inc.W + size * rng.normal(size=inc.W.shape), activation=inc.activations)}
    if isinstance(certificate.claim, Stability):
        faster = 0.7 if plant.discrete else 3.0
        yield {"claim": Stability(certificate.claim.rate * faster)}
    else:
        yield {"claim": replace(certificate.claim, Q=3.0 * certificate.claim.Q)}


def corrupted_tally(seeds):
    """How many corrupted certificates are refused, and how many hold, each of which is true."""
    refused = kept = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        for certificate in certificates(seed):
            if not certificate.holds():
                continue
            for changes in corruptions(certificate, rng):
                try:
                    corrupted = replace(certificate, **changes)
                except InvalidInputError:  # a controller that asks for other numbers
                    corrupted = None
                if corrupted is not None and corrupted.holds():
                    kept += 1
                    assert is_true(corrupted, rng), (seed, corrupted.multiplier.name)
                else:
                    refused += 1
    return refused, kept


def test_a_corrupted_certificate_is_refused_or_still_true():
    refused, kept = corrupted_tally(range(300, 304))
    assert refused > 100 and kept > 20, (refused, kept)


@pytest.mark.slow
def test_many_corrupted_certificates_are_refused_or_still_true():
    corrupted_tally(range(3000, 3050))
