"""Polytopic claims: one inequality at each vertex, and the promise for every mixture, varying ones included."""

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
from inc_casadi.multipliers import Lifted, Sector

PLANT, OTHER = Plant([[0.5]], [[1.0]]), Plant([[0.6]], [[0.8]])
LAW = INC([[0.0]], [[2.0]], [[-0.3]], [[0.1]], activation=ReLU())


def test_conditions_by_hand():
    claim = Polytopic(Stability(0.5), (OTHER,))
    graphs = claim.graphs(close_loop(PLANT, LAW), Sector())
    assert list(graphs) == ["decrease", "decrease at vertex 1"]
    M = {"decrease": np.diag([0.1, 0.2]), "decrease at vertex 1": np.diag([0.3, 0.4])}
    found = claim.conditions(graphs, {"P": np.array([[2.0]])}, M)
    first, second = np.array([[0.6, -0.3]]), np.array([[0.68, -0.24]])
    assert set(found) == {"P", "decrease", "decrease at vertex 1"}
    np.testing.assert_allclose(found["decrease"], np.diag([0.5, 0.0]) - 2 * first.T @ first - M["decrease"])
    np.testing.assert_allclose(found["decrease at vertex 1"],
                               np.diag([0.5, 0.0]) - 2 * second.T @ second - M["decrease at vertex 1"])


def family(seed, spread=0.15):
    rng = np.random.default_rng(seed)
    plant = draws.plant(rng, n=2, m=1, p=2, radius=0.7)
    inc = draws.controller(rng, m=1, p=2, norm=0.3, units=(ReLU(), ReLU(), Saturation()), gain=0.15)
    others = tuple(Plant(plant.A + spread * rng.normal(size=(2, 2)), plant.B + spread * rng.normal(size=(2, 1)), plant.C)
                   for _ in range(2))
    return plant, inc, others, rng


def mixing(rng, plants, steps):
    """The plant of each step: vertices as often as random mixtures."""
    weights = rng.dirichlet(np.ones(len(plants)), size=steps)
    weights[::2] = np.eye(len(plants))[rng.integers(len(plants), size=len(weights[::2]))]
    mixed = [Plant(sum(w * p.A for w, p in zip(row, plants, strict=True)),
                   sum(w * p.B for w, p in zip(row, plants, strict=True)), plants[0].C) for row in weights]
    return lambda k: mixed[k]


@pytest.mark.parametrize("multiplier", ["sector", "slope", "relu"])
def test_rate_and_cost_hold_along_every_mixture(multiplier):
    plant, inc, others, rng = family(71)
    cost = DiscountedCost(np.diag([1.0, 0.4]), [[0.3]], 0.97, Box([-1, -1], [1, 1]))
    stable = certify(plant, inc, Polytopic(Stability(0.95), others), multiplier=multiplier).require()
    priced = certify(plant, inc, Polytopic(cost, others), multiplier=multiplier).require()
    assert stable.prove() and priced.prove()
    assert priced.bound >= certify(plant, inc, cost, multiplier=multiplier).bound
    x0 = draws.points(rng, 2, 100)
    for _ in range(4):
        x, u = uncertain.varying(inc, x0, 60, mixing(rng, (plant, *others), 60))
        V = oracles.quadratic(stable.values["P"], x)
        assert np.all(V[:, 1:] <= 0.95**2 * V[:, :-1] * (1 + 1e-9) + 1e-300)
        paid = oracles.discounted_cost(x[..., :-1], u, cost.Q, cost.R, cost.discount)
        assert np.all(paid <= oracles.quadratic(priced.values["P"], x0) * (1 + 1e-9))


def test_the_gain_holds_along_every_mixture_with_uncertain_actuators():
    plant, inc, others, rng = family(72, 0.1)
    found = certify(plant, inc, Polytopic(Robust(L2Gain(np.eye(2)), InputSector(0.7, 1.2)), others)).require()
    assert found.prove()
    for _ in range(5):
        at, w = mixing(rng, (plant, *others), 80), rng.normal(size=(2, 50, 80))
        gains, x, energy = rng.choice([0.7, 1.2], size=(80, 50)), np.zeros((2, 50)), 0.0
        for k in range(80):
            energy = energy + np.sum(x**2, axis=0)
            x = at(k).A @ x + at(k).B @ (gains[k] * oracles.control(inc, plant.C @ x)) + w[..., k]
        assert np.all(energy <= found.bound**2 * np.sum(w**2, axis=(0, 2)) * (1 + 1e-9))


