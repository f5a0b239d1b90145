"""What the certificate of an invariance rests on: slacks by each method, limits built in, counterexamples, exact pieces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property

import numpy as np

from .arrays import Array
from .blocks import exact
from .claims.invariance import Invariance, Slacks
from .errors import ConvergenceError, SolverError
from .inc import INC
from .mixed_integer import TOLERANCE, slacks_by_programs
from .output_bounds.invariance import slacks_by_bounds, sure_excess
from .output_range import output_range
from .pieces.invariance import slacks_by_pieces
from .pieces.laws import PiecewiseLoop
from .pieces.walk import Budget
from .plant import Plant

ROUNDING = 1e-9  # share of a row's terms below which its slack over pieces in floats decides nothing
EXACT_PIECES, PROOF_SECONDS = 2_000, 60.0
INWARD = (0.0, 1e-12, 1e-9, 1e-6)  # how far a corner is moved to the centre until it lies in the region exactly


@dataclass(frozen=True, eq=False)
class Evidence:
    """A claim of invariance about a plant and a well-posed controller, and what can be found out about it.

    inc: without idle units; each question is answered once and remembered.
    """

    plant: Plant
    inc: INC
    claim: Invariance
    budget: Budget

    def slacks(self, method: str) -> Slacks:
        """Return what a method finds; `least` includes the limits that are built in. A solver's failure is its `ended`."""
        try:
            found = self._found(method)
        except (ConvergenceError, SolverError) as error:
            k = self.built_in.size
            found = Slacks(np.full(k, -np.inf), np.full(k, np.inf), np.full((k, self.plant.n), np.nan), str(error), 0, 0.0)
        return replace(found, least=np.maximum(found.least, self.built_in))

    def _found(self, method: str) -> Slacks:
        if method == "pieces":
            return slacks_by_pieces(PiecewiseLoop(self.plant, self.inc), self.claim, self.budget)
        if method == "mixed-integer":
            return slacks_by_programs(self.plant, self.inc, self.claim, self.budget.seconds)
        return slacks_by_bounds(self.plant, self.inc, self.claim, self.built_in >= 0, most_cells=self.budget.pieces,
                                seconds=self.budget.seconds)

    @cached_property
    def built_in(self) -> Array:
        """What the activations' own ranges leave of each row (k,), in Fractions and then rounded down; -inf for nothing."""
        slack = np.full(self.claim.limits + self.claim.region.h.size, -np.inf)
        if self.claim.inputs is not None:
            ends = output_range(self.inc)
            for i, (row, limit) in enumerate(zip(self.claim.inputs.H, self.claim.inputs.h, strict=True)):
                slack[i] = _range_slack(row, limit, ends)
        return slack

    def needed(self, method: str, least: Array) -> Array:
        """Return the slack (k,) from which on a method's own errors cannot turn the verdict: 0 for "bounds".

        For the others it is a share of the row's terms, 1e-9 for pieces in floats and 1e-6 for the mixed-integer solver;
        |G u| is at most the slack and the other terms.
        """
        if method == "bounds":
            return np.zeros(least.size)
        rows = self.claim.rows(self.plant, np.abs)
        size = 2 * (rows.t + rows.E @ np.max(np.abs(self.claim.region.vertices), axis=1))
        size = size + np.where(np.isfinite(least), np.abs(least), 0.0)
        return np.where(self.built_in >= 0, 0.0, (ROUNDING if method == "pieces" else TOLERANCE) * size)

    def counterexample(self, found: Slacks) -> tuple[int, Array, float] | None:
        """Return a row that fails, a point (n,) where it does, and a lower bound on by how much; None when none is known.

        The point is in the region exactly, and the excess is positive whatever rounding did.
        """
        for row in np.argsort(found.reached, kind="stable"):
            if not found.reached[row] < 0:
                break
            for point in self._nearby(found.points[row]):
                excess = sure_excess(self.plant, self.inc, self.claim, int(row), point)
                if excess > 0:
                    return int(row), point, excess
        return None

    def _nearby(self, point: Array) -> Iterator[Array]:
        """A point, and points ever farther from it towards the centre, as far as they lie in the region exactly."""
        if not np.all(np.isfinite(point)):
            return
        H, h = exact(self.claim.region.H), exact(self.claim.region.h)
        for share in INWARD:
            moved = point + share * (self.claim.region.center - point)
            if np.all(H @ exact(moved) <= h):
                yield moved

    def exact_trouble(self, rough: Slacks) -> str:
        """Return what keeps pieces in Fractions from proving the claim; empty when they do. rough: pieces in floats."""
        if rough.ended or rough.work > EXACT_PIECES:
            return rough.ended or f"{rough.work} pieces are more than the {EXACT_PIECES} that are cut in Fractions"
        loop = PiecewiseLoop(self.plant, self.inc, "exact")
        try:
            found = slacks_by_pieces(loop, self.claim, replace(self.budget, seconds=max(self.budget.seconds, PROOF_SECONDS)))
        except ConvergenceError as error:
            return str(error)
        failing = [i for i, slack in enumerate(found.least) if slack < 0 and self.built_in[i] < 0]
        if found.ended or not failing:
            return found.ended
        return (f"{self.claim.name(failing[0])} is not shown to hold in exact arithmetic, where its slack is "
                f"{float(found.least[failing[0]]):.3g}")


def _range_slack(row: Array, limit: float, ends: list[tuple[Fraction | float, Fraction | float]]) -> float:
    """The limit less the largest value of a row over the controller's range."""
    total = Fraction(limit)
    for entry, (low, high) in zip(row, ends, strict=True):
        end = high if entry > 0 else low
        if entry and not np.isfinite(float(end)):
            return -np.inf
        total -= Fraction(entry) * Fraction(end) if entry else 0
    value = float(total)
    return value if Fraction(value) <= total else float(np.nextafter(value, -np.inf))
