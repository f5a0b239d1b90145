"""Certificates: numbers that prove a claim, re-checked from the numbers each time they are asked."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from . import exact, monotone
from .activations.stack import lipschitz, slopes
from .arrays import Array
from .brief import Brief
from .certificate_values import checked_value, posed_unknowns
from .claims.base import Claim
from .definite import definiteness, is_surely_positive, smallest_eigenvalue, with_sign
from .errors import InvalidInputError, NotCertifiedError
from .hindrance import FAR, hindrance
from .inc import INC
from .inequalities import Inequalities
from .loop import ClosedLoop, close_loop
from .monotone import lmi_well_posed
from .multipliers import Multiplier, Unknown, as_multiplier
from .plant import Plant, as_plant
from .readings import Rational, Reading, Rounded
from .storage_function import stored_value

AROUND = "Regional and Attraction claim something about a set."
EXACT, FLOAT = "exact rational arithmetic", "floating point with every rounding bounded"


@dataclass(frozen=True)
class Proof:
    """The outcome of `Certificate.prove`: whether it succeeded, by which method, in how many seconds, and why not."""

    succeeded: bool
    method: str
    seconds: float
    reason: str = ""

    def __bool__(self) -> bool:
        return self.succeeded


class Certificate(Brief, ABC):
    """A claim about a loop with the evidence for it; each question is answered anew from the evidence."""

    @property
    @abstractmethod
    def bound(self) -> float:
        """The number that the claim states; `holds` says whether to believe it."""

    @property
    @abstractmethod
    def reason(self) -> str:
        """Why the certificate does not hold, or an empty string when it does."""

    @property
    @abstractmethod
    def sentence(self) -> str:
        """What is proved, in one sentence, or that nothing is."""

    @property
    def advice(self) -> str:
        """What to try instead where the certificate does not hold, in a sentence or two; empty where nothing is known."""
        return ""

    @abstractmethod
    def margins(self) -> Mapping[str, float]:
        """Return the distance from failing of every condition; positive is good."""

    @abstractmethod
    def prove(self) -> Proof:
        """Settle the certificate rigorously."""

    def holds(self) -> bool:
        """Return whether the evidence proves the claim, rounding accounted for."""
        return not self.reason

    def require(self) -> Self:
        """Return the certificate itself when it holds.

        Raises NotCertifiedError with the reason when it does not, and with `advice`.
        """
        reason = self.reason
        if reason:
            raise NotCertifiedError(f"{reason}. {self.advice}" if self.advice else reason)
        return self

    def storage(self, x: ArrayLike) -> float | Array:
        """Return V(x), the storage function that the proof rests on, at a state (n,) or columns (n, N): a number or (N,).

        What V proves is in `sentence`: that it falls along motions, that it bounds the cost to come, or both. It proves
        nothing where V(x) > `storage_level`, nor where the certificate does not hold. In floats, rounding not bounded.

        Raises InvalidInputError where there is none, DimensionError for x of another size.
        """
        raise InvalidInputError(f"a {type(self).__name__} rests on no storage function of the state: one by matrix "
                                "inequalities does, such as certify(plant, inc, Stability()) or Attraction()")

    @property
    def storage_level(self) -> float:
        """The largest c for which {x: V(x) <= c} belongs to the proof: infinite where V speaks of every state."""
        return np.inf

    def save(self, path: str | Path) -> None:
        """Write the certificate to a JSON file that `inc_casadi.load` reads."""
        from .interchange import save
        save(self, path)

    def __str__(self) -> str:
        return f"{self.sentence} {self.advice}".rstrip()


@dataclass(frozen=True, eq=False)
class MatrixCertificate(Certificate):
    """A claim proved by matrix inequalities: the numbers of the claim and of the multiplier, and nothing that follows.

    plant, inc, claim: what the certificate speaks about; multiplier: a `Multiplier` or its name; values: one array per
    unknown of claim and multiplier, say P (n, n) and Lambda (q,); note: how the numbers were found.

    Raises InvalidInputError or DimensionError when the values are not those that claim and multiplier ask for.

    The paper's eq:implicit_example_certificate, checked and proved without any solver:

    >>> from inc_casadi import DiscountedCost, Box, LeakyReLU
    >>> inc = INC([[0.3, 0.2], [0.2, 0.3]], [[1.0], [-1.0]], [[-0.7, 0.7]], [[0.0]], activation=LeakyReLU(0.5))
    >>> claim = DiscountedCost([[1.0]], [[0.05]], 0.98, Box([-1.0], [1.0]))
    >>> values = {"P": [[1.3006]], "Lambda": [0.7749, 0.7749]}
    >>> certificate = MatrixCertificate(Plant([[1.2]], [[1.0]]), inc, claim, "sector", values)
    >>> certificate.holds(), certificate.prove().succeeded, round(certificate.bound, 4)
    (True, True, 0.4335)
    """

    plant: Plant
    inc: INC
    claim: Claim
    multiplier: Multiplier
    values: Mapping[str, Array] = field(repr=False)
    note: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "plant", as_plant(self.plant))
        object.__setattr__(self, "multiplier", as_multiplier(self.multiplier))
        if not isinstance(self.claim, Claim):
            raise InvalidInputError(f"claim is {self.claim!r}, but must be a Claim such as Stability()")
        self.claim.check(self.plant, self.inc)
        wanted = {unknown.name: unknown for unknown in self._unknowns}
        if sorted(wanted) != sorted(self.values):
            given = ", ".join(sorted(self.values)) or "nothing"
            raise InvalidInputError(f"values holds {given}, but claim and multiplier {self.multiplier.name} ask for "
                                    f"{', '.join(wanted)}")
        values = {name: checked_value(unknown, self.values[name]) for name, unknown in wanted.items()}
        object.__setattr__(self, "values", MappingProxyType(values))

    @cached_property
    def loop(self) -> ClosedLoop:
        """The closed loop of plant and controller."""
        return close_loop(self.plant, self.inc)

    @property
    def bound(self) -> float:
        """The number that the claim states: a cost, or a rate."""
        return self.claim.bound(self.loop, self.values)

    def storage(self, x: ArrayLike) -> float | Array:
        """Return V(x) = v'P v at a state (n,) or at columns (n, N); v is the state, and with `Lifted` hidden vectors too.

        v counts from the equilibrium where biases move it; see `Certificate.storage`.

        >>> from inc_casadi import Stability
        >>> law = INC([[0.0]], [[1.0]], [[-0.2]], [[0.0]])
        >>> values = {"P": [[2.0]], "Lambda": [0.1]}
        >>> found = MatrixCertificate(Plant([[0.5]], [[1.0]]), law, Stability(0.9), "sector", values)
        >>> found.holds(), found.storage([[1.0, -3.0]]).tolist()
        (True, [2.0, 18.0])
        """
        return stored_value(x, self.values["P"], self.plant, self.inc)

    def margins(self) -> dict[str, float]:
        """Return how far each condition is from failing, relative and with rounding taken off.

        "well-posed": min_i (v - S|W|v)_i / v_i with the weights v of the controller's test, about 1 - lambda_pf(S|W|); under
        the inequality 2T - TW - W'T > 0 its smallest eigenvalue relative to T (stored, as a value). "<name> >= 0": the
        smallest entry; zero is enough. Any other: the smallest eigenvalue of D^-1 M D^-1, where D_i^2 is the sum of the
        magnitudes of all terms that make up M_ii, so that the figure is what cancellation has left and does not change
        with the units of a state or of a hidden unit; less a bound on every rounding error made in forming M and on that
        of the eigenvalue. When this leaves the sign open, it is decided rigorously, and the margin is the computed
        eigenvalue, but positive if and only if M > 0.
        """
        margins = {"well-posed": self._posed_margin}
        for unknown in self._unknowns:
            if unknown.signed.any():
                margins[f"{unknown.name} >= 0"] = float(self.values[unknown.name][unknown.signed].min())
        with np.errstate(over="ignore", invalid="ignore"):
            for name, entries in self._rounded.signs(self._lifted(Rounded)).items():
                lowest = float(np.min(entries.value - entries.error))
                margins[f"{name} >= 0"] = lowest if lowest >= 0 else float(min(self._rational_signs[name]))
            conditions = self._conditions
        for name, condition in conditions.items():
            smallest, room = smallest_eigenvalue(condition)
            if smallest - room > 0 or not smallest + room >= 0:
                margins[name] = smallest - room
            else:
                margins[name] = with_sign(smallest, self._is_definite(name))
        return margins

    def surely(self, exact_up_to: int = 0) -> bool:
        """Return whether floating point alone, every rounding bounded, shows that `holds`; False leaves it open.

        What a search asks of its numbers: milliseconds, where `holds` may have to settle a close call in exact arithmetic.
        exact_up_to: size of a condition up to which a close call is settled in exact arithmetic here too.
        """
        if self.claim.refusal(self.loop, self.multiplier) or not self._posed_margin > 0:
            return False
        if any(np.any(self.values[u.name][u.signed] < 0) for u in self._unknowns):
            return False
        with np.errstate(over="ignore", invalid="ignore"):
            for name, entries in self._rounded.signs(self._lifted(Rounded)).items():
                undecided = not np.all(entries.value - entries.error >= 0)
                if undecided and (not exact_up_to or min(self._rational_signs[name]) < 0):
                    return False
            conditions = self._conditions
        for name, condition in conditions.items():
            if not (self._is_definite(name) if condition.shape[0] <= exact_up_to else is_surely_positive(condition)):
                return False
        return not self.claim.obstacle(self.plant, self.inc)

    @property
    def reason(self) -> str:
        """Why the certificate does not hold: the assumption that fails, or the worst margin; empty when it holds."""
        refusal = self.claim.refusal(self.loop, self.multiplier)
        if refusal:
            return refusal
        margins = self.margins()
        if not margins["well-posed"] > 0:
            return self._not_well_posed()
        obstacle = self.claim.obstacle(self.plant, self.inc)
        if obstacle:
            return obstacle
        failing = {name: value for name, value in margins.items() if not _passes(name, value)}
        if not failing:
            return ""
        note = f" ({self.note})" if self.note else ""
        if not self.values["P"].any():
            return self.note or "no numbers were found"
        if self._hindrance:
            return f"there is no such certificate: {self._hindrance}{note}"
        worst = min(failing, key=lambda name: failing[name])
        return (f"with the {self.multiplier.name} multiplier, the condition {worst!r} has the relative margin "
                f"{failing[worst]:.3g}, and a positive one is needed{note}")

    @property
    def advice(self) -> str:
        """Claims about a set, where one about every state is hopeless."""
        return "" if self.holds() or not self._hindrance else AROUND if FAR in self._hindrance else ""

    @cached_property
    def _hindrance(self) -> str:
        growth = self.claim.growth(self.plant.discrete)
        return "" if growth is None else hindrance(self.plant, self.inc, growth)

    @property
    def sentence(self) -> str:
        """What is proved, in one sentence, or that nothing is."""
        reason = self.reason
        return f"Not certified: {reason}." if reason else self.claim.sentence(self.loop, self.values)

    def prove(self, method: str = "auto") -> Proof:
        """Settle every condition rigorously from the stored doubles.

        method: "float" takes floating point with every rounding bounded (`definite.is_surely_positive`), milliseconds, and
        leaves what is too close undecided, which counts as not proved; "exact" takes rational arithmetic, no rounding at
        all; "auto" takes the former and settles by the latter what it leaves undecided. The proof says which it took.

        What is taken on trust: the facts that each activation states about itself.

        Raises InvalidInputError for another method.
        """
        if method not in ("auto", "float", "exact"):
            raise InvalidInputError(f"method is {method!r}, but must be 'auto', 'float' or 'exact'")
        start = time.perf_counter()
        if method == "exact":
            reason, means = self._exact_reason(), EXACT
        else:
            proved = self.surely() and not self.claim.obstacle(self.plant, self.inc, exactly=True)
            reason, means = ("", FLOAT) if proved else (self._exact_reason(), EXACT)
            if method == "float" and not proved:
                reason, means = reason or "too close for floating point: ask for method 'exact'", FLOAT
        return Proof(not reason, means, time.perf_counter() - start, reason)

    def _exact_reason(self) -> str:
        refusal = self.claim.refusal(self.loop, self.multiplier)
        if refusal:
            return refusal
        if not self._posed_exactly():
            return self._not_well_posed()
        obstacle = self.claim.obstacle(self.plant, self.inc, exactly=True)
        if obstacle:
            return obstacle
        for unknown in self._unknowns:
            if not np.all(self.values[unknown.name][unknown.signed] >= 0):
                return f"{unknown.name} has a negative entry"
        for name, entries in self._rational_signs.items():
            if any(entry < 0 for entry in entries):
                return f"with the {self.multiplier.name} multiplier, {name} has a negative entry"
        for name, condition in self._rational.items():
            if not exact.is_positive_definite(condition.numbers):
                return f"with the {self.multiplier.name} multiplier, the condition {name!r} is not positive definite"
        return ""

    @cached_property
    def inequalities(self) -> Inequalities:
        """The claim's inequalities over floats."""
        return Inequalities(self.loop, self.claim, self.multiplier)

    @cached_property
    def _rounded(self) -> Inequalities:
        return Inequalities(self.loop.read(Rounded), self.claim, self.multiplier)

    def _lifted(self, kind: type[Reading]) -> dict[str, Any]:
        return {name: kind.lift(value) for name, value in self.values.items()}

    @property
    def _unknowns(self) -> tuple[Unknown, ...]:
        return (*self.inequalities.unknowns, *posed_unknowns(self.inc))

    @cached_property
    def _conditions(self) -> dict[str, Rounded]:
        """The conditions with a bound on every rounding error."""
        return self._rounded.conditions(self._lifted(Rounded))

    @cached_property
    def _exactly(self) -> Inequalities:
        return Inequalities(self.loop.read(Rational), self.claim, self.multiplier)

    @cached_property
    def _rational(self) -> dict[str, Rational]:
        """The conditions without any rounding."""
        return self._exactly.conditions(self._lifted(Rational))

    @cached_property
    def _rational_signs(self) -> dict[str, list[Any]]:
        signs = self._exactly.signs(self._lifted(Rational))
        return {name: list(entries.fractions().flat) for name, entries in signs.items()}

    def _is_definite(self, name: str) -> bool:
        """Decide one condition: in floats where that is enough, in rational arithmetic otherwise."""
        decided = definiteness(self._conditions[name])
        return exact.is_positive_definite(self._rational[name].numbers) if decided is None else decided

    def _posed_exactly(self) -> bool:
        if "T" in self.values:
            return lmi_well_posed(slopes(self.inc.activations), self.inc.W, self.values["T"], True)
        return exact.contracts(lipschitz(self.inc.activations), self.inc.W, self.inc.contraction.weights)

    @cached_property
    def _posed_margin(self) -> float:
        """Positive if and only if the weights, or the stored T, prove that the fixed point is unique."""
        if "T" in self.values:
            return self._monotone_margin()
        weights, W, slope = self.inc.contraction.weights, self.inc.W, lipschitz(self.inc.activations)
        if not (np.all(np.isfinite(weights)) and np.all(weights > 0)):
            return -np.inf
        slack = Rounded.lift(weights) - (Rounded.lift(slope[:, None]) * np.abs(W)) @ weights
        smallest = float(np.min(slack.value / weights, initial=1.0))
        lowest = float(np.min((slack.value - slack.error) / weights, initial=1.0))
        if lowest > 0 or np.any(slack.value + slack.error < 0):
            return lowest
        return with_sign(smallest, exact.contracts(slope, W, weights))

    def _monotone_margin(self) -> float:
        T, ends = self.values["T"], slopes(self.inc.activations)
        if not np.all(T > 0):
            return min(float(T.min()), 0.0)
        root = 1.0 / np.sqrt(T)
        smallest = float(np.linalg.eigvalsh(monotone.condition(ends, self.inc.W, T) * np.outer(root, root))[0])
        proved = lmi_well_posed(ends, self.inc.W, T, False) or lmi_well_posed(ends, self.inc.W, T, True)
        return with_sign(smallest, proved)

    def _not_well_posed(self) -> str:
        return (f"the controller is not proved well posed: {self.inc.well_posedness().test} (thm:wellposed), so no motion "
                "of the loop is defined for certain")


def _passes(name: str, margin: float) -> bool:
    return margin >= 0 if name.endswith(">= 0") else margin > 0
