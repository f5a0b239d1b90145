"""The lower bounds of one plant, each with its budget, and what is written down of them."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from math import isfinite

from benchmarks.plants import Case
from inc_casadi.bounds import affine_moves
from inc_casadi.comparison import Comparison, compare
from inc_casadi.comparison.comparison import label
from inc_casadi.comparison.families import FAMILIES, LINEAR
from inc_casadi.comparison.floors import Floor

from .isolation import attempted, words
from .record import LowerBound
from .settings import Settings


def floors(case: Case, settings: Settings, known: Iterable[Floor] = ()) -> tuple[Floor, ...]:
    """Return lower bounds on any, linear and static control; one that cannot be had is a floor with its reason.

    known : floors that there are already; a class is not worked out again if one holds and no time limit cut any short

    >>> from benchmarks.plants import scalar
    >>> found = floors(scalar(0.9), Settings(gains=0.5))
    >>> [(one.family.key, round(one.value, 4)) for one in found]
    [('any', 0.3583), ('linear', 0.4083), ('static', 0.4301)]
    >>> [one.family.key for one in floors(scalar(0.9), Settings(gains=0.5), found[:2])]
    ['static']
    """
    plant, spec = case.plant, case.spec
    known = [one for one in known if one.bound is not None]
    done = ({one.family.key for one in known if one.holds()}
            - {one.family.key for one in known if one.bound is not None and one.bound.cut_short})
    wanted = [key for key in ("any", "static") if key not in done]
    found = compare(plant, spec, {}, bounds=wanted, cells=settings.cells, seconds=settings.gains, seed=settings.seed).floors
    by_key = {one.family.key: one for one in found}
    if "linear" not in done:
        linear = attempted(partial(affine_moves, plant, spec, seconds=settings.linear))
        by_key["linear"] = (Floor(LINEAR, None, words(linear)) if isinstance(linear, BaseException)
                            else Floor(LINEAR, linear, "", linear.seconds))
    return tuple(by_key[key] for key in ("any", "linear", "static") if key in by_key)


def lower_bounds(found: Comparison) -> tuple[LowerBound, ...]:
    """Return the best bound on each class that holds, or why there is none; a bound that its numbers do not prove is none.

    >>> from benchmarks.plants import scalar
    >>> case = scalar(0.9)
    >>> found = compare(case.plant, case.spec, {}, bounds=["any"], cells=300)
    >>> [(one.family, one.holds, one.reason) for one in lower_bounds(found)]
    [('any', True, ''), ('linear', False, 'not asked for'), ('static', False, 'not asked for')]
    """
    return tuple(_best(found, key) for key in FAMILIES)


def _best(found: Comparison, key: str) -> LowerBound:
    own = [floor for floor in found.floors if floor.family.key == key]
    best = max(own, key=lambda floor: (floor.holds(), floor.value), default=None)
    if best is None:
        return LowerBound(key, None, False, "not asked for")
    reason = best.reason if best.bound is None or best.holds() else f"{label(best)} is not proved by its numbers"
    value = float(best.value) if isfinite(best.value) else None
    return LowerBound(key, value, best.holds(), reason, sum(floor.seconds for floor in own))
