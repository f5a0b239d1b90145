"""Electric drives: a motor's speed, a servo with an elastic shaft, a ball held by a magnet."""

from __future__ import annotations

import numpy as np

from inc_casadi import Box, Plant, Spec

from .paper import Case

TUTORIAL = "Control Tutorials for MATLAB and Simulink, Michigan and Carnegie Mellon"


def cases() -> dict[str, Case]:
    """Return the cases of this file by name.

    >>> sorted(cases())
    ['ball suspension', 'ball suspension, output', 'motor, output', 'servo, output']
    """
    return {"motor, output": motor(), "servo, output": servo(), "ball suspension": ball_suspension(),
            "ball suspension, output": ball_suspension(measured=True)}


def motor() -> Case:
    """Return a DC motor: speed (rad/s) and current (A), the speed measured, |u| <= 3 V, held over 0.05 s; stable.

    Inertia 0.01 kg m^2, friction 0.1 N m s, torque constant 0.01 N m/A, 1 ohm, 0.5 H. Limits, weights and box are chosen
    here.

    >>> motor().plant.C.tolist()
    [[1.0, 0.0]]
    """
    J, friction, constant, resistance, inductance = 0.01, 0.1, 0.01, 1.0, 0.5
    A = [[-friction / J, constant / J], [-constant / inductance, -resistance / inductance]]
    plant = Plant(A, [[0.0], [1.0 / inductance]], [[1.0, 0.0]], dt=0.0).sampled(0.05)
    spec = Spec(np.diag([1.0, 0.1]), 0.01, 0.98, Box([-1.0, -4.0], [1.0, 4.0]), Box(-3, 3))
    return Case(plant, spec, f"{TUTORIAL}, motor speed")


def servo() -> Case:
    """Return a servo with an elastic shaft: angle (rad) and rate (rad/s) of the load, then of the motor.

    |u| <= 220 V; angle of the load and torque of the shaft (N m) are measured; held over 0.1 s as in the source. The shaft
    has 1280.2 N m/rad, the load 25 kg m^2, the gear before it a ratio of 20. Weights and box are chosen here.

    >>> servo().plant.C.round(2).tolist()
    [[1.0, 0.0, 0.0, 0.0], [1280.2, 0.0, -64.01, 0.0]]
    """
    stiffness, gear, load, motor, constant, resistance = 1280.2, 20.0, 25.0, 0.5, 10.0, 20.0
    A = [[0.0, 1.0, 0.0, 0.0],
         [-stiffness / load, -25.0 / load, stiffness / (gear * load), 0.0],
         [0.0, 0.0, 0.0, 1.0],
         [stiffness / (gear * motor), 0.0, -stiffness / (gear**2 * motor), -(0.1 + constant**2 / resistance) / motor]]
    C = [[1.0, 0.0, 0.0, 0.0], [stiffness, 0.0, -stiffness / gear, 0.0]]
    plant = Plant(A, [[0.0], [0.0], [0.0], [constant / (resistance * motor)]], C, dt=0.0).sampled(0.1)
    half = np.array([1.0, 0.2, 20.0, 4.0])
    spec = Spec(np.diag([100.0, 0.0, 0.01, 0.0]), 1e-4, 0.98, Box(-half, half), Box(-220, 220))
    return Case(plant, spec, "Bemporad, Mosca, Automatica 34(4), 1998, the position servomechanism")


def ball_suspension(measured: bool = False) -> Case:
    """Return a ball under a magnet: gap (m), its rate (m/s), current (A), as deviations from 10 mm and 7 A; held 5 ms.

    |u| <= 7 V, so that the voltage stays between 0 and twice what holds the ball; unstable, with an eigenvalue of 1.169 per
    step. 50 g, 1 ohm, 10 mH; 980 = 2 g / gap, 2.8 = 2 g / current. Weights and box are chosen here.

    measured: whether only the gap is seen

    >>> ball_suspension().plant.n
    3
    """
    plant = Plant([[0.0, 1.0, 0.0], [980.0, 0.0, -2.8], [0.0, 0.0, -100.0]], [[0.0], [0.0], [100.0]],
                  [[1.0, 0.0, 0.0]] if measured else None, dt=0.0).sampled(0.005)
    half = np.array([0.002, 0.05, 0.5] if measured else [0.005, 0.1, 1.0])
    spec = Spec(np.diag([1e6, 100.0, 0.1]), 0.1, 0.98, Box(-half, half), Box(-7, 7))
    return Case(plant, spec, f"{TUTORIAL}, state-space methods")
