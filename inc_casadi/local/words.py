"""What an ellipsoid of attraction promises, in a sentence for an engineer."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..claims.attraction import Attraction
from ..figures import at_least, at_most
from ..inc import INC
from ..plant import Plant

ROUNDING = 1e-9  # share by which a size computed in floats is rounded down


def promise(plant: Plant, inc: INC, claim: Attraction, size: float, center: Array) -> str:
    """Return the claim with its numbers; size: what it maximizes, rounded down; center (n,): the equilibrium in floats.

    >>> promise(Plant([[0.5]], [[1.0]]), INC.linear([[0.0]]), Attraction(), 2.0, np.zeros(1))
    "From every x0 with x0'P x0 <= 1 (volume at least 2): the motion stays in this ellipsoid and converges to x* = [0.]."
    """
    about = "x0" if inc.preserves_origin else "(x0 - x*)"
    rest = np.array2string(np.round(center, 9) + 0.0, precision=6)
    parts = [f"the motion stays in this ellipsoid and converges to x* = {rest}{_speed(plant, inc, claim)}"]
    if claim.inputs is not None:
        parts.append("every input stays within its limits")
    if claim.states is not None:
        parts.append("every state stays within its limits")
    if claim.has_cost:
        parts.append(f"the discounted cost counted from rest (discount {claim.discount:g}) is at most "
                     f"{about}'P_cost {about}")
    return f"From every x0 with {about}'P {about} <= 1 ({_size(claim, size)}): " + "; ".join(parts) + "."


def _size(claim: Attraction, size: float) -> str:
    if claim.directions is None:
        return f"volume at least {at_least(size)}"
    if claim.shape == "reach":
        return f"each direction times {at_least(size)} inside"
    return f"the directions' mean scale at least {at_least(size)}"


def _speed(plant: Plant, inc: INC, claim: Attraction) -> str:
    if claim.rate is None:
        return ""
    V = "x'P x" if inc.preserves_origin else "(x - x*)'P (x - x*)"
    if plant.discrete:
        return f", {V} shrinking at least by the factor {at_most(claim.rate)}^2 in every step"
    return f", {V} decaying at least as exp(-{at_least(claim.rate)} t), t in seconds"
