"""Ellipsoids of attraction of saturated loops: published volumes, scale laws, equal laws, and trajectories.

Volumes: `saturated_plants.json` holds what three methods gave for u = sat(Kx) on plants from the literature (Bemporad et
al. 2002, Yin et al. 2022, Wang and Boyd 2010, and others). A figure there is what a solver returned, unchecked, so it may be
off by what the solver left open: for the vehicle its sector figure exceeds its convex-hull figure, which cannot be. Ours are
proved, so a smaller one is a failure of the search, and a larger one shows that theirs was not the optimum.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import oracles
import pytest
from attraction_draws import TWO_STATES, falls, lqr, rim
from reference import reference

from inc_casadi import INC, Box, Plant, Saturation
from inc_casadi.claims import Attraction
from inc_casadi.local.certify import certify_attraction

NAMES = ("DI_reachsdp", "PENDULUM_yin_linear", "VEHICLE_yin", "CARTPOLE_wang2022", "BALANCING_POINTER_ct",
         "WANG_BOYD_masses")
COLUMNS = {"linear": "nonsaturating", "convex hull": "convex_hull", "dead zone": "sector_LMI"}
LARGER = {("VEHICLE_yin", "convex hull"): 2e-3}  # the figure there is 1.5e-3 below what is proved here, by two methods
LONG = [("convex hull", "WANG_BOYD_masses"), ("dead zone", "WANG_BOYD_masses")]
SATURATED = INC.saturated(lqr(TWO_STATES, 0.98, 0.05), 1.0)


def published(name):
    """Plant, law, limits and the entry of a published plant."""
    entry = next(plant for plant in reference("saturated_plants.json")["plants"] if plant["name"] == name)
    A, B = (np.array(entry.get(f"{part}_zoh", entry[part])) for part in "AB")
    limits = np.array(entry["umax"])
    law = INC.saturated(np.array(entry["K_used_for_ROA"]), limits)
    return Plant(A, B, dt=entry["Ts"] or 1.0), law, Box(-limits, limits), entry


def certified(plant, law, method, **claim):
    found = certify_attraction(plant, law, Attraction(**claim), method)
    assert found.holds() and found.prove("float"), found.reason
    return found


@pytest.mark.parametrize(("method", "name"), [
    pytest.param(method, name, marks=[pytest.mark.slow] * ((method, name) in LONG)) for method in COLUMNS for name in NAMES])
def test_certified_volumes_equal_the_published_ones(name, method):
    plant, law, limits, entry = published(name)
    found = certified(plant, law, method, inputs=limits)
    figure = entry[f"ellipsoid_volume_{COLUMNS[method]}"]
    assert figure * (1 - 1e-3) < found.volume < figure * (1 + LARGER.get((name, method), 1e-3))


@pytest.mark.parametrize("name", ["PENDULUM_yin_linear", "CARTPOLE_wang2022", "BALANCING_POINTER_ct"])
def test_no_certified_region_leaves_what_any_bounded_input_can_steer(name):
    plant, law, _, entry = published(name)
    assert entry["null_controllable_bounds_dt"]
    for method in COLUMNS:
        ellipsoid = certified(plant, law, method).ellipsoid
        for bound in entry["null_controllable_bounds_dt"]:
            assert ellipsoid.support(np.array(bound["left_eigvec"])) < bound["bound_abs_vTx_lt"]


@pytest.mark.parametrize("method", ["convex hull", "dead zone", "polytope"])
def test_the_two_state_box_fits_1_052_times(method):
    corners = 0.8 * np.array([[1.0, 1.0], [1.0, -1.0]])
    found = certified(TWO_STATES, SATURATED, method, inputs=Box([-1], [1]), directions=corners)
    assert found.bound == pytest.approx(1.052, abs=5e-4)


@pytest.mark.parametrize("method", ["linear", "convex hull", "dead zone", "polytope"])
def test_trajectories_from_the_rim_fall_and_those_of_a_larger_ellipsoid_are_not_certified(method):
    rng = np.random.default_rng(11)
    found = certified(TWO_STATES, SATURATED, method, inputs=Box([-1], [1]))
    x, u = oracles.roll_out(TWO_STATES, SATURATED, rim(found.ellipsoid, 1000, rng, 1 - 1e-9), 200)
    assert falls(oracles.quadratic(found.values["P"], x)) and np.max(np.abs(u)) <= 1.0
    larger = replace(found, values={**found.values, "P": found.values["P"] * (1 - 1e-4)})
    assert not larger.holds() and not larger.prove()


@pytest.mark.parametrize("method", ["linear", "convex hull", "dead zone"])
def test_volumes_scale_with_the_limit_to_the_power_of_the_dimension(method):
    plant = Plant([[1.05, 0.4, 0.0], [0.0, 0.95, 0.3], [0.1, 0.0, 0.9]], [[0.0], [0.3], [1.0]])
    one, three = (certified(plant, INC.saturated(lqr(plant), limit), method).volume for limit in (1.0, 3.0))
    assert three == pytest.approx(27 * one, rel=1e-4)


@pytest.mark.parametrize("method", ["convex hull", "dead zone"])
def test_volumes_follow_a_change_of_coordinates(method):
    T = np.array([[3.0, 1.0], [0.0, 0.2]])
    turned = Plant(T @ TWO_STATES.A @ np.linalg.inv(T), T @ TWO_STATES.B)
    law = INC.saturated(lqr(TWO_STATES, 0.98, 0.05) @ np.linalg.inv(T), 1.0)
    wanted = certified(TWO_STATES, SATURATED, method).volume * abs(np.linalg.det(T))
    assert certified(turned, law, method).volume == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize("share", [-1.0, 0.5, 0.9])
def test_one_law_written_with_hidden_feedback_has_one_region(share):
    # u = sat(v), v = K1 x + K2 (v - sat(v)) is sat(K1 x) for every K2 < 1: W = -K2 / (1 - K2), U = K1 / (1 - K2).
    gain = lqr(TWO_STATES, 0.98, 0.05)
    implicit = INC([[-share / (1 - share)]], gain / (1 - share), [[1.0]], [[0.0, 0.0]], activation=Saturation())
    points = np.random.default_rng(1).normal(size=(2, 50)) * 3
    assert implicit(points) == pytest.approx(SATURATED(points), abs=1e-9)
    wanted = certified(TWO_STATES, SATURATED, "convex hull").volume
    assert certified(TWO_STATES, implicit, "dead zone").volume == pytest.approx(wanted, rel=1e-4)


def test_idle_units_change_nothing():
    W, U = np.array([[0.0, 0.0], [0.4, 0.3]]), np.vstack([SATURATED.U, [[1.0, -2.0]]])
    idle = INC(W, U, [[SATURATED.V.item(), 0.0]], SATURATED.K, activation=Saturation())
    wanted = certified(TWO_STATES, SATURATED, "dead zone").volume
    assert certified(TWO_STATES, idle, "dead zone").volume == pytest.approx(wanted, rel=1e-3)


def test_the_cost_bound_on_the_region_exceeds_every_simulated_cost():
    rng = np.random.default_rng(12)
    Q, R = np.eye(2), np.array([[0.05]])
    found = certified(TWO_STATES, SATURATED, "convex hull", Q=Q, R=R, discount=0.98, rate=0.97)
    x, u = oracles.roll_out(TWO_STATES, SATURATED, found.ellipsoid.sample(1000, rng), 400)
    cost, bound = oracles.discounted_cost(x, u, Q, R, 0.98), oracles.quadratic(found.values["P_cost"], x[:, :, 0])
    assert np.all(cost <= bound) and np.mean(cost) > 0.25 * np.mean(bound)
