"""The quadruple tank with its adjustable zero: water levels driven by two pumps."""

from __future__ import annotations

import numpy as np

from inc_casadi import Box, Plant, Spec

from .paper import Case

AREAS, HOLES = np.array([28.0, 32.0, 28.0, 32.0]), np.array([0.071, 0.057, 0.071, 0.057])  # cm^2
GRAVITY = 981.0  # cm/s^2


def cases() -> dict[str, Case]:
    """Return the cases of this file by name.

    >>> sorted(cases())
    ['four tanks, inverse response, output', 'four tanks, output']
    """
    return {"four tanks, output": four_tanks(), "four tanks, inverse response, output": four_tanks(inverse=True)}


def four_tanks(inverse: bool = False) -> Case:
    """Return four tanks as deviations of the levels (cm), pumped with 3 V (3.15 V) in equilibrium; held over 5 s; stable.

    Pumps run from 0 to 10 V. The levels of the two lower tanks are measured, 0.5 V/cm. Weights and box are chosen here; the
    box is within the levels of the equilibrium.

    inverse: the valves let most water into the upper tanks, so that one zero is unstable

    >>> four_tanks().spec.inputs.upper.tolist()
    [7.0, 7.0]
    """
    levels = np.array([12.6, 13.0, 4.8, 4.9] if inverse else [12.4, 12.7, 1.8, 1.4])
    pumps, split, volts = ((3.14, 3.29), (0.43, 0.34), 3.15) if inverse else ((3.33, 3.35), (0.70, 0.60), 3.00)
    A = np.diag(-1.0 / time_constants(levels))
    A[0, 2], A[1, 3] = -A[2, 2] * AREAS[2] / AREAS[0], -A[3, 3] * AREAS[3] / AREAS[1]
    into = np.array([[split[0], 0.0], [0.0, split[1]], [0.0, 1 - split[1]], [1 - split[0], 0.0]])
    C = 0.5 * np.eye(2, 4)
    plant = Plant(A, into * np.array(pumps) / AREAS[:, None], C, dt=0.0).sampled(5.0)
    half = np.array([5.0, 5.0, 1.5, 1.2])
    spec = Spec(np.diag([1.0, 1.0, 0.1, 0.1]), 0.1 * np.eye(2), 0.98, Box(-half, half),
                Box([-volts, -volts], [10 - volts, 10 - volts]))
    return Case(plant, spec, "Johansson, IEEE TCST 8(3), 2000, the quadruple tank")


def time_constants(levels: np.ndarray) -> np.ndarray:
    """Return the time constants (4,) of the tanks in s at the levels (4,) in cm: area / hole sqrt(2 level / g).

    >>> time_constants(np.array([12.4, 12.7, 1.8, 1.4])).round().tolist()  # 62, 90, 23, 30 in the source
    [63.0, 90.0, 24.0, 30.0]
    """
    return np.asarray(AREAS / HOLES * np.sqrt(2 * levels / GRAVITY))
