"""The largest of a family of linear gains that keeps the input limits at all times."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from inc_casadi import Plant, Spec
from inc_casadi.arrays import Array
from inc_casadi.errors import InfeasibleError
from inc_casadi.linear import LinearController, LinearCost, linear_cost


def certified(plant: Plant, spec: Spec, F: Array) -> LinearCost | None:
    """Return what u = F y costs, if it is proved to stabilize the plant and keep the limits for ever, else None.

    It rests on `linear_cost`: the initial states are followed until the energy of the inputs to come is too small to reach a
    limit. Sufficient.

    F: (m, p), in units of u per unit of y

    >>> from inc_casadi import Box
    >>> spec = Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-1, 1))
    >>> [certified(Plant(1.5, 1.0), spec, np.array([[F]])) is not None for F in (-1.0, -1.1, -0.4)]
    [True, False, False]
    """
    found = linear_cost(plant, spec, LinearController.static(F))
    return found if found.holds() else None


def largest_kept(plant: Plant, spec: Spec, family: Callable[[float], Array | None], values: int = 20,
                 halvings: int = 24) -> LinearCost:
    """Return the gain family(t) of the largest t in (0, 1] found for which `certified` says yes, with what it costs.

    t = 1 and smaller values are tried downwards, then the step between the last failure and the first success is halved.
    What holds at t need not hold below, so this t is the largest of those tried and not proved to be the largest of all.

    family : t -> F (m, p), or None where there is none; values : how many t to try; halvings : how often to halve the step

    Raises
    ------
    InfeasibleError : no t was found

    >>> from inc_casadi import Box
    >>> plant, spec = Plant(1.5, 1.0), Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-1, 1))
    >>> largest_kept(plant, spec, lambda t: np.array([[-1.25 * t]])).controller.D_c.round(6).tolist()
    [[-1.0]]
    """
    def tried(t: float) -> LinearCost | None:
        F = family(t)
        return None if F is None else certified(plant, spec, F)

    high = 1.0
    for t in np.linspace(1.0, 0.0, values, endpoint=False):
        found = tried(float(t))
        if found is not None:
            return _pressed(tried, float(t), high, found, halvings)
        high = float(t)
    raise InfeasibleError(f"none of {values} gains tried, from the whole one down to {high:g} of it, stabilizes the plant "
                          "and keeps the input limits at all times from every initial state")


def _pressed(tried: Callable[[float], LinearCost | None], low: float, high: float, found: LinearCost,
             halvings: int) -> LinearCost:
    for _ in range(halvings if high > low else 0):
        middle = (low + high) / 2
        better = tried(middle)
        low, high, found = (low, middle, found) if better is None else (middle, high, better)
    return found
