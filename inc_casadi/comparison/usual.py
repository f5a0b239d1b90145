"""The controllers that anyone would try first: the clipped regulator, the best static gain found, the scaled regulator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..errors import INCError
from ..inc import INC
from ..linear.regulator import discounted_lqr
from ..linear.static_gain import best_static_gain, scaled_lqr_gain
from ..plant import Plant
from ..sets import Box
from ..spec import Spec


def usual_controllers(plant: Plant, spec: Spec, seed: int = 0) -> dict[str, Any]:
    """Return controllers by name, and in the place of one that cannot be had, the reason in words.

    "clipped LQR": u = sat(K x), with the full state measured and a box of limits; without limits it is the regulator
    itself, and with measured output the best static gain found is clipped instead. "best static gain" and "scaled LQR" are
    linear and keep the limits on the initial set.

    >>> from inc_casadi import Box
    >>> found = usual_controllers(Plant(1.5, 1.0), Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-1, 1)))
    >>> {name: law([2.0]).round(6).tolist() for name, law in found.items()}
    {'clipped LQR': [-1.0], 'best static gain': [-2.0], 'scaled LQR': [-2.0]}
    """
    gain = _found(lambda: INC.linear(best_static_gain(plant, spec, seed=seed).F))
    found: dict[str, Any] = {}
    if plant.full_state:
        name = "LQR" if spec.inputs is None else "clipped LQR"
        found[name] = _found(lambda: _clipped(INC.linear(discounted_lqr(plant, spec)[0]), spec))
    elif spec.inputs is not None:
        found["clipped static gain"] = gain if isinstance(gain, str) else _found(lambda: _clipped(gain, spec))
    found["best static gain"] = gain
    found["scaled LQR"] = _found(lambda: INC.linear(scaled_lqr_gain(plant, spec).F))
    return found


def _clipped(law: INC, spec: Spec) -> INC | str:
    if spec.inputs is None:
        return law
    if not isinstance(spec.inputs, Box):
        return "the input limits are no box to clip at"
    return law.with_saturated_output(spec.inputs)


def _found(search: Callable[[], Any]) -> Any:
    try:
        return search()
    except INCError as error:
        return str(error)
