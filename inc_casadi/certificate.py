"""Certificates: numbers that prove a claim, re-checked from the numbers each time they are asked."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from . import exact
from .activations.stack import lipschitz
from .arrays import Array, matrix, symmetric, vector
from .claims.base import Claim
from .errors import InvalidInputError, NotCertifiedError
from .inc import INC
from .loop import ClosedLoop, close_loop, stacked_matrices
from .multipliers import Multiplier, Unknown, as_multiplier
from .plant import Plant, as_plant
from .readings import Rational, Reading, Rounded

EIGENVALUE_ROUNDING = 8.0  # eigvalsh errs by less than this times size eps norm


@dataclass(frozen=True)
class Proof:
    """The outcome of `Certificate.prove`: whether it succeeded, by which method, in how many seconds, and why not."""

    succeeded: bool
    method: str
    seconds: float
    reason: str = ""

    def __bool__(self) -> bool:
        return self.succeeded


class Certificate(ABC):
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

        Raises NotCertifiedError with the reason when it does not.
        """
        reason = self.reason
        if reason:
            raise NotCertifiedError(reason)
        return self

    def save(self, path: str | Path) -> None:
        """Write the certificate to a JSON file that `inc_casadi.load` reads."""
        from .interchange import save
        save(self, path)

    def __str__(self) -> str:
        return self.sentence


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
        names = [unknown.name for unknown in self._unknowns]
        if sorted(names) != sorted(self.values):
            given = ", ".join(sorted(self.values)) or "nothing"
            raise InvalidInputError(f"values holds {given}, but claim and multiplier {self.multiplier.name} ask for "
                                    f"{', '.join(names)}")
        values: dict[str, Array] = {}
        for unknown in self._unknowns:
            value = self.values[unknown.name]
            if unknown.is_symmetric:
                values[unknown.name] = symmetric(unknown.name, value, unknown.shape[0])
            elif len(unknown.shape) == 2:
                values[unknown.name] = matrix(unknown.name, value, (unknown.shape[0], unknown.shape[1]))
            else:
                values[unknown.name] = vector(unknown.name, value, unknown.shape[0])
        object.__setattr__(self, "values", MappingProxyType(values))

    @cached_property
    def loop(self) -> ClosedLoop:
        """The closed loop of plant and controller."""
        return close_loop(self.plant, self.inc)

    @property
    def bound(self) -> float:
        """The number that the claim states: a cost, or a rate."""
        return self.claim.bound(self.loop, self.values)

    def margins(self) -> dict[str, float]:
        """Return how far each condition is from failing, relative and with rounding taken off.

        "well-posed": min_i (v - S|W|v)_i / v_i with the weights v of the controller's test, about 1 - lambda_pf(S|W|).
        "<unknown> >= 0": the smallest entry; zero is enough. Any other: the smallest eigenvalue of D^-1 M D^-1, where
        D_i^2 is the sum of the magnitudes of all terms that make up M_ii, so that the figure is what cancellation
        has left and does not change with the units of a state or of a hidden unit; less a bound on every rounding error
        made in forming M and on that of the eigenvalue. When this leaves the sign open, exact arithmetic decides it, and
        the margin is the computed eigenvalue, but positive if and only if M > 0.
        """
        margins = {"well-posed": self._contraction_margin()}
        for unknown in self._unknowns:
            if unknown.signed.any():
                margins[f"{unknown.name} >= 0"] = float(self.values[unknown.name][unknown.signed].min())
        with np.errstate(over="ignore", invalid="ignore"):
            conditions = self._conditions(Rounded)
        for name, condition in conditions.items():
            smallest, room = _smallest_eigenvalue(condition)
            if smallest - room > 0 or not smallest + room >= 0:
                margins[name] = smallest - room
            else:
                margins[name] = _with_sign(smallest, exact.is_positive_definite(self._rational[name].numbers))
        return margins

    @property
    def reason(self) -> str:
        """Why the certificate does not hold: the assumption that fails, or the worst margin; empty when it holds."""
        refusal = self.multiplier.refusal(self.loop)
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
        worst = min(failing, key=lambda name: failing[name])
        return (f"with the {self.multiplier.name} multiplier, the condition {worst!r} has the relative margin "
                f"{failing[worst]:.3g}, and a positive one is needed")

    @property
    def sentence(self) -> str:
        """What is proved, in one sentence, or that nothing is."""
        reason = self.reason
        return f"Not certified: {reason}." if reason else self.claim.sentence(self.loop, self.values)

    def prove(self) -> Proof:
        """Settle every condition in exact rational arithmetic from the stored doubles; no rounding takes part.

        What is taken on trust: the facts that each activation states about itself.
        """
        start = time.perf_counter()
        reason = self._exact_reason()
        return Proof(not reason, "exact rational arithmetic", time.perf_counter() - start, reason)

    def _exact_reason(self) -> str:
        refusal = self.multiplier.refusal(self.loop)
        if refusal:
            return refusal
        if not exact.contracts(lipschitz(self.inc.activations), self.inc.W, self.inc.well_posedness().weights):
            return self._not_well_posed()
        obstacle = self.claim.obstacle(self.plant, self.inc, exactly=True)
        if obstacle:
            return obstacle
        for unknown in self._unknowns:
            if not np.all(self.values[unknown.name][unknown.signed] >= 0):
                return f"{unknown.name} has a negative entry"
        for name, condition in self._rational.items():
            if not exact.is_positive_definite(condition.numbers):
                return f"with the {self.multiplier.name} multiplier, the condition {name!r} is not positive definite"
        return ""

    def _conditions(self, kind: type[Reading]) -> dict[str, Any]:
        loop = _read(self.loop, kind)
        values = {name: kind.lift(value) for name, value in self.values.items()}
        return self.claim.conditions(loop, values, self.multiplier.matrix(loop, values))

    @cached_property
    def _unknowns(self) -> tuple[Unknown, ...]:
        return (*self.claim.unknowns(self.loop), *self.multiplier.unknowns(self.loop))

    @cached_property
    def _rational(self) -> dict[str, Rational]:
        """The conditions without any rounding."""
        return self._conditions(Rational)

    def _contraction_margin(self) -> float:
        weights, W, slope = self.inc.well_posedness().weights, self.inc.W, lipschitz(self.inc.activations)
        if not (np.all(np.isfinite(weights)) and np.all(weights > 0)):
            return -np.inf
        slack = Rounded.lift(weights) - (Rounded.lift(slope[:, None]) * np.abs(W)) @ weights
        smallest = float(np.min(slack.value / weights, initial=1.0))
        lowest = float(np.min((slack.value - slack.error) / weights, initial=1.0))
        if lowest > 0 or np.any(slack.value + slack.error < 0):
            return lowest
        return _with_sign(smallest, exact.contracts(slope, W, weights))

    def _not_well_posed(self) -> str:
        test = self.inc.well_posedness()
        return (f"the controller is not proved well posed: lambda_pf(S|W|) = {test.radius:.6g} is not below 1 "
                "(thm:wellposed), so no motion of the loop is defined for certain")


