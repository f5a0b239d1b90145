"""Controllers beside the lower bounds of classes: who is separated from whom, how far from the best, contradictions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isfinite, nan
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from ..brief import Brief
from ..certificate import Proof
from ..errors import INCError, InvalidInputError
from ..figures import at_least, at_most
from ..plant import Plant
from ..spec import Spec
from .families import ANY, Family, family_of
from .floors import Floor
from .row import Row
from .sentences import relative_gap

if TYPE_CHECKING:
    from .statements import Statement

ROUNDING = 1e-9  # by this share a cost may be below a bound that it attains


@dataclass(frozen=True)
class Inversion:
    """A contradiction: a controller of a class whose certified cost lies below the lower bound of that class."""

    name: str
    family: Family
    cost: float
    bound: float

    def __str__(self) -> str:
        return (f"{self.name} is certified to cost at most {at_most(self.cost)}, but the lower bound of its class, "
                f"{self.family.title}, is {at_least(self.bound)}")


@dataclass(frozen=True, eq=False)
class Comparison(Brief):
    """What `compare` returns; `print(comparison)` shows table, lower bounds and sentences, `.plot()` the chart.

    A controller is separated from a class when its certified cost is below the class's lower bound
    (thm:general_superiority); it is within a share of the best possible by the bound on every controller. Nothing beats
    every static nonlinear law (prop:no_arbitrary_sof), so no controller is ever separated from the class of all.

    Parameters
    ----------
    plant, spec : what it is about
    rows : what is known of each controller
    floors : the lower bounds asked for
    proofs : what `proved` settled, by name; empty when nothing was tried
    """

    plant: Plant = field(repr=False)
    spec: Spec = field(repr=False)
    rows: tuple[Row, ...]
    floors: tuple[Floor, ...]
    proofs: Mapping[str, Proof] = field(default_factory=lambda: MappingProxyType({}), repr=False)

    def row(self, name: str) -> Row:
        """Return what is known of the controller of that name; raises InvalidInputError when there is none."""
        for row in self.rows:
            if row.name == name:
                return row
        known = ", ".join(repr(row.name) for row in self.rows) or "none"
        raise InvalidInputError(f"no controller is named {name!r}; the controllers are {known}")

    def floor(self, family: Family | str) -> Floor | None:
        """Return the highest lower bound on a class that holds, be it of a larger class; None when there is none."""
        asked = family_of(family) if isinstance(family, str) else family
        valid = [floor for floor in self._sound if floor.family.contains(asked)]
        return max(valid, key=lambda floor: (floor.value, floor.family.rank), default=None)

    def certifies(self, name: str) -> bool:
        """Return whether limits and cost of the controller are certified."""
        return isfinite(self.cost_of(name))

    def cost_of(self, name: str) -> float:
        """Return what the controller costs at most while it keeps the limits; infinite unless both are certified."""
        return self._bounds[self.row(name).name]

    def separates(self, name: str, family: Family | str) -> bool:
        """Return whether the controller is certified to cost less than every member of a class that it is not in."""
        asked, floor = family_of(family) if isinstance(family, str) else family, self.floor(family)
        outside = not asked.contains(self.row(name).family)
        return floor is not None and outside and self.cost_of(name) < floor.value

    def gap(self, name: str) -> float:
        """Return by what share the certified cost may exceed that of the best controller whatever; NaN when unknown."""
        cost, floor = self.cost_of(name), self.floor(ANY)
        if floor is None or not floor.value > 0 or not isfinite(cost):
            return nan
        return relative_gap(floor.value, cost)

    def inversions(self) -> tuple[Inversion, ...]:
        """Return every certified cost that is below the stated bound of a class of which the controller is a member.

        Bounds are taken at their word, whether they hold or not: it is a check on them.
        """
        pairs = [(row, floor) for row in self.rows for floor in self.floors if floor.family.contains(row.family)]
        return tuple(Inversion(row.name, floor.family, self.cost_of(row.name), floor.value) for row, floor in pairs
                     if self.cost_of(row.name) < floor.value - ROUNDING * abs(floor.value))

    def require_consistent(self) -> Comparison:
        """Return the comparison itself; raises INCError when a cost contradicts a bound or a bound does not hold."""
        troubles = [str(inversion) for inversion in self.inversions()]
        troubles += [f"the stored numbers of the lower bound on {floor.family.title} do not prove {floor.value:.7g}"
                     for floor in self.floors if floor.bound is not None and not self.confirms(floor)]
        if troubles:
            raise INCError("the comparison contradicts itself: " + "; ".join(troubles))
        return self

    def prove(self) -> dict[str, Proof]:
        """Settle every certificate and every bound rigorously; by controller's name, and "lower bound, <class>"."""
        found = {row.name: row.prove() for row in self.rows if self.certifies(row.name)}
        return found | {label(floor): floor.bound.prove() for floor in self.floors if floor.bound is not None}

    def proved(self) -> Comparison:
        """Return the comparison with its proofs, which table and statements then speak of."""
        return replace(self, proofs=MappingProxyType(self.prove()))

    def confirms(self, floor: Floor) -> bool:
        """Return whether the stored numbers of a lower bound prove it."""
        return any(floor is one for one in self._sound)

    @cached_property
    def _sound(self) -> tuple[Floor, ...]:
        """The lower bounds that hold."""
        return tuple(floor for floor in self.floors if floor.holds())

    @cached_property
    def _bounds(self) -> dict[str, float]:
        """Certified costs by name."""
        return {row.name: row.bound for row in self.rows}

    @property
    def statements(self) -> tuple[Statement, ...]:
        """The sentences that follow, each with what it rests on."""
        from .statements import statements
        return statements(self)

    def __str__(self) -> str:
        from .table import table
        return table(self)

    def to_rows(self) -> list[dict[str, Any]]:
        """Return controllers and bounds as dictionaries of plain values with the same keys, for CSV or JSON."""
        from .plain import plain_rows
        return plain_rows(self)

    def plot(self, path: str | Path | None = None, **options: Any) -> Any:
        """Return a Matplotlib figure of costs and of what no member of each class can reach; written to `path` if given.

        options: `width` and `dpi` of `inc_casadi.plotting.plot_comparison`.
        """
        from ..plotting.comparison_figure import plot_comparison
        return plot_comparison(self, path, **options)


def label(floor: Floor) -> str:
    """Return the name of a bound in tables and among proofs.

    >>> from .families import LINEAR
    >>> label(Floor(LINEAR, None))
    'lower bound, linear controllers'
    """
    return f"lower bound, {floor.family.title}"
