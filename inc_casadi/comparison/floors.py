"""Lower bounds on the cost of each class of controllers, or in words why there is none."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from math import inf
from time import perf_counter

from .. import bounds
from ..bounds import Bound
from ..bounds.static_output_feedback import static_output_feedback
from ..brief import Brief
from ..errors import INCError
from ..figures import at_least
from ..plant import Plant
from ..spec import Spec
from .effort import Effort, Say
from .families import ANY, LINEAR, STATIC, Family


@dataclass(frozen=True, eq=False)
class Floor(Brief):
    """What no member of a class can undercut.

    Parameters
    ----------
    family : the class
    bound : the lower bound with its numbers, or None
    reason : why there is none
    seconds : wall time
    """

    family: Family
    bound: Bound | None = field(repr=False)
    reason: str = ""
    seconds: float = 0.0

    @property
    def value(self) -> float:
        """The bound, minus infinity when there is none."""
        return -inf if self.bound is None else float(self.bound)

    def holds(self) -> bool:
        """Return whether there is a bound and its stored numbers prove it."""
        return self.bound is not None and self.bound.holds()


def floors(plant: Plant, spec: Spec, families: Iterable[Family], effort: Effort, say: Say) -> tuple[Floor, ...]:
    """Return the lower bound of each class; one that cannot be had is a Floor with its reason.

    >>> from inc_casadi import Box
    >>> spec = Spec(1.0, 0.0, 1.0, Box(-1, 1), Box(-1, 1))
    >>> [floor] = floors(Plant(1.5, 1.0), spec, [LINEAR], Effort(), print)
    lower bound, linear controllers: 0.4166666
    >>> floor.holds()
    True
    """
    return tuple(_floor(plant, spec, family, effort, say) for family in families)


def _floor(plant: Plant, spec: Spec, family: Family, effort: Effort, say: Say) -> Floor:
    begun = perf_counter()
    try:
        bound = _BOUNDS[family](plant, spec, effort)
    except INCError as error:
        say(f"lower bound, {family.title}: none, {error}")
        return Floor(family, None, str(error), perf_counter() - begun)
    say(f"lower bound, {family.title}: {at_least(bound.value)}")
    return Floor(family, bound, "", perf_counter() - begun)


def _any(plant: Plant, spec: Spec, effort: Effort) -> Bound:
    return bounds.any_output_feedback(plant, spec, cells=effort.cells)


def _linear(plant: Plant, spec: Spec, effort: Effort) -> Bound:
    return bounds.affine_moves(plant, spec, effort.moves)


def _static(plant: Plant, spec: Spec, effort: Effort) -> Bound:
    return static_output_feedback(plant, spec, seconds=effort.seconds, seed=effort.seed)


_BOUNDS: dict[Family, Callable[[Plant, Spec, Effort], Bound]] = {ANY: _any, LINEAR: _linear, STATIC: _static}
