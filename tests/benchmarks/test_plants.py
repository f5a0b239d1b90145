"""The suite: plants as published, posed so that limits matter and no start is lost."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
from reference import reference

from benchmarks.baselines.estimated import saturated_lqg
from benchmarks.plants import (
    Case,
    aircraft,
    compleib,
    compleib_larger,
    drives,
    oscillators,
    pendulums,
    suite,
    tanks,
    textbook,
    vehicles,
)
from inc_casadi import INC, Box, simulate
from inc_casadi.bounds import uncontrollable_vertex
from inc_casadi.dynamic import extended
from inc_casadi.linear.regulator import discounted_lqr

CASES = suite()
NAMES = list(CASES)
COMPLEIB = compleib.cases().keys() | compleib_larger.cases().keys()
PUBLISHED = {"two lags, output": "BEMPORAD2002_ex1", "double integrator": "DI_reachsdp", "car, output": "VEHICLE_yin",
             "pendulum, output": "PENDULUM_yin_linear", "cart and pole": "CARTPOLE_wang2022",
             "pointer": "BALANCING_POINTER_ct"}


def test_the_suite_is_as_wide_as_it_is_meant_to_be():
    sizes = [(case.plant.n, case.plant.m) for case in CASES.values()]
    assert len(CASES) >= 29 and {m for _, m in sizes} >= {1, 2, 3, 4}
    assert {n for n, _ in sizes} >= {1, 2, 3, 4, 5, 6, 7, 8, 9, 12}
    measured = [case.plant.full_state for case in CASES.values()]
    assert sum(measured) >= 10 and sum(not full for full in measured) >= 10
    radii = [np.max(np.abs(np.linalg.eigvals(case.plant.A))) for case in CASES.values()]
    assert min(radii) < 0.95 and sum(radius > 1.01 for radius in radii) >= 5


@pytest.mark.parametrize("name", NAMES)
def test_a_case_is_discrete_sourced_and_no_start_is_lost(name: str):
    plant, spec, source = CASES[name]
    assert plant.discrete and source and spec.check(plant) is spec
    assert isinstance(spec.inputs, Box) and uncontrollable_vertex(plant, spec) is None
    assert name.endswith(", output") != plant.full_state or name in COMPLEIB
    assert np.all(spec.inputs.lower < 0) and np.all(spec.inputs.upper > 0)


@pytest.mark.parametrize("name", NAMES)
def test_inputs_reach_and_measurements_show_all_that_is_unstable(name: str):
    plant = CASES[name].plant
    assert not plant.unstabilizable_modes() and not plant.undetectable_modes()


@pytest.mark.parametrize("name", NAMES)
def test_the_regulator_meets_the_limits_from_some_start_and_clipped_comes_to_rest(name: str):
    plant, spec, _ = CASES[name]
    K, _ = discounted_lqr(plant, spec)
    assert np.max(np.abs(np.linalg.eigvals(plant.A + plant.B @ K))) < 1
    starts = spec.initial.vertices
    assert isinstance(spec.inputs, Box)
    wanted = K @ starts
    assert np.max(np.maximum(wanted / spec.inputs.upper[:, None], wanted / spec.inputs.lower[:, None])) > 1.2
    seen = type(plant)(plant.A, plant.B, dt=plant.dt)
    law = INC.linear(K).with_saturated_output(spec.inputs)
    last = settled(seen, law, starts)
    assert np.max(np.abs(last)) < 0.05 * np.max(np.abs(starts))


def settled(plant, law: INC, x: np.ndarray, steps: int = 4000) -> np.ndarray:
    """The states after so many steps, without the way there."""
    near = 0.01 * np.max(np.abs(x))  # where nothing is clipped any more, and the loop is linear and stable
    for _ in range(steps // 50):
        x = simulate(plant, law, x, steps=50).x[..., -1]
        if np.max(np.abs(x)) < near:
            break
    return x


@pytest.mark.parametrize("name", [name for name in NAMES if not CASES[name].plant.full_state])
def test_no_start_is_lost_to_who_estimates_the_state(name: str):
    case = CASES[name]
    law = saturated_lqg(case)
    wide, static = extended(case.plant, law)
    starts = case.spec.initial.vertices
    begun = np.vstack([starts, np.repeat(law.xi_0[:, None], starts.shape[1], axis=1)])
    last = settled(wide, static, begun)[: case.plant.n]
    assert np.max(np.abs(last)) < 0.05 * np.max(np.abs(starts))


@pytest.mark.parametrize(("name", "key"), PUBLISHED.items())
def test_matrices_and_limits_are_those_of_the_collected_data(name: str, key: str):
    plant, spec, _ = CASES[name]
    [data] = [one for one in reference("saturated_plants.json")["plants"] if one["name"] == key]
    A, B = data.get("A_zoh", data["A"]), data.get("B_zoh", data["B"])
    assert plant.A == pytest.approx(np.array(A), abs=1e-12) and plant.B == pytest.approx(np.array(B), abs=1e-12)
    assert plant.dt == data["Ts"] and spec.inputs.upper.tolist() == data["umax"]  # type: ignore[union-attr]
    if not plant.full_state:
        assert plant.C.tolist() == data["C"]


@pytest.mark.parametrize("name", ["NN2", "DIS2", "REA1", "AC15", "AC17", "MFP", "AC7", "HE4"])
def test_compleib_plants_are_those_of_the_collection_sampled(name: str):
    plant, _, _ = CASES[name]
    [data] = [one for one in reference("compleib.json")["plants"] if one["name"] == name]
    n, m = plant.n, plant.m
    rates = np.zeros((n + m, n + m))
    rates[:n] = np.hstack([data["A"], data["B"]]) * plant.dt
    step, term = np.eye(n + m), np.eye(n + m)
    for k in range(1, 80):
        term = term @ rates / k
        step = step + term
    assert plant.A == pytest.approx(step[:n, :n], abs=1e-12) and plant.B == pytest.approx(step[:n, n:], abs=1e-12)
    assert plant.C.tolist() == data["C"]


@pytest.mark.parametrize(("name", "poles"), [
    ("fighter", [-7.6636, 5.4530, -0.0075 + 0.0556j, -0.0075 - 0.0556j]),  # printed with the plant
    ("REA1", [1.991, 0.0635, -5.057, -8.666]),  # the unstable reactor's open-loop poles, often printed
    ("NN2", [1j, -1j]), ("pointer", [1.0, -1.0]),
    ("HE1", [-2.0727, -0.2325, 0.2758 + 0.2576j, 0.2758 - 0.2576j]),
    ("AC1", [0.0, -0.7801 + 1.0296j, -0.7801 - 1.0296j, -0.0176 + 0.1826j, -0.0176 - 0.1826j]),
    ("airliner, output", [-0.0882 + 1.2695j, -0.0882 - 1.2695j, -1.085, -0.0092, -0.5, -20.0, -25.0]),
    ("jumbo jet, output", [-0.0329 + 0.9467j, -0.0329 - 0.9467j, -0.5627, -0.0073]),
    ("motor, output", [-9.9975, -2.0025]), ("ball suspension", [31.305, -31.305, -100.0]),
])
def test_open_loop_poles_are_the_published_ones(name: str, poles: list[complex]):
    plant = CASES[name].plant
    found = np.log(np.linalg.eigvals(plant.A).astype(complex)) / plant.dt
    distance = np.abs(found[:, None] - np.array(poles)[None])
    assert distance.min(axis=0) == pytest.approx(np.zeros(len(poles)), abs=6e-4)
    assert len(poles) == plant.n


def test_the_business_jet_climbs_at_its_speed_times_the_path_angle():
    plant = CASES["business jet, output"].plant
    pitched = np.array([0.0, 0.1, 0.0, 0.0])  # 0.1 rad of path angle at 128.2 m/s
    assert (plant.C @ pitched)[2] == pytest.approx(12.82) == -(plant.C @ pitched[[1, 0, 2, 3]])[2]
    assert sorted(np.abs(np.linalg.eigvals(plant.A)))[2:] == pytest.approx([1.0, 1.0], abs=1e-6)


def test_the_fighter_s_elevator_turns_its_nose_down_and_its_flaperon_less():
    plant = CASES["fighter"].plant
    assert plant.B[2] / plant.dt == pytest.approx([-17.251, -1.5766], rel=0.2)  # deg/s^2 per degree


def test_masses_feel_opposite_forces_and_keep_their_energy():
    case = oscillators.masses(4)
    assert (case.plant.n, case.plant.m) == (8, 3)
    assert np.abs(np.linalg.eigvals(case.plant.A)) == pytest.approx(np.ones(8))
    swings = np.sort(np.abs(np.angle(np.linalg.eigvals(case.plant.A))))[::2] / 0.5  # rad/s
    assert swings == pytest.approx(2 * np.sin(np.arange(1, 5) * np.pi / 10))  # of a chain between two walls
    assert case.plant.B[4:].sum(axis=0) == pytest.approx(np.zeros(3), abs=0.05)  # but for what the walls take up


def test_the_six_masses_are_those_of_the_source():
    plant, spec, _ = CASES["six masses"]
    [data] = [one for one in reference("saturated_plants.json")["plants"] if one["name"] == "WANG_BOYD_masses"]
    assert plant.A == pytest.approx(np.array(data["A_zoh"]), abs=1e-12)
    assert plant.B == pytest.approx(np.array(data["B_zoh"]), abs=1e-12)
    assert plant.dt == data["Ts"] and spec.inputs.upper.tolist() == data["umax"]  # type: ignore[union-attr]


def test_two_plants_of_one_name_are_refused(monkeypatch: pytest.MonkeyPatch):
    module = importlib.import_module("benchmarks.plants.suite")
    monkeypatch.setattr(module, "FAMILIES", (textbook.cases, pendulums.cases, lambda: {"pendulum": CASES["pointer"]}))
    with pytest.raises(ValueError, match="'pendulum'"):
        suite()


def test_a_further_family_is_one_more_function(monkeypatch: pytest.MonkeyPatch):
    module = importlib.import_module("benchmarks.plants.suite")
    more: Case = CASES["pointer"]
    monkeypatch.setattr(module, "FAMILIES", (*module.FAMILIES, lambda: {"another": more}))
    assert suite()["another"] is more and len(suite()) == len(CASES) + 1


def test_no_family_is_left_out():
    for family in (textbook, drives, tanks, pendulums, vehicles, aircraft, compleib, compleib_larger, oscillators):
        assert family.cases().keys() <= CASES.keys()
