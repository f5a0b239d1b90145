"""What no competitor can go below, and what those cost that are easily found, within a share of the time."""

from __future__ import annotations

import numpy as np

from inc_casadi import Plant, Spec, bounds
from inc_casadi.bounds import Bound
from inc_casadi.errors import INCError
from inc_casadi.figures import at_least

from .competitors import linear_competitors
from .progress import Progress

CELLS = 3_000
FIRST, LINEAR, ANY = "linear controllers, first move", "linear controllers", "any controller"
SHARES = {FIRST: 0.05, LINEAR: 0.15, ANY: 0.15}  # of the seconds for the search
GAINS = 0.1  # of them, for the best static gain


def lower_bounds(plant: Plant, spec: Spec, notes: list[str], progress: Progress) -> dict[str, Bound]:
    """Return lower bounds by name: on linear controllers, from the first move and from many, and on any that measures y.

    Where the progress has a budget of seconds each may take its share. What is found by then is a lower bound that holds; a
    note says that more time may raise it. Why one is missing goes to `notes` too.
    """
    computed: dict[str, Bound] = {}
    for name, compute in ((FIRST, lambda seconds: bounds.first_move(plant, spec, seconds=seconds)),
                          (LINEAR, lambda seconds: bounds.affine_moves(plant, spec, seconds=seconds)),
                          (ANY, lambda seconds: bounds.any_output_feedback(plant, spec, cells=CELLS, seconds=seconds))):
        try:
            with progress.during(f"lower bound, {name}"):
                computed[name] = compute(progress.share(SHARES[name]))
        except INCError as error:
            notes.append(f"no lower bound for {name}: {error}")
            continue
        progress.say(f"lower bound, {name}: {at_least(float(computed[name]))}")
        if computed[name].cut_short:
            notes.append(f"lower bound, {name}: ended after {computed[name].seconds:.1f} s, its share of the time; it "
                         "holds, and more time may raise it")
    return computed


def competitors(plant: Plant, spec: Spec, seed: int, notes: list[str], progress: Progress) -> dict[str, float]:
    """Return the costs of linear competitors by name (`linear_competitors`), within their share of the time."""
    with progress.during("linear gains to compare with"):
        return linear_competitors(plant, spec, seed, notes, progress.say, progress.share(GAINS))


def floor(lower: dict[str, Bound]) -> float:
    """Return the proved lower bound on every controller, -inf without.

    >>> floor({})
    -inf
    """
    bound = lower.get(ANY)
    return float(bound) if bound is not None and bound.holds() else -np.inf
