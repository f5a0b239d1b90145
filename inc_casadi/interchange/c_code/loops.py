"""How a loop that contracts is solved in a number of steps known beforehand, and how near to the fixed point that comes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import ceil, log
from typing import NamedTuple

import numpy as np

from ...activations.stack import slopes
from ...arrays import Array
from ...errors import NotWellPosedError
from ...inc import INC
from ...splitting import Splitting
from ...well_posed import WellPosedness, error_from_residual, well_posedness
from .sizes import Sizes, by_column, drive, evaluation_error, image, inherited
from .stages import Stage

GUARD = 1 + 1e-9  # covers the rounding of bounds, which are sums of nonnegative numbers
TRIALS = 10  # of Newton's steps at most


@dataclass(frozen=True, eq=False)
class Loop:
    """The numbers of one loop: `steps` of its method suffice, each looked at with the tolerance tol max(1, scale).

    method: "contraction", "newton" (safeguarded by contraction steps), "splitting" or "newton and splitting"; rate: of
    the contraction or the splitting; weights: v (k,) of the norm max |x_i| / v_i; trials: of Newton's steps at most;
    inner: steps by which a trial solves its pattern, 0 for elimination; splitting: its operators, or None.
    """

    method: str
    rate: float
    weights: Array
    steps: int
    trials: int = 0
    inner: int = 0
    splitting: Splitting | None = None

    @property
    def evaluations(self) -> int:
        """How often phi of the whole loop is evaluated at most."""
        if self.splitting is not None:
            return self.steps + self.trials
        return self.steps + (3 + 2 * self.trials if self.trials else 0)


class Way(NamedTuple):
    """Whether a loop is given Newton's trials, and by how many inner steps they solve their pattern, 0 for elimination."""

    newton: bool
    inner: int = 0


def tested(law: INC, stage: Stage) -> WellPosedness:
    """Return the test of well-posedness of the units of one loop.

    Raises NotWellPosedError when no test holds, or the contraction is too weak for bounds in floats.
    """
    own = stage.own
    test = well_posedness(law.W[own, own], law.U[own], law.V[:, own], law.K, slopes(law.activations[own]))
    if not test.holds:
        raise NotWellPosedError(f"a loop of {stage.size} hidden units is not proved well posed ({test.test}): its fixed "
                                "point may not exist or not be unique")
    if test.contracts and GUARD * test.rate >= 1:
        raise NotWellPosedError(f"a loop of {stage.size} hidden units contracts by {test.rate:.12g} only, too near 1 for "
                                "bounds in floats")
    return test


def contracting(law: INC, stage: Stage, test: WellPosedness, sizes: Sizes, tol: float, way: Way) -> Loop:
    """Return how a contracting loop is solved, from bounds on what it reads.

    In the norm |x|_v = max |x_i| / v_i, eta -> phi(W eta + c) contracts by rate. From eta_0 = 0 the first step has the
    length s = |phi(c)|_v, so eta_k is within rate^k s / (1 - rate) of the fixed point. The stopping test |step|_v <= tau
    with tau = tol max(1, s) leaves rate tau / (1 - rate); so many steps k that rate^(k - 1) s <= tau leave no more,
    whether or not rounding lets the test succeed. Since tau / s >= tol / min(1, s), a number of steps serves every y,
    bounded or not.

    Newton's trial is taken only if it shrinks the residual by rate, as a step must: the contraction steps that follow
    never start from further away than the first step did.

    >>> from .sizes import begin
    >>> law = INC([[0.5]], [[1.0]], [[1.0]], [[0.0]])
    >>> contracting(law, Stage(0, 1, 0, 0, True), law.contraction, begin(law, None), 1e-12, Way(False)).steps
    41
    """
    start = image(law.activations[stage.own], drive(law, stage, sizes))
    rate = test.rate * (1 + 2 * (stage.size + 8) * sizes.precision.eps)
    if GUARD * rate >= 1:
        raise NotWellPosedError(f"a loop of {stage.size} hidden units contracts by {test.rate:.12g} only, within the "
                                f"rounding of {sizes.precision.word}s")
    largest = np.inf if start[:, 1].any() else float(np.max(start[:, 0] / test.weights))
    wanted = tol / max(min(1.0, largest), tol)
    steps = 1 + max(1, ceil(log(wanted) / log(max(rate, 1e-300))))
    steps += 0 if way.newton else (steps + 1) % 2  # two to each test after the first
    name = "newton" if way.newton else "contraction"
    return Loop(name, rate, test.weights, steps, TRIALS if way.newton else 0, way.inner)


def after_contraction(law: INC, stage: Stage, loop: Loop, test: WellPosedness, sizes: Sizes, tol: float) -> Sizes:
    """Return the bounds after a contracting loop.

    A computed evaluation is within delta of phi(W eta + c) in |.|_v, so with the stopping test, or after `steps`,

        |eta - eta*|_v <= (rate tau + delta) / (1 - rate).

    Newton's evaluations before the last contraction steps add rate^steps delta each, the scale's own rounding tol delta. To
    this comes what the errors of earlier units do to the fixed point, by `well_posed.error_from_residual`. Rounding is
    bounded at the largest vector that may be met: one whose computed residual is at most s and, by rounding, a few delta.

    Raises NotWellPosedError where that size cannot be bounded because 1 - rate is within rounding.
    """
    units, W, v = law.activations[stage.own], law.W[stage.own, stage.own], loop.weights
    bound = partial(error_from_residual, test, W, slopes(units), guard=GUARD)
    z = drive(law, stage, sizes)
    start = image(units, z)
    s = np.max(start / v[:, None], axis=0)
    room = 1 - GUARD * loop.rate
    terms, before = law.p + stage.high - stage.low + stage.size + 2, 2 * loop.trials + 4

    def rounding(met: Array) -> Array:
        reached = z + np.abs(W) @ (v[:, None] * met)
        return np.max(evaluation_error(units, reached, terms, sizes.precision) / v[:, None], axis=0)

    met = GUARD * (2 * s + 4 * before * rounding(2 * GUARD * s / room)) / room
    delta = rounding(met)
    if np.any(delta > 2 * rounding(2 * GUARD * s / room)):
        raise NotWellPosedError(f"a loop of {stage.size} hidden units contracts by {loop.rate:.12g} only, within rounding")
    inside = z + np.abs(W) @ (v[:, None] * met)
    tau = tol * np.array([max(1.0, s[0]), 0.0] if s[1] == 0 else [1.0 + s[0], s[1]])
    more = 1 + tol + loop.rate**loop.steps * before
    tests = GUARD + 16 * sizes.precision.eps * loop.evaluations  # the tests are in floats too
    own_error = tests * v[:, None] * (loop.rate * tau + more * delta) / room
    size = values(law, stage, z, by_column(bound, start))
    error = own_error + by_column(bound, inherited(law, stage, sizes))
    return sizes.with_stage(size, error, inside, v[:, None] * met, met, s)


def values(law: INC, stage: Stage, z: Array, solution: Array) -> Array:
    """Return bounds (k, 2) on the true units: those of the solution, or what bounded units state if that is less."""
    units = law.activations[stage.own]
    bounded = np.array([np.all(np.isfinite(unit.bounds)) for unit in units])
    out = image(units, z + np.abs(law.W[stage.own, stage.own]) @ solution)
    return np.where(bounded[:, None], out, solution)
