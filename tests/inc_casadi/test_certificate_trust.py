"""Who may say yes: floats never before fractions do, and no corrupted number of any claim."""

from dataclasses import replace

import draws
import numpy as np
import pytest

from inc_casadi import (
    INC,
    Box,
    DeviationCost,
    DiscountedCost,
    Gaussian,
    InputSector,
    L2Gain,
    LeakyReLU,
    Margins,
    NormBounded,
    Plant,
    Polytopic,
    ReLU,
    Robust,
    Saturation,
    Stability,
    Tanh,
    Together,
    close_loop,
)
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.inequalities import Inequalities
from inc_casadi.lmi_search import search
from inc_casadi.multipliers import LADDER, Lifted, Sector

COST = DiscountedCost([[1.0]], [[0.5]], 0.95, Box([-1.0], [1.0]))
PLANT, OTHER = Plant([[0.5]], [[1.0]]), Plant([[0.55]], [[0.9]])
LAW = INC([[0.2, 0.1], [-0.1, 0.3]], [[1.0], [0.7]], [[-0.3, 0.2]], [[0.1]], activation=(ReLU(), ReLU()))
BIASED = INC([[0.2, 0.1], [-0.1, 0.3]], [[1.0], [0.7]], [[-0.3, 0.2]], [[0.1]], b=[0.5, -0.2], activation=(ReLU(), ReLU()))
CLAIMS = {
    "stable": Stability(0.9), "cost": COST, "gain": L2Gain([[1.0]], D_u=[[0.3]]), "margins": Margins(0.3),
    "norm": Robust(COST, NormBounded([[0.2]], [[1.0]], [[0.3]])), "sector": Robust(L2Gain([[1.0]]), InputSector(0.7, 1.3)),
    "polytope": Polytopic(L2Gain([[1.0]]), (OTHER,)),
    "together": Together((Stability(0.9), COST, L2Gain([[1.0]], gain=9.0))),
    "deviation": DeviationCost([[1.0]], [[0.5]], 0.95, Box([-1.0], [1.0])),
}


def judged(certificate):
    """The exact verdict, after checking that no other judge contradicts it."""
    exact = bool(certificate.prove("exact"))
    assert certificate.holds() == exact and bool(certificate.prove()) == exact
    assert exact or not (certificate.surely() or certificate.surely(24) or certificate.prove("float"))
    return exact


def scalar(rng):
    """A stable scalar loop with one ReLU and the smallest P and best Lambda known by hand, up to the rounding of floats.

    x+ = a x + v eta, eta = relu(x): rho^2 X'PX - F'PF - M = [(rho^2 - a^2) P, -a v P - l; ., 2 l - v^2 P] is singular
    at rho^2 = a^2 + (l + a v P)^2 / ((2 l - v^2 P) P).
    """
    a, v = rng.uniform(0, 0.6), rng.uniform(-0.5, 0.5)
    P = 10.0 ** rng.uniform(-6, 6)
    l = P * abs(v) * rng.uniform(0.6, 2.0)
    rho = np.sqrt(a**2 + (l + a * v * P) ** 2 / ((2 * l - v**2 * P) * P)) if 2 * l > v**2 * P else 0.9
    return a, v, P, l, rho


@pytest.mark.slow
def test_floats_never_say_yes_before_fractions_do():
    rng, counts = np.random.default_rng(1), {True: 0, False: 0}
    undecided = 0
    for _ in range(600):
        a, v, P, l, rho = scalar(rng)
        rho = float(np.clip(rho * (1 + rng.choice([0, 1, -1]) * 2.0 ** -rng.integers(40, 54)), 0.0, 0.999))
        certificate = MatrixCertificate(Plant([[a]], [[1.0]]), INC([[0.0]], [[1.0]], [[v]], [[0.0]]),
                                        Stability(rho), "sector", {"P": [[P]], "Lambda": [l]})
        sure, exact = certificate.surely(), bool(certificate.prove("exact"))
        assert exact or not sure
        assert certificate.surely(24) == exact
        undecided += exact and not sure
        counts[exact] += 1
    assert counts[True] > 100 and counts[False] > 100 and undecided > 10


@pytest.mark.parametrize("multiplier", LADDER, ids=lambda multiplier: multiplier.name)
def test_holds_is_what_fractions_say_on_random_certificates(multiplier):
    rng, verdicts = np.random.default_rng(2), []
    for name in ("stable", "cost", "gain", "norm"):
        good = search(PLANT, LAW, CLAIMS[name], multiplier)
        for _ in range(12):
            size = 10.0 ** rng.uniform(-16, 0)
            values = {}
            for unknown in Inequalities(good.loop, good.claim, multiplier).unknowns:
                noise = size * rng.normal(size=unknown.shape)
                value = good.values[unknown.name] * (1 + (noise + noise.T if unknown.is_symmetric else noise))
                values[unknown.name] = np.where(unknown.free, value, 0.0)
            verdicts.append(judged(replace(good, values=values)))
    assert 5 < sum(verdicts) < len(verdicts) - 5


