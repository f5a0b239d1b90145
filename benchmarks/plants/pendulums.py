"""Things that fall over: an inverted pendulum, a balancing pointer, a cart and pole."""

from __future__ import annotations

import numpy as np

from inc_casadi import Box, Plant, Spec

from .paper import Case


def cases() -> dict[str, Case]:
    """Return the cases of this file by name.

    >>> sorted(cases())
    ['cart and pole', 'pendulum', 'pendulum, output', 'pointer']
    """
    return {"pendulum": pendulum(), "pendulum, output": pendulum(measured=True), "pointer": pointer(),
            "cart and pole": cart_and_pole()}


def pendulum(measured: bool = False) -> Case:
    """Return an inverted pendulum: angle (rad) and rate (rad/s), |u| <= 0.7 N m, Euler steps of 0.02 s as published.

    Mass 0.15 kg, length 0.5 m, friction 0.05 N m s/rad, g = 10 m/s^2: theta'' = (g/l) theta - (mu/ml^2) theta' + u/ml^2.
    It is unstable, and lost where |0.982 theta + 0.189 theta'| exceeds 0.916. Q = I, R = 10 are those of the source's
    predictive controller; discount and box are chosen here.

    measured: whether only the angle is seen; the box is smaller then

    >>> pendulum().plant.A.round(4).tolist()
    [[1.0, 0.02], [0.4, 0.9733]]
    """
    step, m, length, friction, g = 0.02, 0.15, 0.5, 0.05, 10.0
    inertia = m * length**2
    A = [[1.0, step], [step * g / length, 1.0 - step * friction / inertia]]
    plant = Plant(A, [[0.0], [step / inertia]], [[1.0, 0.0]] if measured else None, dt=step)
    half = np.array([0.6, 0.8] if measured else [0.5, 1.5])
    spec = Spec(np.eye(2), 10.0, 0.99, Box(-half, half), Box(-0.7, 0.7))
    return Case(plant, spec, "Yin, Seiler, Arcak, IEEE TAC 67(4), 2022, the pendulum, its sine linearized")


def pointer() -> Case:
    """Return a balancing pointer: x'' = x - 5 u, |u| <= 1, without units, held over 0.4 s; lost where |x + x'| > 5.

    Weights, discount and initial box are chosen here.

    >>> pointer().plant.B.round(4).tolist()
    [[-0.4054], [-2.0538]]
    """
    plant = Plant([[0.0, 1.0], [1.0, 0.0]], [[0.0], [-5.0]], dt=0.0).sampled(0.4)
    spec = Spec(np.eye(2), 1.0, 0.98, Box([-1.5, -1.5], [1.5, 1.5]), Box(-1, 1))
    return Case(plant, spec, "Queinnec, Tarbouriech, Valmorbida, Zaccarian, IEEE TAC 67(7), 2022, example 2")


def cart_and_pole() -> Case:
    """Return a cart (m, m/s) and pole (rad, rad/s), a force |u| <= 2 N, Euler steps of 0.08 s as published; unstable.

    The stage cost is the source's: 1, 1, 5, 1 for the states and 1 for the input. Its initial state is Gaussian with
    deviations 0.25, 0.1, 0.25, 0.1, far beyond what 2 N can recover; the box here is within.

    >>> cart_and_pole().plant.n
    4
    """
    A = [[1.0, 0.08, 0.0, 0.0], [0.0, 1.0, -0.15696, 0.0], [0.0, 0.0, 1.0, 0.08], [0.0, 0.0, 1.88352, 1.0]]
    half = np.array([0.25, 0.1, 0.04, 0.08])
    spec = Spec(np.diag([1.0, 1.0, 5.0, 1.0]), 1.0, 0.98, Box(-half, half), Box(-2, 2))
    return Case(Plant(A, [[0.0], [0.08], [0.0], [-0.08]], dt=0.08), spec,
                "Wang, Barbara, Revay, Manchester, IEEE L-CSS 6, 2022, the cart-pole")
