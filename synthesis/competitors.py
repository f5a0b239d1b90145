"""What the linear competitors that are easily found cost, and whether they keep the limits after the first step."""

from __future__ import annotations

from collections.abc import Callable

from inc_casadi import Plant, Spec
from inc_casadi.arrays import Array
from inc_casadi.comparison.violations import first_violation
from inc_casadi.errors import INCError
from inc_casadi.linear.static_gain import best_static_gain, scaled_lqr_gain

EXCEEDS = ", limits kept at k = 0 only"


def linear_competitors(plant: Plant, spec: Spec, seed: int, notes: list[str],
                       say: Callable[[str], None], seconds: float | None = None) -> dict[str, float]:
    """Return the costs of the best static linear gain found and of the scaled LQR gain, by name.

    Both keep the input limits at k = 0, as in sec:numerics; a name ends with a remark when the motion exceeds them
    later, for then the gain is no member of the class that the lower bounds are about. Reasons for a missing one go to
    `notes`. seconds: for the search of the former, which a time limit ends with the best it has.
    """
    found: dict[str, float] = {}
    for name, search in (("best static linear gain", lambda: best_static_gain(plant, spec, seed=seed, seconds=seconds)),
                         ("scaled LQR gain", lambda: scaled_lqr_gain(plant, spec))):
        try:
            gain = search()
        except INCError as error:
            notes.append(f"{name}: {error}")
            continue
        remark = "" if keeps_limits(plant, spec, gain.F) else EXCEEDS
        found[name + remark] = float(gain.cost)
        say(f"{name + remark}: {gain.cost:.6f}")
    return found


def keeps_limits(plant: Plant, spec: Spec, F: Array) -> bool:
    """Whether u = F y keeps the limits for 200 steps from every initial state: H u_k is linear in x0, supports decide.

    >>> import numpy as np
    >>> from inc_casadi import Box
    >>> spec = Spec([[1.0]], [[0.0]], 0.9, Box([-1.0], [1.0]), Box([-1.0], [1.0]))
    >>> keeps_limits(Plant([[1.5]], [[1.0]]), spec, np.array([[-1.0]]))
    True
    """
    closed = plant.A + plant.B @ F @ plant.C
    return not first_violation(spec.inputs, spec.initial, closed, F @ plant.C)
