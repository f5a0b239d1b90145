"""The judge: tries the ways of proof in turn, and says what is proved of a law and why the rest is not."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..inc import INC
from ..pieces.walk import Budget
from ..plant import as_plant
from ..spec import Spec
from .causes import Cause
from .findings import Finding, Passed, Question, Refused
from .ways import WAYS, Way


@dataclass(frozen=True, eq=False)
class Judgement:
    """What is proved of a law, and what is not.

    Parameters
    ----------
    posed : by which test the law is well posed
    built_in : whether the input limits are kept whatever the law measures, or there are none
    findings : of each way of proof that was tried, in this order
    """

    posed: str
    built_in: bool
    findings: tuple[Finding, ...]

    @property
    def passed(self) -> tuple[Passed, ...]:
        """What is proved."""
        return tuple(one for one in self.findings if isinstance(one, Passed))

    @property
    def refused(self) -> tuple[Refused, ...]:
        """What is not, each with its reason."""
        return tuple(one for one in self.findings if isinstance(one, Refused))

    @property
    def best(self) -> Passed | None:
        """The proof of the lowest cost among those that cover the limits, or None."""
        return min((one for one in self.passed if one.limits), key=lambda one: one.bound, default=None)


def judge(plant: Any, spec: Spec, inc: INC, budget: Budget | None = None, *, alone: bool = False,
          ways: Sequence[Way] = WAYS) -> Judgement:
    """Return what is proved of a law: that it keeps the limits, converges, and costs at most so much.

    From a uniform distribution on a box or polytope exact pieces prove it all, and the exact cost; where they give only the
    largest cost, or nothing, the inequality of thm:performance bounds it from everywhere; where neither holds, an ellipsoid
    that contains the initial set may. Nothing is said of a law because of how it was found.

    Parameters
    ----------
    plant : Plant or control.StateSpace
    spec : what is asked
    inc : the law
    budget : of the exact pieces; the ellipsoid takes what they leave of its seconds, a fifth of them at least
    alone : take only what one certificate proves by itself
    ways : of proof, in this order

    Raises
    ------
    DimensionError : the parts do not fit

    >>> from inc_casadi import Box, Plant
    >>> spec = Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-1, 1))
    >>> found = judge(Plant(1.5, 1.0), spec, INC.saturated([[-1.5]], 1.0))
    >>> found.best.way, found.best.exact, round(found.best.bound, 6)
    ('exact pieces', True, 0.358333)
    """
    plant, budget = as_plant(plant), budget or Budget()
    until = time.monotonic() + budget.seconds
    posed = inc.well_posedness()
    if not posed.holds:
        return Judgement(posed.test, False, (Refused("well-posedness", posed.test, Cause.ILL_POSED),))
    asked = Question(plant, spec.check(plant), inc, budget, alone)
    findings: list[Finding] = []
    for way in ways:
        if any(isinstance(one, Passed) and one.limits and not (one.by_worst or one.loose) for one in findings):
            break
        found = way(asked, findings, until)
        findings += [] if found is None else [found]
    return Judgement(posed.test, asked.built_in, tuple(findings))
