"""Small plants that papers on limited inputs return to: Bemporad's lag, the double integrator."""

from __future__ import annotations

import numpy as np

from inc_casadi import Box, Plant, Spec

from .paper import Case


def cases() -> dict[str, Case]:
    """Return the cases of this file by name.

    >>> sorted(cases())
    ['double integrator', 'two lags', 'two lags, output']
    """
    return {"two lags": two_lags(), "two lags, output": two_lags(measured=True), "double integrator": double_integrator()}


def two_lags(measured: bool = False) -> Case:
    """Return the plant 2 / (s^2 + 3 s + 2), sampled with 0.1 s as printed, |u| <= 2: stable, without units.

    Weights Q = I, R = 0.01 are those of the source; discount and initial box are chosen here.

    measured: whether only the output y = 1.4142 x_2 is seen

    >>> two_lags(measured=True).plant.C.tolist()
    [[0.0, 1.4142]]
    """
    plant = Plant([[0.7326, -0.0861], [0.1722, 0.9909]], [[0.0609], [0.0064]], [[0.0, 1.4142]] if measured else None, dt=0.1)
    spec = Spec(np.eye(2), 0.01, 0.98, Box([-1.5, -1.5], [1.5, 1.5]), Box(-2, 2))
    return Case(plant, spec, "Bemporad, Morari, Dua, Pistikopoulos, Automatica 38(1), 2002, example 1")


def double_integrator() -> Case:
    """Return the double integrator: position (m) and velocity (m/s), dt = 1 s, |u| <= 1 m/s^2.

    Weights Q = I, R = 1 are the customary ones; discount and initial box are chosen here.

    >>> double_integrator().plant.A.tolist()
    [[1.0, 1.0], [0.0, 1.0]]
    """
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]])
    spec = Spec(np.eye(2), 1.0, 0.95, Box([-3, -1], [3, 1]), Box(-1, 1))
    return Case(plant, spec, "the double integrator of ReachSDP (Hu, Fazlyab, Morari, Pappas, CDC 2020) and nfl_veripy")
