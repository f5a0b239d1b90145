"""Products with half-spaces: sampled on the region, never below the generalized sector, above it on mixed loops."""

from __future__ import annotations

import numpy as np
import oracles
import pytest
from attraction_draws import TWO_STATES, falls, lqr, mixed, rim, unstable

from inc_casadi import INC, Box, Plant, ReLU, close_loop
from inc_casadi.claims import Attraction
from inc_casadi.local.base import Setting
from inc_casadi.local.certify import certify_attraction
from inc_casadi.local.checks import first_failing, signs_hold
from inc_casadi.local.polytope import PolytopeRows, regional
from inc_casadi.local.rest import rest_of
from inc_casadi.multipliers import Relu
from inc_casadi.multipliers.atoms import all_atoms


def test_the_products_are_nonnegative_on_the_region_and_not_beyond():
    rng = np.random.default_rng(2)
    plant = unstable(rng, n=2)
    inc = mixed(rng, plant)
    loop = close_loop(plant, inc)
    setting = Setting(loop, Attraction(states=Box([-2.0, -1.5], [1.0, 2.5])), rest_of(loop))
    F = rng.normal(size=(4, 2))
    wide = regional(setting, F)
    values = {}
    for unknown in Relu().unknowns(wide):
        drawn = rng.uniform(0.0, 1.0, size=unknown.shape) * unknown.free
        values[unknown.name] = 1e-2 * (drawn + drawn.T) if unknown.is_symmetric else drawn
    products = values["N_g"] @ np.array(wide.parts.g_rest, dtype=float)
    partner = np.array(wide.parts.g_rest, dtype=float)[np.maximum(wide.parts.partner, 0)]
    values["w"] = np.where(wide.parts.partner >= 0, products / partner, 0.0)
    M = Relu().matrix(wide, values)
    e = rng.normal(size=(2, 30000)) * 10.0 ** rng.uniform(-1.5, 0.7, 30000)
    center = setting.rest.center[:, None]
    z = inc.W @ oracles.hidden(inc, center + e) + inc.U @ (center + e) + inc.b[:, None]
    stack = [e, oracles.hidden(inc, center + e) - oracles.hidden(inc, center)]
    resting = (inc.W @ oracles.hidden(inc, center) + inc.U @ center + inc.b[:, None])
    for row, atoms in all_atoms(wide):
        for _ in range(atoms.extras):  # a saturation's further length: of z past the upper kink
            stack.append((np.maximum(z[row] - 1, 0) - np.maximum(resting[row] - 1, 0))[None])
    form = oracles.quadratic(M, np.vstack(stack))
    inside = np.all(np.abs(F @ e) <= 1, axis=0) & setting.claim.states.contains(center + e)
    assert np.min(form[inside]) >= -1e-9 and np.min(form[~inside]) < -1e-2 and 1000 < np.sum(inside) < 29000


@pytest.mark.parametrize("seed", [6, pytest.param(0, marks=pytest.mark.slow)])
def test_it_is_no_smaller_than_the_generalized_sector_and_settles(seed):
    rng = np.random.default_rng(seed)
    plant = unstable(rng, n=2)
    inc = mixed(rng, plant)
    found = certify_attraction(plant, inc, Attraction(), "polytope")
    weaker = certify_attraction(plant, inc, Attraction(), "dead zone")
    assert found.holds() and found.prove("exact") and found.volume > weaker.volume * (1 - 1e-3)
    x, _ = oracles.roll_out(plant, inc, rim(found.ellipsoid, 300, rng, 1 - 1e-9), 60)
    V = oracles.quadratic(found.values["P"], x - found.ellipsoid.center[:, None, None])
    assert falls(V)


def test_limits_and_cost_on_the_region():
    rng = np.random.default_rng(3)
    law = INC.saturated(lqr(TWO_STATES), 1.0)
    claim = Attraction(Box([-0.8], [0.8]), Box([-1.0, -1.0], [1.0, 1.0]), np.eye(2), [[0.1]], 0.9, 0.99)
    found = certify_attraction(TWO_STATES, law, claim, "polytope")
    assert found.holds() and found.prove("float")
    x, u = oracles.roll_out(TWO_STATES, law, rim(found.ellipsoid, 300, rng), 200)
    assert np.all(np.abs(u) <= 0.8) and np.all(np.abs(x) <= 1.0)
    cost = oracles.discounted_cost(x, u, np.eye(2), np.array([[0.1]]), 0.9)
    bound = oracles.quadratic(found.values["P_cost"], x[:, :, 0])
    assert np.all(cost <= bound) and np.max(cost / bound) > 0.5


@pytest.mark.parametrize("name", ["N", "N_g", "w"])
def test_a_weight_of_the_wrong_sign_is_refused_by_either_arithmetic(name):
    setting = Setting(loop := close_loop(TWO_STATES, INC.saturated(lqr(TWO_STATES), 1.0)), Attraction(), rest_of(loop))
    values = PolytopeRows().search(setting)
    unknown = next(one for one in PolytopeRows().unknowns(setting) if one.name == name)
    wrong = values[name] - 1e3 * (unknown.signed if unknown.signed.any() else unknown.free)
    for given, wanted in ((values[name], True), (wrong, False)):
        mixed_up = {**values, name: given}
        assert signs_hold(PolytopeRows(), setting, mixed_up, exactly=True) is wanted
        assert signs_hold(PolytopeRows(), setting, mixed_up, exactly=False) is wanted
    assert "nonnegative" in first_failing(PolytopeRows(), setting, {**values, name: wrong})


def test_what_it_has_nothing_to_offer_for_is_refused():
    kink = INC([[0.0]], [[1.0]], [[-1.0]], [[0.0]], activation=ReLU())
    assert "rests off it" in certify_attraction(Plant([[1.5]], [[1.0]]), kink, Attraction(), "polytope").reason
    setting = Setting(loop := close_loop(Plant([[1.5]], [[1.0]]), kink), Attraction(), rest_of(loop))
    assert PolytopeRows().applies(setting)
