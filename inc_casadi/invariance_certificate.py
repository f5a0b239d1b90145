"""The certificate of eq:regional_input_check: inputs within limits and a next state in the region, from everywhere in it."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .activations.stack import slopes
from .arrays import Array
from .certificate import FLOAT, Certificate, Proof
from .claims.invariance import Invariance, Slacks
from .errors import InvalidInputError
from .figures import at_least
from .inc import INC
from .invariance_evidence import Evidence
from .loop import close_loop
from .mixed_integer import TOLERANCE
from .pieces.walk import Budget
from .plant import Plant, as_plant
from .well_posed import is_proved

METHODS = ("pieces", "mixed-integer", "bounds")
MOST_PIECES = 50_000  # up to which "auto" cuts: a second or two


@dataclass(frozen=True, eq=False)
class InvarianceCertificate(Certificate):
    """A claim of invariance with the method that decides it; nothing found is stored, all is found again when asked.

    plant, inc, claim: what it speaks about; method: "pieces" (exact, for piecewise-affine controllers; in floats for
    `holds`, where a slack below 1e-9 of its terms is settled in Fractions), "bounds" (branch and bound, rigorous in floats,
    for every activation) or "mixed-integer" (HiGHS; up to the solver's tolerance); budget: pieces also counts the cells
    of a branch and bound, seconds; note: how the method was chosen.

    Raises InvalidInputError for another claim or method, DimensionError when sizes do not fit.
    """

    plant: Plant
    inc: INC
    claim: Invariance
    method: str = "pieces"
    budget: Budget = Budget()
    note: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "plant", as_plant(self.plant))
        close_loop(self.plant, self.inc)
        if not isinstance(self.claim, Invariance):
            raise InvalidInputError(f"claim is {self.claim!r}, but an invariance certificate needs an Invariance claim")
        if self.method not in METHODS:
            raise InvalidInputError(f"method is {self.method!r}, but must be one of {', '.join(METHODS)}")
        self.claim.check(self.plant)

    @cached_property
    def slacks(self) -> Slacks | None:
        """What the method finds, or None where it does not apply."""
        return None if self._structure else self._evidence.slacks(self.method)

    @property
    def bound(self) -> float:
        """The smallest slack over the region, as the method bounds it from below; -inf when nothing is known."""
        return -np.inf if self.slacks is None else float(self.slacks.least.min())

    @property
    def worst(self) -> tuple[float, Array]:
        """The smallest slack met at a point of the region, and that point (n,); infinite and NaN when none was looked at."""
        if self.slacks is None:
            return np.inf, np.full(self.plant.n, np.nan)
        row = int(np.argmin(self.slacks.reached))
        return float(self.slacks.reached[row]), self.slacks.points[row]

    def margins(self) -> dict[str, float]:
        """Return lower bounds on what is left of each part; zero is enough, except for "well-posed".

        "well-posed": 1 - contraction rate, or the monotonicity under a multiplier T; "inputs": the smallest h_u - H_u u;
        "next state": the smallest h - H x+, both in the units of the half-spaces. "bounds" stops when the sign is clear, so
        its figures may be far below the true slack; those of "pieces" hold up to rounding, of "mixed-integer" up to its
        tolerance.
        """
        margins = {"well-posed": self.inc.well_posedness().margin}
        limits = self.claim.limits
        least = np.full(limits + 1, -np.inf) if self.slacks is None else self.slacks.least
        if limits:
            margins["inputs"] = float(least[:limits].min())
        return margins | {"next state": float(least[limits:].min())}

    @cached_property
    def counterexample(self) -> tuple[int, Array, float] | None:
        """A row of the claim that fails, a point (n,) of the region where it does, and a lower bound on by how much.

        The point is in the region exactly, and the excess is positive whatever rounding did. None when none is known.
        """
        return None if self.slacks is None else self._evidence.counterexample(self.slacks)

    @property
    def reason(self) -> str:
        """Why the certificate does not hold; empty when it does."""
        if self._structure or self.slacks is None:
            return self._structure
        if self.counterexample is not None:
            row, point, excess = self.counterexample
            return f"{self.claim.name(row)} is exceeded by {at_least(excess, 4)} at x = {_printed(point)}"
        failing = np.flatnonzero(~(self.slacks.least >= self._evidence.needed(self.method, self.slacks.least)))
        if failing.size == 0:
            return ""
        if self.method == "pieces" and not self.slacks.ended:
            return self._exact_trouble
        return self._undecided(self.slacks, int(failing[np.argmin(self.slacks.least[failing])]))

    @property
    def sentence(self) -> str:
        """What is proved, in one sentence, or that nothing is."""
        if self.reason:
            return f"Not certified: {self.reason}."
        limits = "" if self.claim.inputs is None else "the input lies within its limits and "
        rest = ""
        if self.method == "mixed-integer":
            rest = f", as far as a mixed-integer solver with a tolerance of {TOLERANCE:g} can tell"
        return (f"From every state of the region {limits}the next state lies in the region again, so a motion that starts "
                f"in it stays in it{rest}.")

    def prove(self) -> Proof:
        """Settle the claim rigorously.

        Well-posedness is checked in Fractions. Then branch and bound is a proof as it stands, every rounding bounded (it
        takes curved activations for computed within 8 eps of 1 + |phi|); for the other methods it is tried for at most
        20000 cells and five seconds, which is enough wherever there is slack. Where it leaves the claim open, the pieces are
        cut once more in Fractions, if there are at most 2000. Nothing that a mixed-integer solver said is used, and
        nothing is tried when the certificate does not hold.
        """
        start = time.perf_counter()
        trouble, method = self.reason or self._posed_trouble(), f"branch and bound in {FLOAT}"
        if not trouble and self.method != "bounds" and not self._is_bounded:
            trouble, method = self._exact_trouble, "exact fractions over all pieces"
        return Proof(not trouble, method, time.perf_counter() - start, trouble)

    @cached_property
    def _is_bounded(self) -> bool:
        """Whether a short branch and bound proves the claim."""
        short = replace(self.budget, pieces=min(self.budget.pieces, 20_000), seconds=min(self.budget.seconds, 5.0))
        return bool(np.all(replace(self._evidence, budget=short).slacks("bounds").least >= 0))

    @cached_property
    def _evidence(self) -> Evidence:
        return Evidence(self.plant, self.inc.without_idle_units(), self.claim, self.budget)

    @cached_property
    def _exact_trouble(self) -> str:
        rough = self.slacks if self.method == "pieces" else self._evidence.slacks("pieces")
        assert rough is not None
        return self._evidence.exact_trouble(rough)

    @cached_property
    def _structure(self) -> str:
        if not self.plant.discrete:
            return "a next state needs discrete time: sample the plant first, plant.sampled(dt)"
        for i, unit in enumerate(self._evidence.inc.activations):
            if unit.pieces is None and self.method != "bounds":
                return f"hidden unit {i} has activation {unit}, which is not piecewise affine: take the method 'bounds'"
        for law in (self.inc, self._evidence.inc):
            if not law.well_posedness().holds:
                return f"the controller is not proved well posed: {law.well_posedness().test}"
        return ""

    def _posed_trouble(self) -> str:
        for law in (self.inc, self._evidence.inc):
            if not is_proved(law.well_posedness(), law.W, slopes(law.activations)):
                return f"the controller is not proved well posed: {law.well_posedness().test}"
        return ""

    def _undecided(self, found: Slacks, row: int) -> str:
        least, what = found.least[row], self.claim.name(row)
        if found.ended:
            met = found.reached[row]
            where = f", and {met:.3g} at x = {_printed(found.points[row])}" if np.isfinite(met) else ""
            return f"{what} is undecided ({found.ended}): its slack is at least {least:.3g}{where}"
        return f"{what} is undecided: its slack is {least:.3g}, too near 0 for the tolerance of a mixed-integer solver"


def certify_invariance(plant: Plant, inc: INC, claim: Invariance, method: str = "auto",
                       budget: Budget | None = None) -> InvarianceCertificate:
    """Return the certificate that a region is invariant and inputs stay within limits, or one that says why not.

    method: "pieces", "mixed-integer", "bounds", or "auto": pieces where every unit is piecewise affine, at most 50000 of
    them, and bounds otherwise or when pieces leave it open. budget: pieces (or cells) and seconds for each method.

    Raises DimensionError or InvalidInputError for arguments that do not fit.

    >>> from inc_casadi import Box
    >>> claim = Invariance(Box([-1.0], [1.0]), Box([-1.0], [1.0]))
    >>> certificate = certify_invariance(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0), claim)
    >>> certificate.holds(), certificate.prove().succeeded, certificate.margins()["next state"]
    (True, True, 0.5)
    """
    budget = budget or Budget()
    if method != "auto":
        return InvarianceCertificate(plant, inc, claim, method, budget)
    curved = [unit for unit in inc.without_idle_units().activations if unit.pieces is None]
    if curved:
        return InvarianceCertificate(plant, inc, claim, "bounds", budget, f"bounds, because {curved[0]} has no pieces")
    few = replace(budget, pieces=min(budget.pieces, MOST_PIECES))
    first = InvarianceCertificate(plant, inc, claim, "pieces", few, "exact pieces")
    if first.holds() or first.counterexample is not None or first.slacks is None:
        return first
    second = InvarianceCertificate(plant, inc, claim, "bounds", budget, f"bounds, because of pieces: {first.reason}")
    return second if second.holds() or second.counterexample is not None else first


def _printed(point: Array) -> str:
    return np.array2string(point, precision=6, separator=", ")