def test_it_is_tight_for_two_scalar_loops_and_knows_each_vertex():
    # x+ = a x, a in {0.5, 0.8}: the best rate is the slower one's, whichever plant is called the first.
    law = INC.linear([[0.0]])
    for plant, other in ((0.5, 0.8), (0.8, 0.5), (0.5, -0.8)):
        found = certify(Plant([[plant]], [[1.0]]), law, Polytopic(Stability(), (Plant([[other]], [[1.0]]),)))
        assert found.prove() and 0.8 <= found.bound < 0.8001
        found = certify(Plant([[plant]], [[1.0]]), law, Polytopic(L2Gain([[1.0]]), (Plant([[other]], [[1.0]]),)))
        assert found.bound == pytest.approx(5.0, rel=1e-5)


def test_stable_vertices_with_an_unstable_mixture_are_refused():
    """Each vertex is nilpotent, but half of each has the spectral radius 1.5: no common function may be found."""
    one, two = Plant([[0.0, 3.0], [0.0, 0.0]], [[0.0], [1.0]]), Plant([[0.0, 0.0], [3.0, 0.0]], [[0.0], [1.0]])
    law = INC.linear([[0.0, 0.0]])
    for plant in (one, two):
        assert certify(plant, law, Stability(0.9)).holds()
    found = certify(one, law, Polytopic(Stability(0.99), (two,)))
    assert not found.holds() and not found.prove()


def test_continuous_time_mixtures():
    plants = [Plant(A, [[0.0], [1.0]], dt=0) for A in ([[-1.0, 0.5], [0.0, -2.0]], [[-1.0, -0.5], [0.3, -1.5]])]
    law = INC([[0.0]], [[1.0, 0.5]], [[-0.3]], [[0.0, 0.0]])
    found = certify(plants[0], law, Polytopic(Stability(), (plants[1],))).require()
    assert found.prove() and found.bound > 1
    for part in np.linspace(0, 1, 5):
        mixed = Plant(part * plants[0].A + (1 - part) * plants[1].A, plants[0].B, dt=0)
        x = oracles.flow(mixed, law, np.random.default_rng(1).normal(size=(2, 20)), 2.0, 100)[..., ::10]
        V = oracles.quadratic(found.values["P"], x)
        assert np.all(V <= np.exp(-found.bound * np.linspace(0, 2, 11)) * V[:, :1] * (1 + 1e-6))


def test_what_it_refuses():
    with pytest.raises(InvalidInputError, match="plants is empty"):
        Polytopic(Stability(), ())
    for claim in (Polytopic(Stability(), (OTHER,)), Together((Stability(0.9), Stability(0.8))), "stable"):
        with pytest.raises(InvalidInputError, match="must be a Claim about one plant"):
            Polytopic(claim, (OTHER,))
    with pytest.raises(DimensionError, match=r"vertex 2 has sizes \(n, m, p\) = \(1, 2, 1\)"):
        Polytopic(Stability(), (OTHER, Plant([[0.5]], [[1.0, 2.0]]))).check(PLANT, LAW)
    for other in (Plant([[0.5]], [[1.0]], [[2.0]]), Plant([[0.5]], [[1.0]], dt=0.5)):
        with pytest.raises(InvalidInputError, match="vertex 1 has another C or dt"):
            Polytopic(Stability(), (other,)).check(PLANT, LAW)
    with pytest.raises(InvalidInputError, match="polytopic claim cannot be made: it is about the origin"):
        certify(PLANT, INC([[0.0]], [[2.0]], [[-0.3]], [[0.1]], b=[1.0]), Polytopic(Stability(), (OTHER,)))
    with pytest.raises(InvalidInputError, match="rate = 1 is outside"):
        Polytopic(Stability(1.0), (OTHER,)).check(PLANT, LAW)
    refusal = Polytopic(Stability(), (OTHER,)).refusal(close_loop(PLANT, LAW), Lifted())
    assert "must depend on x alone" in refusal


def test_an_open_level_is_tuned_for_all_vertices():
    loop, claim = close_loop(PLANT, LAW), Polytopic(Margins(), (OTHER,))
    assert claim.tunable and claim.at(0.3, loop).claim.alpha == 0.3 and claim.at(0.3, loop).plants == claim.plants
    assert claim.ceiling(loop) == 2.0 and claim.compound and not claim.yes_or_no
    found = certify(PLANT, LAW, claim, multiplier="sector")
    each = [certify(plant, LAW, Margins(), multiplier="sector").bound for plant in (PLANT, OTHER)]
    assert found.prove() and 0 < found.bound <= min(each) * (1 + 1e-4)
