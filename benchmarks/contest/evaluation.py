"""What one control input costs in time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.speed.measurement import repeated
from inc_casadi import INC, Plant, Spec
from inc_casadi.arrays import Array

POINTS, TIMES = 20, 7


def microseconds(plant: Plant, spec: Spec, controller: Any, seed: int = 0) -> float:
    """Return the microseconds that one input takes in Python, at measurements from the initial distribution.

    One measurement at a time, as in a control loop; the least of several rounds. Generated C is some hundred times faster,
    so these figures compare controllers and say nothing about a processor.

    controller: an INC, or one with a state of its own and `step(xi, y)`, from its initial state.

    >>> from benchmarks.plants import scalar
    >>> case = scalar()
    >>> microseconds(case.plant, case.spec, INC.saturated([[-1.5]], 1.0)) > 0
    True
    """
    measured = plant.C @ spec.initial.sample(POINTS, np.random.default_rng(seed))
    law, points = _law(controller), list(measured.T)

    def once() -> None:
        for y in points:  # one by one is what is measured
            law(y)

    return repeated(once, TIMES)[1] / POINTS * 1e6


def _law(controller: Any) -> Callable[[Array], Any]:
    if isinstance(controller, INC):
        return controller
    return lambda y: controller.step(controller.xi_0, y)
