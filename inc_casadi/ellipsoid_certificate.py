"""The certificate of an ellipsoid of attraction: the numbers of a local method, judged anew each time they are asked."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any

from numpy.typing import ArrayLike

from .arrays import Array
from .certificate import EXACT, FLOAT, Certificate, Proof
from .certificate_values import checked_value, posed_unknowns
from .claims.attraction import Attraction
from .definite import smallest_eigenvalue, with_sign
from .errors import InvalidInputError
from .inc import INC
from .local import checks
from .local.base import LocalMethod, Setting
from .local.methods import method_of
from .local.rest import Rest, rest_of
from .local.words import ROUNDING, promise
from .loop import ClosedLoop, close_loop
from .multipliers import Unknown
from .plant import Plant, as_plant
from .readings import Rational, Rounded
from .sets import Ellipsoid
from .storage_function import quadratic_about

NO_REST = ("the ellipsoid is counted from an equilibrium, and none is known rigorously: the loop has none, or a unit is "
           "curved, or it is too large")


@dataclass(frozen=True, eq=False)
class EllipsoidCertificate(Certificate):
    """An `Attraction` proved by a local method: the ellipsoid {e'P e <= 1} around the equilibrium, with its multipliers.

    plant, inc, claim: what it speaks about; method: the name of the local method; values: one array per unknown of the
    method, P (n, n) first, and T (q,) where well-posedness needs one; empty when none were found; note: how they were found,
    or why not.

    The equilibrium is computed again from plant and controller. A condition may be undecided in floats with their rounding
    bounded; then it is decided in exact fractions, so that `holds` is never wrong.

    Raises InvalidInputError or DimensionError when the values are not those that the method asks for.

    >>> from inc_casadi import Box
    >>> law, values = INC.saturated([[-1.0]], 1.0), {"P": [[0.9]], "H": [[-0.8]]}
    >>> found = EllipsoidCertificate(Plant([[1.5]], [[1.0]]), law, Attraction(Box([-1.0], [1.0])), "convex hull", values)
    >>> found.holds(), found.prove().succeeded, round(found.volume, 4)
    (True, True, 2.1082)
    """

    plant: Plant
    inc: INC
    claim: Attraction
    method: str
    values: Mapping[str, Array] = field(repr=False)
    note: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "plant", as_plant(self.plant))
        if not isinstance(self.claim, Attraction):
            raise InvalidInputError(f"claim is {self.claim!r}, but an ellipsoid certificate needs an Attraction claim")
        close_loop(self.plant, self.inc)
        self.claim.check(self.plant, self.inc)
        self._way  # noqa: B018  # looking the method up is the check that it exists
        object.__setattr__(self, "values", MappingProxyType(self._checked_values() if self.values else {}))

    def _checked_values(self) -> dict[str, Array]:
        if self._refusal:
            raise InvalidInputError(f"values are given, but the method {self.method!r} has no use for any: {self._refusal}")
        wanted = {unknown.name: unknown for unknown in self._unknowns}
        if sorted(wanted) != sorted(self.values):
            given = ", ".join(sorted(self.values))
            raise InvalidInputError(f"values holds {given}, but the method {self.method!r} asks for {', '.join(wanted)}")
        return {name: checked_value(unknown, self.values[name]) for name, unknown in wanted.items()}

    @property
    def ellipsoid(self) -> Ellipsoid:
        """The ellipsoid, its center rounded to floats.

        Raises InvalidInputError when P is not positive definite or there is none.
        """
        if not self.values or self._rest is None:
            raise InvalidInputError(f"the certificate has no ellipsoid: {self.reason}")
        return Ellipsoid(self.values["P"], self._rest.center)

    def storage(self, x: ArrayLike) -> float | Array:
        """Return V(x) = e'P e, e = x - x*, at a state (n,) or columns (n, N); every motion from V <= 1 keeps V <= 1.

        Raises InvalidInputError where no ellipsoid was found.
        """
        found = self.ellipsoid
        return quadratic_about(x, found.P, found.center)

    @property
    def storage_level(self) -> float:
        """1: the ellipsoid itself."""
        return 1.0

    @property
    def volume(self) -> float:
        """The volume of the ellipsoid, up to rounding; 0 where nothing is certified."""
        return self.ellipsoid.volume if self.values and self.holds() else 0.0

    @property
    def bound(self) -> float:
        """What the claim maximizes, rounded down by 1e-9 of its size: the volume or the scale s; 0 without a certificate."""
        if not self.values or not self.holds():
            return 0.0
        size = self.ellipsoid.volume if self.claim.directions is None else self.claim.merit(self.values["P"])
        return size * (1 - ROUNDING)

    def margins(self) -> dict[str, float]:
        """Return how far each condition is from failing, as `MatrixCertificate.margins` measures it; positive is good.

        "well-posed": that of the controller; "<name> >= 0": the smallest entry, for which zero is enough; any other: the
        smallest relative eigenvalue less all rounding, positive if and only if the condition holds.
        """
        margins = {"well-posed": checks.posed_margin(self.inc, self.values.get("T"))}
        if not self.values:
            return margins
        for unknown in self._unknowns:
            if unknown.signed.any():
                margins[f"{unknown.name} >= 0"] = float(self.values[unknown.name][unknown.signed].min())
        for name, entries in self._way.signs(self._setting.read(Rational), checks.lifted(self.values, Rational)).items():
            margins[f"{name} >= 0"] = min((float(entry) for entry in entries.fractions().flat), default=0.0)
        for name, condition in self._rounded.items():
            smallest, room = smallest_eigenvalue(condition)
            clear = smallest - room > 0 or not smallest + room >= 0
            margins[name] = smallest - room if clear else with_sign(smallest, self._decided(name, condition))
        return margins

    @property
    def reason(self) -> str:
        """Why the certificate does not hold: the assumption that fails, or the worst margin; empty when it holds."""
        if not self.values:
            return self.note or self._refusal or "no numbers are stored"
        margins = self.margins()
        if not margins["well-posed"] > 0:
            return f"the controller is not proved well posed: {self.inc.well_posedness().test} (thm:wellposed)"
        failing = {name: value for name, value in margins.items() if not (value > 0 or value == 0 and name.endswith(">= 0"))}
        if not failing:
            return ""
        worst = min(failing, key=lambda name: failing[name])
        return (f"by the method {self.method!r}, the condition {worst!r} has the relative margin {failing[worst]:.3g}, and "
                "a positive one is needed" + (f" ({self.note})" if self.note else ""))

    @property
    def sentence(self) -> str:
        """What is proved, in one sentence, or that nothing is."""
        reason = self.reason
        if reason:
            return f"Not certified: {reason}."
        return promise(self.plant, self.inc, self.claim, self.bound, self.ellipsoid.center)

    def prove(self, method: str = "auto") -> Proof:
        """Settle every condition rigorously from the stored doubles.

        method: "float" takes floating point with every rounding bounded, "exact" rational arithmetic, "auto" the former and
        then the latter for what is left undecided. What is taken on trust: the facts that each activation states about
        itself.

        Raises InvalidInputError for another method.
        """
        if method not in ("auto", "float", "exact"):
            raise InvalidInputError(f"method is {method!r}, but must be 'auto', 'float' or 'exact'")
        start = time.perf_counter()
        reason, means = self._structure(), FLOAT
        if not reason and (method == "exact" or not self.surely()):
            reason = checks.first_failing(self._way, self._setting, self.values)
            means = EXACT
            if method == "float":
                reason, means = reason or "too close for floating point: ask for method 'exact'", FLOAT
        return Proof(not reason, means, time.perf_counter() - start, reason)

    def surely(self) -> bool:
        """Return whether floats alone, every rounding bounded, show that `holds`; False leaves it open."""
        return not self._structure() and checks.is_satisfied(self._way, self._setting, self.values)

    def _structure(self) -> str:
        """What stands in the way apart from the inequalities; decided without rounding."""
        if not self.values:
            return self.note or self._refusal or "no numbers are stored"
        if not checks.posed_margin(self.inc, self.values.get("T")) > 0:
            return f"the controller is not proved well posed: {self.inc.well_posedness().test} (thm:wellposed)"
        return ""

    @cached_property
    def loop(self) -> ClosedLoop:
        """The closed loop of plant and controller."""
        return close_loop(self.plant, self.inc)

    @cached_property
    def _rest(self) -> Rest | None:
        return rest_of(self.loop)

    @cached_property
    def _setting(self) -> Setting:
        assert self._rest is not None
        return Setting(self.loop, self.claim, self._rest)

    @cached_property
    def _refusal(self) -> str:
        """Why the method does not apply, or an empty string."""
        return NO_REST if self._rest is None else self._way.applies(self._setting) or ""

    @property
    def _way(self) -> LocalMethod:
        return method_of(self.method)

    @cached_property
    def _unknowns(self) -> tuple[Unknown, ...]:
        return (*self._way.unknowns(self._setting), *posed_unknowns(self.inc))

    @cached_property
    def _rounded(self) -> dict[str, Rounded]:
        return checks.rounded_conditions(self._way, self._setting, self.values)

    @cached_property
    def _rational(self) -> dict[str, Any]:
        return checks.exact_conditions(self._way, self._setting, self.values)

    def _decided(self, name: str, condition: Rounded) -> bool:
        return checks.decided(condition, lambda: self._rational[name])
