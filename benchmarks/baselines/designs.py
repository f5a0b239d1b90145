"""All baselines by name, and their designs for a plant with what they took."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import process_time
from types import MappingProxyType
from typing import Any

from inc_casadi.errors import INCError

from ..plants.paper import Case
from .dynamic import best_dynamic
from .estimated import saturated_lqg, scaled_lqg
from .predictive import predictive
from .saturated import clipped_gain, saturated_lqr
from .static import best_linear_gain, scaled_lqr

Baseline = Callable[[Case, int], Any]

BASELINES: Mapping[str, Baseline] = MappingProxyType({
    "best linear gain": best_linear_gain,
    "scaled LQR": scaled_lqr,
    "saturated LQR": lambda case, seed: saturated_lqr(case.plant, case.spec),
    "clipped gain": clipped_gain,
    "LQG": scaled_lqg,
    "saturated LQG": saturated_lqg,
    "best dynamic linear": best_dynamic,
    "MPC": predictive,
})


@dataclass(frozen=True, eq=False)
class Designed:
    """What a baseline made of a plant: the controller or None, the CPU seconds of the design, why there is none or ""."""

    controller: Any
    seconds: float
    reason: str


def design(case: Case, seed: int = 0, baselines: Mapping[str, Baseline] = BASELINES) -> dict[str, Designed]:
    """Return the controllers of all baselines by name: each an INC, a LinearController or a DynamicINC.

    case : plant and specification; seed : of searches with random starts

    >>> from ..plants import scalar
    >>> found = design(scalar(0.9, 0.05))
    >>> [name for name, one in found.items() if one.controller is None]
    ['clipped gain', 'LQG', 'saturated LQG']
    >>> found["LQG"].reason[:39]
    'the plant measures its full state, so t'
    """
    return {name: _designed(baseline, case, seed) for name, baseline in baselines.items()}


def _designed(baseline: Baseline, case: Case, seed: int) -> Designed:
    begun = process_time()
    controller, reason = None, ""
    try:
        controller = baseline(case, seed)
    except INCError as error:
        reason = str(error)
    return Designed(controller, process_time() - begun, reason)
