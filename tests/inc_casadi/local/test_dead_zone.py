"""Generalized sectors: implicit laws, output feedback, mixed units, limits and rates, each sampled on trajectories."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import oracles
import pytest
from attraction_draws import TWO_STATES, falls, lqr, mixed, rim, unstable

from inc_casadi import INC, Box, Plant, Saturation, Tanh, close_loop
from inc_casadi.claims import Attraction
from inc_casadi.local.base import Setting
from inc_casadi.local.certify import certify_attraction
from inc_casadi.local.dead_zone import sector_between
from inc_casadi.local.lines import lines
from inc_casadi.local.rest import rest_of


def dead_zone(plant, inc, claim=None):
    return certify_attraction(plant, inc, claim or Attraction(), "dead zone")


def settles(plant, inc, found, rng, N=300, steps=80):
    """V along motions from just within the rim, and the motions."""
    x, u = oracles.roll_out(plant, inc, rim(found.ellipsoid, N, rng, 1 - 1e-9), steps)
    return oracles.quadratic(found.values["P"], x - found.ellipsoid.center[:, None, None]), x, u


def test_the_sector_is_nonnegative_wherever_the_auxiliary_law_is_small():
    rng = np.random.default_rng(1)
    plant = unstable(rng)
    inc = mixed(rng, plant)
    loop = close_loop(plant, inc)
    setting = Setting(loop, Attraction(), rest_of(loop))
    H, weights = rng.normal(size=(inc.q, plant.n)), rng.uniform(0.1, 1.0, inc.q)
    M = sector_between(setting, lines(setting), H, weights)
    e = rng.normal(size=(plant.n, 20000)) * 10.0 ** rng.uniform(-2, 1, 20000)
    room = lines(setting).room.astype(float)
    bent = lines(setting).bent
    small = np.all(np.abs(H @ e)[bent] <= room[bent, None], axis=0)
    x = setting.rest.center[:, None] + e
    eta = oracles.hidden(inc, x) - oracles.hidden(inc, setting.rest.center[:, None])
    values = oracles.quadratic(M, np.vstack([e, eta]))
    assert np.min(values[small]) >= -1e-9 and np.min(values[~small]) < -1e-3 and 500 < np.sum(small) < 19500


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_mixed_implicit_laws_settle_from_the_whole_ellipsoid(seed):
    rng = np.random.default_rng(seed)
    plant = unstable(rng)
    inc = mixed(rng, plant)
    found = dead_zone(plant, inc)
    assert found.holds() and found.prove("float") and found.prove("exact")
    V, _, _ = settles(plant, inc, found, rng)
    assert falls(V)


def test_output_feedback_with_a_rate_and_a_limit_within_the_saturation():
    rng = np.random.default_rng(4)
    plant = Plant([[1.05, 0.3], [0.0, 0.7]], [[0.5], [1.0]], [[1.0, 0.4]])
    inc = INC([[-0.6]], [[-0.6]], [[1.0]], [[0.0]], activation=Saturation())
    found = dead_zone(plant, inc, Attraction(Box([-0.8], [0.8]), rate=0.97))
    assert found.holds()
    V, _, u = settles(plant, inc, found, rng)
    assert falls(V, 0.97**2) and np.max(np.abs(u)) <= 0.8
    assert found.volume < dead_zone(plant, inc, Attraction(rate=0.97)).volume


def test_a_multiplier_of_well_posedness_is_stored_where_one_is_needed():
    inc = INC([[-9.0]], 10 * lqr(TWO_STATES), [[1.0]], [[0.0, 0.0]], activation=Saturation())
    found = dead_zone(TWO_STATES, inc)
    assert not inc.contraction.contracts and "T" in found.values and found.holds() and found.prove()


def test_curved_units_take_part_with_their_global_sector():
    rng = np.random.default_rng(7)
    gain = lqr(TWO_STATES)
    inc = INC(np.zeros((2, 2)), np.vstack([gain, 0.2 * gain]), [[1.0, 0.1]], [[0.0, 0.0]], activation=(Saturation(), Tanh()))
    found = dead_zone(TWO_STATES, inc)
    V, _, _ = settles(TWO_STATES, inc, found, rng)
    assert found.holds() and falls(V)


def test_continuous_time_with_a_rate():
    rng = np.random.default_rng(8)
    plant = Plant([[0.2, 1.0], [0.0, 0.1]], [[0.2], [1.0]], dt=0.0)
    inc = INC([[-0.5]], [[-1.5, -3.0]], [[1.0]], [[0.0, 0.0]], activation=Saturation())
    found = dead_zone(plant, inc, Attraction(rate=0.05))
    assert found.holds() and found.prove("exact")
    x = oracles.flow(plant, inc, rim(found.ellipsoid, 60, rng), 10.0, 200)
    V = oracles.quadratic(found.values["P"], x)
    assert np.all(V <= np.exp(-0.05 * np.linspace(0.0, 10.0, 201)) * V[:, :1] * (1 + 1e-9))
    assert found.volume < dead_zone(plant, inc).volume
    assert not replace(found, claim=Attraction(rate=0.5)).holds()


def test_an_ellipsoid_beyond_the_room_is_refused_though_its_decrease_scales_along():
    found = dead_zone(TWO_STATES, INC.saturated(lqr(TWO_STATES), 1.0))
    larger = {**found.values, "P": 0.99 * found.values["P"], "Lambda": 0.99 * found.values["Lambda"]}
    beyond = replace(found, values=larger)
    assert beyond.margins()["decrease"] > 0 > beyond.margins()["room of unit 0"]
    assert not beyond.prove("exact") and "room of unit 0" in beyond.reason


def test_the_cost_bound_holds_from_everywhere_in_the_ellipsoid():
    rng = np.random.default_rng(9)
    plant = unstable(rng)
    inc = mixed(rng, plant)
    Q, R = np.diag([1.0, 2.0, 0.5]), np.array([[0.4, 0.1], [0.1, 0.3]])
    found = dead_zone(plant, inc, Attraction(Q=Q, R=R, discount=0.95, rate=0.99))
    assert found.holds() and found.prove("float")
    _, x, u = settles(plant, inc, found, rng, steps=400)
    center = found.ellipsoid.center
    rest = oracles.control(inc, center[:, None])
    cost = oracles.discounted_cost(x - center[:, None, None], u - rest[:, :, None], Q, R, 0.95)
    bound = oracles.quadratic(found.values["P_cost"], x[:, :, 0] - center[:, None])
    assert np.all(cost <= bound) and np.max(cost / bound) > 0.3
