"""The exact walk from x_0 in a set and xi_0 fixed: polytopes of starting points in R^n, their motions in R^(n + l)."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from ..activations.stack import slopes
from ..arrays import Array, number, symmetric
from ..certificate import Certificate, Proof
from ..claims.regional import Regional
from ..errors import DimensionError
from ..figures import at_most
from ..inc import INC
from ..pieces.begin import Begin
from ..pieces.cell_walk import CellWalk, cell_walk
from ..pieces.laws import PiecewiseLoop
from ..pieces.terminal import TerminalSet, find, in_fractions, refusal, widened, with_ellipsoid
from ..pieces.walk import Budget
from ..plant import Plant, as_plant
from ..regional_certificate import LIMIT_TOLERANCE, ROUNDING
from ..regional_proof import Stated, settle_region, unfinished
from ..sets import Box, Polytope
from ..simulate import simulate
from ..well_posed import is_proved
from .controller import DynamicINC
from .extended import beside, blkdiag, extended
from .fold import built_in

_LATE = 60  # steps after which gates that open in the first steps no longer matter
_FAR = 2.0**40  # the box for xi where the limits of u are watched: a Regional claim names one for every input


@final
@dataclass(frozen=True, eq=False)
class FlatCertificate(Certificate):
    """From every x_0 of a set and xi_0: u within its limits, (x, xi) converges, the exact discounted cost.

    The starting points (x_0, xi_0) form a flat set of dimension n in R^(n + l), and a walk over polytopes cuts it in the
    coordinates of x_0 alone (`Begin`): a polytope is carried by its vertices, and the affine maps from x_0 to (x_k, xi_k)
    need not be square. With no more than n coordinates to cut in, an observer costs what a static law of the plant does.

    It holds when the terminal ellipsoid {e'P e <= level} about the equilibrium of the extended loop (`extended`) is sound,
    that is, it is kept and no kink or limit is crossed within it, every polytope of starting points arrives in it, and u
    keeps its limits on the way, or by construction. Necessary and sufficient up to the budget, where the equilibrium lies on
    no kink.

    Parameters
    ----------
    plant : in discrete time; dynamic : the controller, piecewise affine; claim : Regional about the plant
    P : (n + l, n + l), level : the ellipsoid about the equilibrium, None where none was found
    budget : what a walk may use; note : why no ellipsoid was found
    """

    plant: Plant
    dynamic: DynamicINC
    claim: Regional
    P: Array | None
    level: float
    budget: Budget = Budget()
    note: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "plant", as_plant(self.plant))
        wide, _ = extended(self.plant, self.dynamic)
        if self.claim.Q.shape[0] != self.plant.n or self.claim.R.shape[0] != self.dynamic.m:
            raise DimensionError(f"the claim speaks of {self.claim.Q.shape[0]} states and {self.claim.R.shape[0]} inputs, "
                                 f"but the plant has {self.plant.n} and {self.plant.m}")
        if self.P is not None:
            object.__setattr__(self, "P", symmetric("P", self.P, wide.n))
        object.__setattr__(self, "level", number("level", self.level, 0.0))

    @cached_property
    def walk(self) -> CellWalk | None:
        """The walk in floats, or None without a terminal set or where exact pieces do not apply."""
        if self._structure or self._terminal is None:
            return None
        return cell_walk(self._loop, self._claim, self._terminal, self.budget, begin=self._begin)

    @property
    def expected(self) -> float:
        """The expected discounted cost up to rounding; NaN when the walk did not end, or for n > 8."""
        return self.walk.expected if self.walk and self.walk.complete else np.nan

    @property
    def worst(self) -> tuple[float, Array]:
        """The largest discounted cost over the initial set, and the x_0 (n,) where it is attained; NaN when unknown."""
        if self.walk is None or not self.walk.complete:
            return np.nan, np.full(self.plant.n, np.nan)
        return self.walk.worst

    @property
    def gap(self) -> float:
        """By how much the costs exceed the true ones: 0, up to rounding; infinite when the walk did not end."""
        return 0.0 if self.walk is not None and self.walk.complete else np.inf

    @property
    def worst_bound(self) -> float:
        """The largest discounted cost, rounded up by 1e-9 of its size; infinite when unknown."""
        value = self.worst[0]
        return value * (1 + ROUNDING) if np.isfinite(value) else np.inf

    @property
    def bound(self) -> float:
        """The expected discounted cost, rounded up likewise; for n > 8 the largest cost, which no expectation exceeds."""
        return self._mean_bound if np.isfinite(self._mean_bound) else self.worst_bound

    @property
    def _mean_bound(self) -> float:
        return self.expected * (1 + ROUNDING) if np.isfinite(self.expected) else np.inf

    def margins(self) -> dict[str, float]:
        """Return the margins that `RegionalCertificate.margins` has: "well-posed", "followed" and "inputs"."""
        margins = {"well-posed": self.dynamic.law.well_posedness().margin, "followed": -1.0}
        if self.walk is not None:
            margins["followed"] = 0.0 if self.walk.complete else self.walk.followed - 1
            if self.claim.inputs is not None and not self._built_in:
                margins["inputs"] = self.walk.slack
        return margins

    @property
    def reason(self) -> str:
        """Why the certificate does not hold; empty when it does."""
        if self._structure:
            return self._structure
        if self._terminal is None:
            return self.note or "no terminal set is stored"
        unsound = refusal(self._loop, self._claim, self._terminal)
        if unsound:
            return unsound
        assert self.walk is not None
        if not self.walk.complete:
            return unfinished(self.walk)
        size = 1.0 if self.claim.inputs is None else max(1.0, float(np.max(np.abs(self.claim.inputs.h))))
        return f"an input exceeds its limit by {-self.walk.slack:.3g}" if self.walk.slack < -LIMIT_TOLERANCE * size else ""

    @property
    def sentence(self) -> str:
        """What is proved, in one sentence, or that nothing is."""
        if self.reason:
            return f"Not certified: {self.reason}."
        mean = f"at most {at_most(self.bound)} in expectation and " if np.isfinite(self._mean_bound) else ""
        kept = "" if self.claim.inputs is None else "every input stays within its limits, "
        return (f"From every starting point of the initial set, the controller's state at xi_0, {kept}the motion converges, "
                f"and the discounted cost (discount {self.claim.discount:g}) is {mean}at most {at_most(self.worst_bound)} "
                "from any point.")

    def prove(self, seconds: float | None = None) -> Proof:
        """Settle it with 256 binary places for every polytope, every rounding bounded; the terminal set in Fractions.

        seconds: for all of it, without limit when left out; what is open then is not proved.
        """
        start = time.perf_counter()
        trouble, method = self.reason or self._unproved, "exact fractions"
        if not trouble:
            assert self.walk is not None
            exact = in_fractions(self._exact, self._claim, self._terminal)  # type: ignore[arg-type]
            trouble = refusal(self._exact, self._claim, exact) or ""
        if not trouble:
            stated = Stated(self._claim, exact, self._mean_bound, self.worst_bound, self._built_in, self._begin)
            trouble, method = settle_region(self._loop, stated, self.walk, self.budget,  # type: ignore[arg-type]
                                            np.inf if seconds is None else seconds)
        return Proof(not trouble, method, time.perf_counter() - start, trouble)

    @cached_property
    def _law(self) -> INC:
        return self.dynamic.law.without_idle_units()

    @cached_property
    def _loop(self) -> PiecewiseLoop:
        return PiecewiseLoop(extended(self.plant, self.dynamic)[0], self._law)

    @cached_property
    def _exact(self) -> PiecewiseLoop:
        return PiecewiseLoop(self._loop.plant, self._law, "exact")

    @cached_property
    def _built_in(self) -> bool:
        return built_in(self.dynamic, self.claim)

    @cached_property
    def _claim(self) -> Regional:
        return extended_claim(self.dynamic, self.claim)

    @cached_property
    def _begin(self) -> Begin:
        region = self.claim.initial.support
        assert isinstance(region, Box | Polytope)
        return Begin(region, self.dynamic.xi_0)

    @cached_property
    def _terminal(self) -> TerminalSet | None:
        return None if self.P is None else with_ellipsoid(self._loop, self._claim, self.P, self.level)

    @cached_property
    def _structure(self) -> str:
        for i, unit in enumerate(self._law.activations):
            if unit.pieces is None:
                return f"hidden unit {i} has activation {unit}, which is not piecewise affine: exact pieces do not apply"
        test = self.dynamic.law.well_posedness()
        return "" if test.holds else f"the controller is not proved well posed: {test.test}"

    @property
    def _unproved(self) -> str:
        """What is wrong, in exact arithmetic, with what a walk starts from."""
        # Both: the claim is about the controller, and the error bounds rest on the numbers of the law without idle units.
        for law in (self.dynamic.law, self._law):
            if not is_proved(law.well_posedness(), law.W, slopes(law.activations)):
                return f"the controller is not proved well posed: {law.well_posedness().test}"
        for i, unit in enumerate(self._law.activations):
            if unit.pieces is not None and not unit.pieces.joined:
                return f"the pieces of hidden unit {i}, {unit}, do not meet exactly at a kink in rational arithmetic"
        return ""


def extended_claim(dynamic: DynamicINC, claim: Regional) -> Regional:
    """Return the claim about the extended loop, from a set around the flat one that the walk does not use.

    Limits of u that are built in need no watching, and are left out.

    >>> delay = DynamicINC(INC.linear([[0.0, -0.5], [1.0, 0.0]]), [0.0])
    >>> extended_claim(delay, Regional(Box(-1, 1), Box(-3, 3), 1.0, 2.0)).R.tolist()
    [[2.0, 0.0], [0.0, 0.0]]
    """
    l, region = dynamic.order, claim.initial.support
    assert isinstance(region, Box | Polytope)
    nothing, far = np.zeros((l, l)), np.full(l, _FAR)
    inputs = None if claim.inputs is None or built_in(dynamic, claim) else beside(claim.inputs, Box(-far, far))
    return Regional(beside(region, Box(dynamic.xi_0 - 1, dynamic.xi_0 + 1)), inputs, blkdiag(claim.Q, nothing),
                    blkdiag(claim.R, nothing), claim.discount)


def certify_flat(plant: Plant, dynamic: DynamicINC, claim: Regional, budget: Budget | None = None) -> FlatCertificate:
    """Return the certificate from X_0 and xi_0: a terminal ellipsoid is computed, the walk decides.

    Raises what `extended` raises; anything else that stands in the way is the certificate's `reason`.

    >>> from ..plant import Plant
    >>> delay = DynamicINC(INC.linear([[-1.0, -0.5], [1.0, 0.0]]), [0.5])
    >>> certify_flat(Plant(1.5, 1.0), delay, Regional(Box(-1, 1), Box(-3, 3), 1.0, 0.0, 0.9)).holds()
    True
    """
    budget = budget or Budget()
    bare = FlatCertificate(plant, dynamic, claim, None, 0.0, budget)
    if bare._structure:
        return FlatCertificate(plant, dynamic, claim, None, 0.0, budget, bare._structure)
    terminal, why = find(bare._loop, bare._claim)
    if terminal is None:
        return FlatCertificate(plant, dynamic, claim, None, 0.0, budget, why)
    terminal = widened(bare._loop, bare._claim, terminal, _late(bare))
    return FlatCertificate(plant, dynamic, claim, terminal.P, float(terminal.level), budget)


def _late(bare: FlatCertificate) -> Array:
    """States (N, n + l) after a while from the vertices of the initial set, where floats can follow them."""
    loop, begun = bare._loop, bare._begin.cells().now
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(simulate(loop.plant, loop.inc, begun.T, steps=_LATE).x[:, :, -1].T)