def _read(loop: ClosedLoop, kind: type[Reading]) -> ClosedLoop:
    """Return the loop with its matrices formed anew from the stored floats, in another kind of arithmetic."""
    plant, inc = loop.plant, loop.inc
    parts = [kind.lift(part) for part in (plant.A, plant.B, plant.C, inc.W, inc.U, inc.V, inc.K)]
    F, G, Z, X, H = stacked_matrices(*parts)
    return replace(loop, F=F, G=G, Z=Z, X=kind.lift(X), H=kind.lift(H), lower=kind.lift(loop.lower),
                   upper=kind.lift(loop.upper))


def _passes(name: str, margin: float) -> bool:
    return margin >= 0 if name.endswith(">= 0") else margin > 0


def _smallest_eigenvalue(condition: Rounded) -> tuple[float, float]:
    """Return the smallest eigenvalue of D^-1 M D^-1 and a bound on its error; (-inf, 0) after an overflow."""
    value, size, error = condition.value, condition.size, condition.error
    if not np.all(np.isfinite(size)):
        return -np.inf, 0.0
    scale = np.sqrt(np.diag(size))
    scale = np.where(scale > 0, scale, 1.0)
    scaled, room = value / np.outer(scale, scale), error / np.outer(scale, scale)
    rounding = EIGENVALUE_ROUNDING * len(scaled) * np.finfo(float).eps * np.linalg.norm(scaled)
    return float(np.linalg.eigvalsh((scaled + scaled.T) / 2)[0]), float(np.linalg.norm(room) + rounding)


def _with_sign(estimate: float, positive: bool) -> float:
    """Return a floating-point estimate of a margin whose sign is known."""
    return max(estimate, np.finfo(float).tiny) if positive else min(estimate, 0.0)
