"""The largest difference between two piecewise-affine laws on a polytope, exactly."""

from __future__ import annotations

import time
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..activations.stack import slopes
from ..arrays import Array, matrix
from ..brief import Brief
from ..certificate import Proof
from ..errors import ConvergenceError, DimensionError, InvalidInputError
from ..figures import at_least, at_most
from ..inc import INC
from ..mpc import MPC
from ..sets import Box, Polytope
from ..well_posed import is_proved
from .cover import Cover, cover, source_of
from .critical_regions import CriticalRegions

Law = INC | MPC | CriticalRegions
RELATIVE = 1e-9  # how far the bound stands above the value, as a share of it,
ABSOLUTE, BY_PROGRAM = 1e-11, 1e-8  # and as a share of the largest |u|: for two INCs, and with active constraints to 1e-9
PROOF_SECONDS = 60.0


@dataclass(frozen=True, eq=False)
class Difference(Brief):
    """The largest |u_1 - u_2| over a polytope: over all outputs, and of each one.

    value, point (n,), output: the largest, a point where it is taken, and which output; each (m,): the largest of every
    output; size: the largest |u| met; pieces, seconds; ended: "" or the budget that ran out: then the value is that
    over the pieces that were finished, a lower bound. The laws, the region and C are kept for `prove`.
    """

    value: float
    point: Array
    output: int
    each: Array
    size: float
    pieces: int
    seconds: float
    ended: str
    first: Law
    second: Law
    region: Box | Polytope
    C: Array

    @property
    def bound(self) -> float:
        """The value rounded up by more than rounding is expected to do to it; infinite when the budget ran out."""
        share = ABSOLUTE if isinstance(self.first, INC) and isinstance(self.second, INC) else BY_PROGRAM
        return np.inf if self.ended else self.value * (1 + RELATIVE) + share * self.size

    @property
    def sentence(self) -> str:
        """What was found, in one sentence."""
        where = f"reached at {np.array2string(self.point, precision=6)} by output {self.output}"
        if self.ended:
            return f"The two laws differ by at least {at_least(self.value)}, {where}; {self.ended} ended the search."
        return f"The two laws differ by at most {at_most(self.bound)} on the region, {where}, over {self.pieces} pieces."

    def prove(self, seconds: float = PROOF_SECONDS) -> Proof:
        """Settle `bound` in exact fractions: both laws well posed, and all of it cut and compared without rounding.

        For two INCs whose pieces are few, since Fractions are a thousand times slower. The region is that of the simplices
        it lists, with their corners taken exactly as stored.
        """
        start = time.perf_counter()
        reason = self._trouble(seconds)
        return Proof(not reason, "exact fractions over all pieces", time.perf_counter() - start, reason)

    def _trouble(self, seconds: float) -> str:
        if self.ended:
            return f"the search itself did not end ({self.ended})"
        laws = (self.first, self.second)
        for law in laws:
            if not isinstance(law, INC):
                return "a law defined by a quadratic program is compared in floats only"
            kept = law.without_idle_units()
            if not all(is_proved(each.well_posedness(), each.W, slopes(each.activations)) for each in (law, kept)):
                return f"a controller is not proved well posed: {law.well_posedness().test}"
        try:
            sources = [source_of(law, self.C, "exact") for law in laws if isinstance(law, INC)]
            found = cover(sources, self.region, seconds=seconds)
        except ConvergenceError as error:
            return str(error)
        if found.ended:
            return f"{found.ended} ended the exact comparison"
        u = [_inputs(source, patterns, found) for source, patterns in zip(sources, found.patterns, strict=True)]
        largest = np.abs(u[0] - u[1]).max()
        return "" if largest <= Fraction(self.bound) else f"in exact arithmetic the laws differ by {float(largest):.12g}"


def largest_difference(first: Law, second: Law, region: Box | Polytope, C: ArrayLike | None = None,
                       pieces: int = 500_000, seconds: float = 60.0) -> Difference:
    """Return the largest |u_1 - u_2| over a polytope of states, equal to it up to rounding.

    The polytope is cut until both laws are affine on every simplex. There u_1 - u_2 is affine and each |.| convex,
    so its maximum is taken at a vertex: necessary and sufficient, no relaxation.

    first, second: an INC, which reads y = C x, or an `MPC`, or its CriticalRegions, which read x; region: a Box or
    Polytope in R^n; C: (p, n), the identity when left out; pieces, seconds: what may be used.

    Raises DimensionError, InvalidInputError; InfeasibleError where an MPC law has no solution somewhere on the region.

    >>> from inc_casadi import INC, Box
    >>> found = largest_difference(INC.linear([[2.0]]), INC.saturated([[2.0]], 1.0), Box([-1.0], [0.75]))
    >>> found.value, found.point.tolist(), bool(found.prove())
    (1.0, [-1.0], True)
    """
    n = region.dimension
    C = matrix("C", np.eye(n) if C is None else C, (None, n))
    sources = [_source(name, law, C) for name, law in (("first", first), ("second", second))]
    outputs = [_outputs(law) for law in (first, second)]
    if outputs[0] != outputs[1]:
        raise DimensionError(f"the first law has {outputs[0]} outputs and the second {outputs[1]}")
    clock = time.perf_counter()
    found = cover(sources, region, pieces, seconds)
    done = found.finished
    u = [_inputs(source, patterns, done) for source, patterns in zip(sources, done.patterns, strict=True)]
    gap = np.abs(u[0] - u[1])
    each = gap.max(axis=(0, 1), initial=0.0)
    output = int(np.argmax(each))
    where = int(np.argmax(gap[:, :, output])) if gap.size else 0
    point = done.simplices.now.reshape(-1, n)[where] if gap.size else region.center
    size = max(float(np.abs(part).max(initial=0.0)) for part in u)
    return Difference(float(each[output]), point, output, each, size, len(found.simplices), time.perf_counter() - clock,
                      found.ended, first, second, region, C)


def _inputs(source: Any, patterns: np.ndarray, found: Cover) -> Array:
    distinct, which = source.distinct(patterns)
    laws = source.laws(distinct)
    return found.simplices.now @ np.swapaxes(laws.Gx[which], 1, 2) + laws.g[which][:, None, :]


def _source(name: str, law: Law, C: Array) -> Any:
    if isinstance(law, INC):
        if law.p != C.shape[0]:
            raise DimensionError(f"the {name} law reads {law.p} measurements, but C has {C.shape[0]} rows")
        return source_of(law, C)
    if not isinstance(law, MPC | CriticalRegions):
        raise InvalidInputError(f"the {name} law must be an INC, an MPC or its CriticalRegions, not {law!r}")
    source = CriticalRegions(law) if isinstance(law, MPC) else law
    if source.mpc.plant.n != C.shape[1]:
        raise DimensionError(f"the {name} law reads {source.mpc.plant.n} states, but the region lies in R^{C.shape[1]}")
    return source


def _outputs(law: Law) -> int:
    if isinstance(law, INC):
        return law.m
    return (law if isinstance(law, MPC) else law.mpc).plant.m
