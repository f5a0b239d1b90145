"""The certificate of a regional claim: a terminal ellipsoid, from which the exact walk is repeated when asked."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from .activations.stack import slopes
from .arrays import Array, number, symmetric
from .certificate import Certificate, Proof
from .claims.regional import Regional
from .errors import InvalidInputError
from .figures import at_most
from .inc import INC
from .loop import close_loop
from .output_range import within_limits
from .pieces import conewise_search, conewise_tail
from .pieces.cell_walk import CellWalk, cell_walk
from .pieces.conewise import NO_KINK, ConewiseLaw, conewise_law
from .pieces.conewise_tail import ConewiseProof
from .pieces.laws import PiecewiseLoop
from .pieces.terminal import TerminalSet, find, in_fractions, refusal, with_ellipsoid
from .pieces.walk import Budget
from .plant import Plant, as_plant
from .regional_level import sharpened
from .regional_proof import Stated, settle_region, unfinished
from .sets import Box
from .storage_function import quadratic_about
from .well_posed import is_proved

ROUNDING = 1e-9
LIMIT_TOLERANCE = 1e-12


@dataclass(frozen=True, eq=False)
class RegionalCertificate(Certificate):
    """A regional claim proved by following simplices until all of them lie in an ellipsoid around the equilibrium.

    plant, inc, claim: what it speaks about; P (n, n) and level: the ellipsoid {e'P e <= level} around the
    equilibrium, or None when none was found; budget: what a walk may use; note: how it was found, or why it was not;
    conewise: where the equilibrium lies on kinks, the matrix certificates that say what happens within the ellipsoid, of
    which P is the matrix. The costs are then upper bounds, too large by `gap` at most, and exact otherwise.

    The walk itself is not stored: it is done again from these numbers, in floats for `holds`, and with every rounding
    bounded for `prove`.
    """

    plant: Plant
    inc: INC
    claim: Regional
    P: Array | None
    level: float
    budget: Budget = Budget()
    note: str = ""
    conewise: ConewiseProof | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "plant", as_plant(self.plant))
        close_loop(self.plant, self.inc)
        if not isinstance(self.claim, Regional):
            raise InvalidInputError(f"claim is {self.claim!r}, but a regional certificate needs a Regional claim")
        self.claim.check(self.plant)
        if self.P is not None:
            object.__setattr__(self, "P", symmetric("P", self.P, self.plant.n))
        object.__setattr__(self, "level", number("level", self.level, 0.0))

    @cached_property
    def walk(self) -> CellWalk | None:
        """The walk in floats, or None without a terminal set or where exact pieces do not apply."""
        if self._structure():
            return None
        loop, terminal = self._setting
        return None if terminal is None else cell_walk(loop, self.claim, terminal, self.budget)

    def storage(self, x: ArrayLike) -> float | Array:
        """Return V(x) = e'P e, e = x - x*, at a state (n,) or columns (n, N), of the ellipsoid in which all motions end.

        Beyond `storage_level` the motions themselves prove the claim (`walk`), and V proves nothing.

        Raises InvalidInputError where no such ellipsoid was found.
        """
        terminal = None if self._structure() else self._setting[1]
        if terminal is None or self.P is None:
            raise InvalidInputError(f"the certificate has no terminal ellipsoid, so no storage function: {self.reason}")
        return quadratic_about(x, self.P, terminal.x)

    @property
    def storage_level(self) -> float:
        """The level of the terminal ellipsoid."""
        return self.level

    @property
    def expected(self) -> float:
        """The expected discounted cost up to rounding and `gap`; NaN when the walk did not end, or for n > 8."""
        return self.walk.expected if self.walk and self.walk.complete else np.nan

    @property
    def worst(self) -> tuple[float, Array]:
        """The largest discounted cost over the initial set, up to `gap`, and where it is attained; NaN when unknown."""
        if self.walk is None or not self.walk.complete:
            return np.nan, np.full(self.plant.n, np.nan)
        return self.walk.worst

    @property
    def gap(self) -> float:
        """By how much the costs from any starting point, `expected` and `worst` exceed the true ones at most.

        0, up to rounding, where the law is affine around the equilibrium; infinite when the walk did not end.
        """
        if self.walk is None or not self.walk.complete:
            return np.inf
        terminal = self._setting[1]
        assert terminal is not None
        arrived = self.walk.arrived
        return terminal.overestimate(arrived.now, self.claim.discount**self.walk.steps_taken[arrived.owner])

    @property
    def worst_bound(self) -> float:
        """The largest discounted cost over the initial set, rounded up by 1e-9 of its size; infinite when unknown."""
        value = self.worst[0]
        return value * (1 + ROUNDING) if np.isfinite(value) else np.inf

    @property
    def bound(self) -> float:
        """The expected discounted cost rounded up by 1e-9 of its size; infinite when unknown.

        Where the expectation is not worked out (n > 8) it is the largest cost, which no expectation exceeds.
        """
        return self._mean_bound if np.isfinite(self._mean_bound) else self.worst_bound

    @property
    def _mean_bound(self) -> float:
        return self.expected * (1 + ROUNDING) if np.isfinite(self.expected) else np.inf

    def margins(self) -> dict[str, float]:
        """Return the distance from failing of each part; positive is good, for "inputs" zero is enough.

        "well-posed": 1 - contraction rate, or the monotonicity under a multiplier T; "followed": probability of the
        starting points that were followed into the terminal set, less what one such point must be, so 0 when all were;
        "inputs": the smallest h - H u before a motion arrives in the terminal set, which keeps within the limits.
        """
        margins = {"well-posed": self.inc.well_posedness().margin}
        if self.walk is None:
            return margins | {"followed": -1.0}
        margins["followed"] = 0.0 if self.walk.complete else self.walk.followed - 1
        if self.claim.inputs is not None:
            margins["inputs"] = max(self.walk.slack, 0.0) if self._built_in else self.walk.slack
        return margins

    @property
    def reason(self) -> str:
        """Why the certificate does not hold; empty when it does."""
        trouble = self._structure()
        if trouble:
            return trouble
        loop, terminal = self._setting
        unsound = self._unsound(loop, terminal, prove=False)
        if unsound or self.walk is None:
            return unsound or "the motions were not followed"
        return self._walk_trouble(self.walk)

    @property
    def advice(self) -> str:
        """What to try instead, by what stands in the way; empty when the certificate holds or nothing is known."""
        if any(unit.pieces is None for unit in self._law.activations):
            return "For units of any kind: certify(..., method='ellipsoid'), or Attraction."
        if self.walk is None or not self.reason:
            return ""
        if self.walk.complete:
            clips = "the law: inc.with_saturated_output(inputs)" if isinstance(self.claim.inputs, Box) else "the law"
            return f"Clip {clips}, or take a smaller set."
        return "A larger `budget` may finish it, or a smaller set may hold: `largest_scale` finds which."

    def _unsound(self, loop: PiecewiseLoop, terminal: TerminalSet | None, prove: bool) -> str:
        """What is wrong with the terminal set."""
        if self.conewise is None:
            if terminal is None:
                return self.note or "no terminal set is stored"
            return refusal(loop, self.claim, terminal) or ""
        if isinstance(self._local, str):
            return self._local
        assert self._local is not None
        if self.P is None or not np.array_equal(self.P, self.conewise.P):
            return "the terminal ellipsoid is not the one that the settling certificate speaks of"
        return conewise_tail.refusal(loop, self.claim, self._local, self.conewise, self.level, self._built_in, prove) or ""

    @property
    def sentence(self) -> str:
        """What is proved, in one sentence, or that nothing is."""
        if self.reason:
            return f"Not certified: {self.reason}."
        loop, terminal = self._setting
        assert terminal is not None
        rest = np.array2string(np.round(terminal.x, 9) + 0.0, precision=6)
        limits = "" if self.claim.inputs is None else "every input stays within its limits, "
        mean = f"at most {at_most(self.bound)} in expectation and " if np.isfinite(self._mean_bound) else ""
        return (f"From every starting point of the initial set {limits}the motion converges to x* = {rest}, and the "
                f"discounted cost (discount {self.claim.discount:g}) is {mean}at most {at_most(self.worst_bound)} from any "
                "point.")

    def prove(self, seconds: float | None = None) -> Proof:
        """Settle terminal set, limits, convergence and both cost bounds rigorously, by the cheapest means that suffices.

        The terminal set is checked in Fractions. Then the polytopes of the walk are followed with 256 binary places, every
        rounding bounded (`regional_proof.settle_region`), where that is not enough simplices, and at last Fractions.
        Nothing is tried when the walk in floats has failed already.

        What is proved of a Polytope as initial set speaks of the simplices that it lists, with their corners taken
        exactly as stored. seconds: for all of it, without limit when left out; what is open then is not proved.
        """
        start = time.perf_counter()
        trouble, method = self.reason or self._exact_setting(), "exact fractions"
        if not trouble and self.walk is not None:
            assert self._exact[1] is not None
            stated = Stated(self.claim, self._exact[1], self._mean_bound, self.worst_bound, self._built_in)
            trouble, method = settle_region(self._setting[0], stated, self.walk, self.budget,
                                            np.inf if seconds is None else seconds)
        if self.conewise is not None:
            method += ", after matrix certificates of the conewise linear loop around the equilibrium"
        return Proof(not trouble, method, time.perf_counter() - start, trouble)

    @cached_property
    def _law(self) -> INC:
        """The controller without units that no output depends on: the same law, with fewer kinks to cut at."""
        return self.inc.without_idle_units()

    @cached_property
    def _setting(self) -> tuple[PiecewiseLoop, TerminalSet | None]:
        loop = PiecewiseLoop(self.plant, self._law)
        if self.conewise is not None:
            return loop, self._conewise_set(loop)
        return loop, None if self.P is None else with_ellipsoid(loop, self.claim, self.P, self.level)

    @cached_property
    def _local(self) -> ConewiseLaw | str | None:
        return None if self.conewise is None else conewise_law(self.plant, self._law)

    def _conewise_set(self, loop: PiecewiseLoop) -> TerminalSet | None:
        if self.conewise is None or not isinstance(self._local, ConewiseLaw):
            return None
        return conewise_tail.terminal_set(loop, self.claim, self._local, self.conewise, self.level)

    def _structure(self) -> str:
        for i, unit in enumerate(self._law.activations):
            if unit.pieces is None:
                return f"hidden unit {i} has activation {unit}, which is not piecewise affine: exact pieces do not apply"
        if not self.plant.discrete:
            return "exact pieces walk in discrete time: sample the plant first, plant.sampled(dt)"
        test = self.inc.well_posedness()
        if not test.holds:
            return f"the controller is not proved well posed: {test.test}"
        return ""

    @cached_property
    def _exact(self) -> tuple[PiecewiseLoop, TerminalSet | None]:
        loop, found = PiecewiseLoop(self.plant, self._law, "exact"), self._setting[1]
        if self.conewise is not None:
            return loop, self._conewise_set(loop)
        return loop, None if found is None else in_fractions(loop, self.claim, found)

    def _exact_setting(self) -> str:
        """What is wrong, in exact arithmetic, with what a walk starts from."""
        # Both: the claim is about the controller, and the error bounds rest on the numbers of the law without idle units.
        for law in (self.inc, self._law):
            if not is_proved(law.well_posedness(), law.W, slopes(law.activations)):
                return f"the controller is not proved well posed: {law.well_posedness().test}"
        for i, unit in enumerate(self._law.activations):
            if unit.pieces is not None and not unit.pieces.joined:
                return f"the pieces of hidden unit {i}, {unit}, do not meet exactly at a kink in rational arithmetic"
        return self._unsound(*self._exact, prove=True)

    @cached_property
    def _built_in(self) -> bool:
        """Whether there are no input limits, or no output of the controller can leave them, whatever it measures."""
        return self.claim.inputs is None or within_limits(self.inc, self.claim.inputs)

    def _walk_trouble(self, found: CellWalk) -> str:
        if not found.complete:
            return unfinished(found)
        tolerance = np.inf if self._built_in else LIMIT_TOLERANCE * self._input_size()
        return f"an input exceeds its limit by {-found.slack:.3g}" if found.slack < -tolerance else ""

    def _input_size(self) -> float:
        return 1.0 if self.claim.inputs is None else max(1.0, float(np.max(np.abs(self.claim.inputs.h))))


def certify_region(plant: Plant, inc: INC, claim: Regional, budget: Budget | None = None) -> RegionalCertificate:
    """Return the regional certificate of a loop: a terminal ellipsoid is computed, the walk decides.

    Raises DimensionError when claim, plant and controller do not fit; anything else that stands in the way is the
    certificate's `reason`.
    """
    budget = budget or Budget()
    bare = RegionalCertificate(plant, inc, claim, None, 0.0, budget)
    trouble = bare._structure()
    if trouble:
        return RegionalCertificate(plant, inc, claim, None, 0.0, budget, trouble)
    loop = PiecewiseLoop(bare.plant, bare._law)
    terminal, why = find(loop, claim)
    if terminal is not None:
        return RegionalCertificate(plant, inc, claim, terminal.P, float(terminal.level), budget)  # type: ignore[arg-type]
    found = conewise_search.find(loop, claim, bare._built_in)
    if isinstance(found, str):
        note = why if found == NO_KINK else f"{why}; {found}"
        return RegionalCertificate(plant, inc, claim, None, 0.0, budget, note)
    proof, level = found
    return sharpened(RegionalCertificate(plant, inc, claim, proof.P, level, budget, conewise=proof))
