"""Linear plants of the suite against the nonlinear physics they come from, and against published gains and zeros."""

from __future__ import annotations

from collections.abc import Callable

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import logm

from benchmarks.plants import suite
from benchmarks.plants.tanks import time_constants
from inc_casadi import Plant

CASES = suite()
Rates = Callable[[np.ndarray, np.ndarray], np.ndarray]


def flow(rates: Rates, x: np.ndarray, u: np.ndarray, seconds: float) -> np.ndarray:
    """The state after some seconds of constant input, of a nonlinear plant."""
    return solve_ivp(lambda _, state: rates(state, u), (0.0, seconds), x, rtol=1e-11, atol=1e-13).y[:, -1]


def sampled_at(rates: Rates, x: np.ndarray, u: np.ndarray, seconds: float,
               steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A and B of the sampled nonlinear plant at an equilibrium, by central differences with a step for each coordinate."""
    n = x.size
    moves = np.diag(steps)
    ends = [(flow(rates, x + h[:n], u + h[n:], seconds) - flow(rates, x - h[:n], u - h[n:], seconds)) / (2 * step)
            for h, step in zip(moves, steps, strict=True)]
    both = np.array(ends).T
    return both[:, :n], both[:, n:]


def rates_of(plant: Plant) -> tuple[np.ndarray, np.ndarray]:
    """A and B in continuous time of a sampled plant, by a matrix logarithm."""
    n, m = plant.n, plant.m
    held = np.block([[plant.A, plant.B], [np.zeros((m, n)), np.eye(m)]])
    both = np.real(logm(held)) / plant.dt
    return both[:n, :n], both[:n, n:]


def tanks(levels: np.ndarray, volts: np.ndarray, pumps: np.ndarray, split: np.ndarray) -> np.ndarray:
    """Rates of the four levels (cm/s) by Torricelli's law."""
    out = np.array([0.071, 0.057, 0.071, 0.057]) * np.sqrt(2 * 981.0 * np.maximum(levels, 0.0))
    flows = pumps * volts
    into = np.array([out[2] + split[0] * flows[0], out[3] + split[1] * flows[1], (1 - split[1]) * flows[1],
                     (1 - split[0]) * flows[0]])
    return (into - out) / np.array([28.0, 32.0, 28.0, 32.0])


@pytest.mark.parametrize(("name", "levels", "volts", "pumps", "split"), [
    ("four tanks, output", [12.4, 12.7, 1.8, 1.4], 3.0, [3.33, 3.35], [0.70, 0.60]),
    ("four tanks, inverse response, output", [12.6, 13.0, 4.8, 4.9], 3.15, [3.14, 3.29], [0.43, 0.34])])
def test_the_tanks_are_torricelli_s_near_the_published_levels(name, levels, volts, pumps, split):
    # The printed levels balance to some per cent only, so rates are compared, and not motions.
    x, u = np.array(levels), np.array([volts, volts])
    law = (np.array(pumps), np.array(split))
    assert np.max(np.abs(tanks(x, u, *law))) < 0.02  # cm/s: an equilibrium
    A, B = rates_of(CASES[name].plant)
    ends = [(tanks(x + h, u, *law) - tanks(x - h, u, *law)) / 2e-5 for h in 1e-5 * np.eye(4)]
    assert A == pytest.approx(np.array(ends).T, abs=1e-7)
    assert B == pytest.approx(np.array([tanks(x, u + h, *law) - tanks(x, u, *law) for h in np.eye(2)]).T, abs=1e-9)


@pytest.mark.parametrize(("name", "zeros"), [("four tanks, output", [-0.060, -0.018]),
                                             ("four tanks, inverse response, output", [0.013, -0.057])])
def test_the_tanks_have_the_published_zeros(name: str, zeros: list[float]):
    plant = CASES[name].plant
    A, B = rates_of(plant)
    found = control.ss(A, B, plant.C, np.zeros((2, 2))).zeros()
    assert np.sort(found.real) == pytest.approx(np.sort(zeros), abs=3e-3)


@pytest.mark.parametrize(("levels", "seconds"), [([12.4, 12.7, 1.8, 1.4], [62, 90, 23, 30]),
                                                 ([12.6, 13.0, 4.8, 4.9], [63, 91, 39, 56])])
def test_the_tanks_have_the_published_time_constants(levels: list[float], seconds: list[float]):
    assert time_constants(np.array(levels)) == pytest.approx(np.array(seconds), abs=1.0)


def test_the_ball_under_its_magnet_is_linearized():
    mass, g, gap, current, resistance, inductance = 0.05, 9.8, 0.01, 7.0, 1.0, 0.01
    pull = mass * g * gap / current**2 * current  # the force is pull i / h in the source: i^2 K / h with K = m g h / i^2
    assert pull / current == pytest.approx(1e-4)

    def rates(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        h, speed, i = x
        return np.array([speed, g - 1e-4 * i**2 / (h * mass), (u[0] - resistance * i) / inductance])

    plant = CASES["ball suspension"].plant
    steps = np.array([1e-6, 1e-4, 1e-3, 1e-3])
    A, B = sampled_at(rates, np.array([gap, 0.0, current]), np.array([current]), plant.dt, steps)
    assert plant.A == pytest.approx(A, rel=1e-5, abs=1e-6) and plant.B == pytest.approx(B, rel=1e-5, abs=1e-9)


def test_the_cruising_car_is_the_engine_s_at_20_metres_per_second():
    mass, ratio, most, at, curve = 1600.0, 12.0, 190.0, 420.0, 0.4

    def rates(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        torque = most * (1 - curve * (ratio * x / at - 1) ** 2)
        return (ratio * u * torque - mass * 9.8 * 0.01 - 0.5 * 1.3 * 0.32 * 2.4 * x**2) / mass

    plant, spec, _ = CASES["cruise"]
    assert rates(np.array([20.0]), np.array([0.1687])) == pytest.approx(0.0, abs=1e-3)
    A, B = sampled_at(rates, np.array([20.0]), np.array([0.1687]), plant.dt, np.array([1e-3, 1e-3]))
    assert plant.A == pytest.approx(A, abs=2e-4) and plant.B == pytest.approx(B, abs=2e-3)
    assert (spec.inputs.lower + 0.1687, spec.inputs.upper + 0.1687) == (pytest.approx(0.0), pytest.approx(1.0))  # type: ignore


def test_the_jet_on_its_thrust_is_linearized_in_hover():
    m, J, arm, damping, g = 4.0, 0.0475, 0.25, 0.05, 9.8

    def rates(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        angle, (across, along) = x[2], u
        return np.concatenate([x[3:], [
            (-damping * x[3] + across * np.cos(angle) - along * np.sin(angle)) / m,
            (-damping * x[4] + across * np.sin(angle) + along * np.cos(angle)) / m - g, across * arm / J]])

    plant = CASES["vectored thrust"].plant
    A, B = sampled_at(rates, np.zeros(6), np.array([0.0, m * g]), plant.dt, np.full(8, 1e-4))
    assert plant.A == pytest.approx(A, abs=1e-7) and plant.B == pytest.approx(B, abs=1e-7)
    assert plant.B[0, 0] > 0 > np.linalg.matrix_power(plant.A, 20)[0] @ plant.B[:, 0]  # it goes the wrong way first


def test_the_motor_turns_as_its_torques_balance():
    A, B = rates_of(CASES["motor, output"].plant)
    speed, current = -np.linalg.solve(A, B[:, 0])  # at rest under 1 V
    assert 0.01 * current == pytest.approx(0.1 * speed) and current + 0.01 * speed == pytest.approx(1.0)
    assert speed == pytest.approx(0.0999, abs=1e-4)  # 0.1 rad/s in the source


def test_the_servo_turns_as_its_torques_balance_and_its_shaft_twists():
    plant = CASES["servo, output"].plant
    A, B = rates_of(plant)
    turning = np.array([0.0, 1.0, 0.0, 20.0])  # load at 1 rad/s, the motor 20 times as fast
    twist = 25.0 * 1.0 / 1280.2  # by which the load lags under its friction
    turning_state = turning + np.array([-twist, 0.0, 0.0, 0.0])
    volts = (0.1 * 20 + 10 * 10 / 20 * 20 + 25.0 / 20) / (10 / 20)
    assert A @ turning_state + B[:, 0] * volts == pytest.approx(turning * 0 + [1.0, 0.0, 20.0, 0.0], abs=1e-6)
    assert (plant.C @ turning_state)[1] == pytest.approx(-25.0)  # the torque that the shaft carries


def test_the_pitch_plant_has_the_published_transfer_function_and_gain():
    plant = CASES["pitch, output"].plant
    A, B = rates_of(plant)
    found = control.ss2tf(control.ss(A, B, plant.C, 0.0))
    assert np.squeeze(found.num[0][0])[-2:] == pytest.approx([1.151, 0.1774], abs=1e-4)
    assert np.squeeze(found.den[0][0]) == pytest.approx([1.0, 0.739, 0.921, 0.0], abs=1e-3)
    K, _, _ = control.lqr(A, B, 50 * plant.C.T @ plant.C, np.eye(1))
    assert np.asarray(K)[0] == pytest.approx([-0.6435, 169.6950, 7.0711], abs=1e-3)


def test_the_helicopter_falls_sideways_with_gravity():
    A, _ = rates_of(CASES["HE4"].plant)
    assert (-A[5, 0], A[6, 1]) == (pytest.approx(32.1, abs=0.1), pytest.approx(32.1, abs=0.1))  # ft/s^2 per rad
    assert np.sum(np.linalg.eigvals(A).real > 0) == 2  # a slow, growing swing


def test_gusts_are_out_of_the_elevator_s_reach():
    A, B = rates_of(CASES["AC7"].plant)
    assert np.max(np.abs(B[6:])) < 1e-12 and np.max(np.abs(A[6:, :6])) < 1e-10
