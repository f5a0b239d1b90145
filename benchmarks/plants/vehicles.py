"""Vehicles: a car's lateral motion, a fighter and a business jet in pitch."""

from __future__ import annotations

import numpy as np

from inc_casadi import Box, Plant, Spec

from .paper import Case


def cases() -> dict[str, Case]:
    """Return the cases of this file by name.

    >>> sorted(cases())
    ['business jet, output', 'car', 'car, output', 'fighter']
    """
    return {"car": car(), "car, output": car(measured=True), "fighter": fighter(), "business jet, output": business_jet()}


def car(measured: bool = False) -> Case:
    """Return the lateral motion of a car: offset (m), its rate, heading error (rad), its rate; Euler steps of 0.02 s.

    Steering |u| <= pi/6 rad; two eigenvalues are 1. Weights are the source's; discount and box, within its
    |x| <= (2, 5, 1, 5), are chosen here.

    measured: whether only offset and heading are seen

    >>> car(measured=True).plant.p
    2
    """
    A = [[1.0, 0.02, 0.0, 0.0],
         [0.0, 0.9027459366980325, 2.72311377245509, 0.02359491017964072],
         [0.0, 0.0, 1.0, 0.02],
         [0.0, 0.018763571428571428, -0.52538, 0.8565144153061225]]
    B = [[0.0], [1.4753293413173654], [0.0], [1.1615057142857144]]
    C = [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]] if measured else None
    half, most = np.array([2.0, 2.0, 0.3, 1.0]), np.pi / 6
    spec = Spec(np.diag([1.0, 5.0, 0.1, 0.5]), 0.1, 0.98, Box(-half, half), Box(-most, most))
    return Case(Plant(A, B, C, dt=0.02), spec, "Yin, Seiler, Jin, Arcak, IEEE L-CSS 6, 2022, vehicle lateral control")


def fighter() -> Case:
    """Return the AFTI F-16 in pitch: speed (ft/s), angle of attack, pitch rate, pitch angle (deg); held over 0.05 s.

    Elevator and flaperon are limited to 25 deg each; unstable, with an eigenvalue of 1.31 per step. The state is measured.
    Weights and box are chosen here.

    >>> fighter().plant.B.shape
    (4, 2)
    """
    A = [[-0.0151, -60.5651, 0.0, -32.174], [-0.0001, -1.3411, 0.9929, 0.0], [0.00018, 43.2541, -0.86939, 0.0],
         [0.0, 0.0, 1.0, 0.0]]
    B = [[-2.516, -13.136], [-0.1689, -0.2514], [-17.251, -1.5766], [0.0, 0.0]]
    half = np.array([10.0, 1.0, 1.5, 6.0])
    spec = Spec(np.diag([1e-4, 10.0, 1e-2, 10.0]), np.diag([0.1, 0.1]), 0.98, Box(-half, half), Box([-25, -25], [25, 25]))
    return Case(Plant(A, B, dt=0.0).sampled(0.05), spec, "Kapasouris, Athans, Stein, IFAC NOLCOS 1989; Bemporad, Casavola, "
                "Mosca, IEEE TAC 42(3), 1997")


def business_jet() -> Case:
    """Return a Cessna Citation 500 in pitch: angle of attack, pitch (rad), pitch rate (rad/s), height (m); held 0.5 s.

    Elevator |u| <= 0.262 rad (15 deg). Pitch, height and climb rate (m/s) are measured and weighed alike, as in the source,
    which weighs the input by 1 against them; 1000 here, so that rad count beside m. Two eigenvalues are 1. Box chosen here.

    >>> business_jet().plant.p
    3
    """
    A = [[-1.2822, 0.0, 0.98, 0.0], [0.0, 0.0, 1.0, 0.0], [-5.4293, 0.0, -1.8366, 0.0], [-128.2, 128.2, 0.0, 0.0]]
    C = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], [-128.2, 128.2, 0.0, 0.0]])
    half = np.array([0.1, 0.25, 0.1, 40.0])
    spec = Spec(C.T @ C, 1000.0, 0.98, Box(-half, half), Box(-0.262, 0.262))
    return Case(Plant(A, [[-0.3], [0.0], [-17.0], [0.0]], C, dt=0.0).sampled(0.5), spec,
                "Maciejowski, Predictive Control with Constraints, 2002, p. 64")
