"""Small plants of COMPleib with static output feedback, sampled, and limited: it states neither limits nor units.

Input limits, sampling periods, weights and boxes are chosen here, so that some inputs of the regulator exceed the limits
and no initial state is lost.
"""

from __future__ import annotations

import numpy as np

from inc_casadi import Box, Plant, Spec

from .paper import Case

SOURCE = "Leibfritz, COMPleib 1.1, 2005"


def cases() -> dict[str, Case]:
    """Return the cases of this file by name.

    >>> sorted(cases())
    ['AC15', 'AC17', 'DIS2', 'HE1', 'MFP', 'NN2', 'REA1']
    """
    return {"NN2": nn2(), "DIS2": dis2(), "REA1": rea1(), "HE1": he1(), "AC15": ac15(), "AC17": ac17(), "MFP": mfp()}


def nn2() -> Case:
    """Return NN2, an undamped oscillator x'' = -x + u whose velocity is measured: dt = 0.5 s, |u| <= 1; cost on position.

    >>> nn2().plant.C.tolist()
    [[0.0, 1.0]]
    """
    plant = Plant([[0.0, 1.0], [-1.0, 0.0]], [[0.0], [1.0]], [[0.0, 1.0]], dt=0.0).sampled(0.5)
    spec = Spec(np.diag([1.0, 0.0]), 1.0, 0.98, Box([-2, -2], [2, 2]), Box(-1, 1))
    return Case(plant, spec, f"{SOURCE}, NN2")


def dis2() -> Case:
    """Return DIS2, three states of which two are measured, two inputs: dt = 0.1 s, |u_i| <= 4; unstable.

    >>> dis2().plant.p
    2
    """
    A = [[-4.0, 2.0, 1.0], [3.0, -2.0, 5.0], [-7.0, 0.0, 3.0]]
    plant = Plant(A, [[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]], [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], dt=0.0).sampled(0.1)
    spec = Spec(np.eye(3), np.eye(2), 0.98, Box(-np.ones(3), np.ones(3)), Box([-4, -4], [4, 4]))
    return Case(plant, spec, f"{SOURCE}, DIS2")


def rea1() -> Case:
    """Return REA1, a chemical reactor of four states, three outputs, two inputs: dt = 0.1 s, |u_i| <= 1; unstable.

    >>> rea1().plant.p
    3
    """
    A = [[1.38, -0.2077, 6.715, -5.676], [-0.5814, -4.29, 0.0, 0.675], [1.067, 4.273, -6.654, 5.893],
         [0.048, 4.273, 1.343, -2.104]]
    B = [[0.0, 0.0], [5.679, 0.0], [1.136, -3.146], [1.136, 0.0]]
    C = [[1.0, 0.0, 1.0, -1.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]]
    half = np.full(4, 0.4)
    spec = Spec(np.eye(4), np.eye(2), 0.98, Box(-half, half), Box([-1, -1], [1, 1]))
    return Case(Plant(A, B, C, dt=0.0).sampled(0.1), spec, f"{SOURCE}, REA1")


def he1() -> Case:
    """Return HE1, a helicopter: forward, vertical velocity (kn), pitch rate (deg/s), pitch (deg); collective, cyclic (deg).

    The vertical velocity is measured; dt = 0.1 s, |u_i| <= 0.5; unstable.

    >>> he1().plant.C.tolist()
    [[0.0, 1.0, 0.0, 0.0]]
    """
    A = [[-0.0366, 0.0271, 0.0188, -0.4555], [0.0482, -1.01, 0.0024, -4.0208], [0.1002, 0.3681, -0.707, 1.42],
         [0.0, 0.0, 1.0, 0.0]]
    B = [[0.4422, 0.1761], [3.5446, -7.5922], [-5.52, 4.49], [0.0, 0.0]]
    half = np.array([0.5, 0.5, 0.2, 0.2])
    spec = Spec(np.eye(4), 0.1 * np.eye(2), 0.98, Box(-half, half), Box([-0.5, -0.5], [0.5, 0.5]))
    return Case(Plant(A, B, [[0.0, 1.0, 0.0, 0.0]], dt=0.0).sampled(0.1), spec,
                f"{SOURCE}, HE1; Narendra, Tripathi, AIAA J. Aircraft 10(3), 1973")


def ac15() -> Case:
    """Return AC15, a supersonic transport of four states, three outputs, two inputs: dt = 0.2 s, |u_i| <= 1.

    >>> ac15().plant.p
    3
    """
    A = [[-0.037, 0.0123, 0.00055, -1.0], [0.0, 0.0, 1.0, 0.0], [-6.37, 0.0, -0.23, 0.0618], [1.25, 0.0, 0.016, -0.0457]]
    B = [[0.00084, 0.000236], [0.0, 0.0], [0.08, 0.804], [-0.0862, -0.0665]]
    C = [[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    half = np.array([0.1, 0.3, 0.3, 0.1])
    spec = Spec(np.eye(4), 0.1 * np.eye(2), 0.98, Box(-half, half), Box([-1, -1], [1, 1]))
    return Case(Plant(A, B, C, dt=0.0).sampled(0.2), spec, f"{SOURCE}, AC15; IEEE TAC 19(3), 1974, p. 257")


def ac17() -> Case:
    """Return AC17, the lateral motion of an airliner of four states, two outputs, one input: dt = 0.2 s, |u| <= 1.

    >>> ac17().plant.p
    2
    """
    A = [[-2.98, 0.93, 0.0, -0.034], [-0.99, -0.21, 0.035, -0.0011], [0.0, 0.0, 0.0, 1.0], [0.39, -5.555, 0.0, -1.89]]
    half = np.array([0.5, 0.5, 1.0, 0.5])
    spec = Spec(np.eye(4), 0.1, 0.98, Box(-half, half), Box(-1, 1))
    return Case(Plant(A, [[-0.032], [0.0], [0.0], [-1.6]], np.eye(2, 4, k=2), dt=0.0).sampled(0.2), spec,
                f"{SOURCE}, AC17; Galimidi, Barmish, IEEE TAC 31(5), 1986")


def mfp() -> Case:
    """Return MFP, a moored floating platform of four states, two outputs, three inputs: dt = 0.5 s, |u_i| <= 0.5.

    >>> mfp().plant.m
    3
    """
    A = [[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [-0.101, -0.1681, -0.04564, -0.01075],
         [0.06082, -2.1407, -0.05578, -0.1273]]
    B = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.1179, 0.1441, 0.1476], [0.1441, 1.7057, -0.7557]]
    half, limit = np.ones(4), np.full(3, 0.5)
    spec = Spec(np.eye(4), np.eye(3), 0.98, Box(-half, half), Box(-limit, limit))
    return Case(Plant(A, B, np.eye(2, 4), dt=0.0).sampled(0.5), spec, f"{SOURCE}, MFP")