@pytest.mark.parametrize("multiplier", [Sector(), Lifted()])
@pytest.mark.parametrize("name", CLAIMS)
def test_corrupted_numbers_of_every_claim_are_refused(name, multiplier):
    claim, law = CLAIMS[name], BIASED if name == "deviation" else LAW
    if claim.refusal(close_loop(PLANT, law), multiplier):
        pytest.skip(claim.refusal(close_loop(PLANT, law), multiplier))
    good = search(PLANT, law, claim, multiplier)
    assert judged(good)
    refused = 0
    for key, value in good.values.items():
        for factor in (-1.0, 0.0, 0.98):
            worse = replace(good, values={**good.values, key: factor * value})
            yes = judged(worse)
            refused += not yes
            assert not yes or key != "P" or factor > 0
    # Every claim's own figure is tight, so that less of it fails.
    for key in ("gain^2", "P_0"):
        if key in good.values:
            assert not judged(replace(good, values={**good.values, key: 0.99 * good.values[key]}))
    assert refused >= 3


@pytest.mark.parametrize(("name", "weaker"), [
    ("gain", L2Gain([[1.1]], D_u=[[0.3]])), ("gain", L2Gain([[1.0]], C_e=[[1.1]], D_u=[[0.3]])),
    ("gain", L2Gain([[1.0]], D_u=[[9.0]])),
    ("margins", Margins(1.5)), ("norm", Robust(COST, NormBounded([[0.2]], [[1.0]], [[0.3]], size=1.1))),
    ("norm", Robust(COST, NormBounded([[0.22]], [[1.0]], [[0.3]]))),
    ("norm", Robust(COST, NormBounded([[0.2]], [[1.1]], [[0.3]]))),
    ("norm", Robust(COST, NormBounded([[0.2]], [[1.0]], [[3.0]]))),
    ("sector", Robust(L2Gain([[1.0]]), InputSector(0.7, 2.0))),
    ("sector", Robust(L2Gain([[1.0]]), InputSector(0.1, 1.3))),
    ("polytope", Polytopic(L2Gain([[1.0]]), (Plant([[0.7]], [[1.0]]),))),
    ("together", Together((Stability(0.3), COST, L2Gain([[1.0]], gain=9.0)))),
    ("together", Together((Stability(0.9), COST, L2Gain([[1.0]], gain=1.0)))),
    ("together", Together((Stability(0.9), replace(COST, Q=np.array([[1.1]])), L2Gain([[1.0]], gain=9.0)))),
    ("deviation", DeviationCost([[1.1]], [[0.5]], 0.95, Box([-1.0], [1.0]))),
])
def test_numbers_of_one_claim_do_not_prove_a_stronger_one(name, weaker):
    good = search(PLANT, BIASED if name == "deviation" else LAW, CLAIMS[name], Sector())
    assert judged(good) and not judged(replace(good, claim=weaker))


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_what_is_found_can_be_proved(seed):
    """Random problems over three decades of gain, the edges of what is feasible among them."""
    rng = np.random.default_rng(seed)
    plant = draws.plant(rng, n=2, m=1, p=2, radius=rng.uniform(0.3, 0.95))
    inc = draws.controller(rng, m=1, p=2, units=(ReLU(), Saturation(), Tanh(), LeakyReLU(0.2)),
                           gain=10.0 ** rng.uniform(-2, 0))
    cost = DiscountedCost(np.diag([1.0, 0.3]), [[0.2]], rng.uniform(0.8, 1.0), Gaussian(np.zeros(2), np.eye(2)))
    for multiplier in LADDER:
        best = search(plant, inc, Stability(), multiplier)
        found = [best, search(plant, inc, cost, multiplier)]
        if best.holds():  # near its edge a rate is barely feasible
            edge = Stability(min(best.bound * (1 + 1e-6), 0.9999999))
            found.append(search(plant, inc, edge, multiplier))
        for certificate in found:
            assert certificate.holds() == bool(certificate.prove())
            assert certificate.surely() <= certificate.holds()


def test_a_large_certificate_is_proved_both_ways():
    rng = np.random.default_rng(3)
    plant = draws.plant(rng, n=10, m=2, p=10, radius=0.8)
    inc = draws.controller(rng, m=2, p=10, units=(ReLU(), Tanh(), Saturation(), ReLU()) * 16, gain=0.002)
    found = search(plant, inc, Stability(0.97), Sector())
    fast, exact = replace(found).prove("float"), replace(found).prove("exact")  # afresh: nothing is remembered
    assert fast and exact
    print(f"(10, 64) sector certificate: float {fast.seconds:.3f} s, exact {exact.seconds:.3f} s")
