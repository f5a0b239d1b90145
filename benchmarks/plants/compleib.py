"""Plants of COMPleib with static output feedback, sampled, and limited: the collection states neither limits nor units.

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
    ['DIS2', 'NN2', 'REA1']
    """
    return {"NN2": nn2(), "DIS2": dis2(), "REA1": rea1()}


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
