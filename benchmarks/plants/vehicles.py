"""Cars: the speed under cruise control, the lateral motion."""

from __future__ import annotations

import numpy as np

from inc_casadi import Box, Plant, Spec

from .paper import Case


def cases() -> dict[str, Case]:
    """Return the cases of this file by name.

    >>> sorted(cases())
    ['car', 'car, output', 'cruise']
    """
    return {"cruise": cruise(), "car": car(), "car, output": car(measured=True)}


def cruise() -> Case:
    """Return a car's speed (m/s) as deviation from 20 m/s in fourth gear, held over 0.5 s; stable.

    The throttle runs from 0 to 1 and is 0.1687 in equilibrium: -0.1687 <= u <= 0.8313. Weights and box are chosen here.

    >>> cruise().spec.inputs.lower.tolist()
    [-0.1687]
    """
    plant = Plant(-0.0101, 1.3203, dt=0.0).sampled(0.5)
    spec = Spec(1.0, 25.0, 0.98, Box(-5, 5), Box(-0.1687, 0.8313))
    return Case(plant, spec, "Åström, Murray, Feedback Systems, 2008, cruise control")


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
