"""Settle a regional claim with rigour, from the cheapest means to the most exact: each answers what stands in the way."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from .claims.regional import Regional
from .errors import ConvergenceError
from .pieces.begin import Begin
from .pieces.cell_enclosure import CellEnclosure
from .pieces.cell_proof import settle
from .pieces.cell_walk import CellWalk
from .pieces.cutting import Deadline
from .pieces.enclosure import LEVEL_ROOM, Arrival, Enclosure, Step, enclose
from .pieces.laws import PiecewiseLoop
from .pieces.terminal import TerminalSet, in_places
from .pieces.walk import Budget, Walk, walk

MOST_VERTICES, EXACT_PIECES, SECONDS = 500_000, 500, 60.0
PLACES_OF_POLYTOPES = "256 binary places for every polytope, with every rounding bounded"
PLACES_OF_SIMPLICES = "256 binary places for every simplex, with every rounding bounded"
FRACTIONS = "exact fractions over all pieces"


@dataclass(frozen=True, eq=False)
class Stated:
    """What is to be settled: the claim, the exact terminal set, the bounds on the two costs (infinite when not stated),
    whether the controller keeps the input limits by construction, and where the walk began, None for anywhere in the claim's
    initial set."""

    claim: Regional
    terminal: TerminalSet
    expected: float
    worst: float
    built_in: bool
    begin: Begin | None = None

    def excess(self, expected: Fraction | None, worst: Fraction) -> str:
        """Which bound is exceeded by costs that are certain, or an empty string."""
        if np.isfinite(self.expected) and (expected is None or expected > Fraction(self.expected)):
            return f"the expected cost exceeds the bound {self.expected:.10g}"
        if worst > Fraction(self.worst):
            return f"the worst cost exceeds the bound {self.worst:.10g}"
        return ""

    def unsure(self, errors: Enclosure | CellEnclosure, steps: tuple[Step, ...], terminal: TerminalSet) -> str:
        """Which verdict the errors of a rounded walk put in doubt, or an empty string."""
        if not errors.arrives(terminal):
            return "rounding errors grow too large for arrival in the terminal set to be certain"
        if not self.built_in and not errors.keeps_limits(self.claim, steps):
            return "an input comes too close to a limit that is not built into the controller"
        return ""


def settle_region(loop: PiecewiseLoop, stated: Stated, found: CellWalk, budget: Budget,
                  seconds: float = float("inf")) -> tuple[str, str]:
    """Return what stands in the way of the claim after all means, or an empty string, and the means that decided.

    loop: with the plant and the law; found: the complete walk in floats. First its polytopes are worked out anew with 256
    places (`pieces.cell_proof`), up to 500 000 vertices and for as long as the budget says, at least a minute. Where that
    is not enough, or their errors grow too large, simplices are followed instead. Where an input touches a limit that is not
    built in, up to 500 pieces are followed in Fractions. Of a walk that began elsewhere than in the claim's initial set the
    polytopes alone are tried. seconds: for all of it; what it leaves open is not proved.
    """
    until = time.monotonic() + seconds

    def patience() -> Budget:
        return replace(budget, seconds=min(max(budget.seconds, SECONDS), max(0.0, until - time.monotonic())))

    places = replace(loop, arithmetic="fixed")
    trouble = _by_polytopes(places, stated, found, patience().seconds)
    if not trouble:
        return "", PLACES_OF_POLYTOPES
    if stated.begin is not None or time.monotonic() > until:
        return trouble, PLACES_OF_POLYTOPES
    trouble = _by_simplices(places, stated, patience())
    if trouble and len(found.arrived) <= EXACT_PIECES and time.monotonic() <= until:
        return _by_fractions(replace(loop, arithmetic="exact"), stated, patience()), FRACTIONS
    return trouble, PLACES_OF_SIMPLICES


def _by_polytopes(loop: PiecewiseLoop, stated: Stated, found: CellWalk, seconds: float = SECONDS) -> str:
    if len(found.arrived.owner) > MOST_VERTICES:
        return f"{len(found.arrived.owner)} vertices are more than {MOST_VERTICES}"
    terminal = in_places(stated.terminal, 1 - LEVEL_ROOM)
    claim = replace(stated.claim, inputs=None) if stated.built_in else stated.claim  # then no room need be measured
    settled = settle(found, loop, claim, terminal, Deadline(0, seconds, time.monotonic()), stated.begin)
    if isinstance(settled, str):
        return settled
    if not settled.arrived:
        return "a vertex does not arrive in the terminal set with room for rounding"
    more = Fraction(settled.enclosure.cost) if np.isfinite(settled.enclosure.cost) else None
    if more is None:
        return "rounding errors grow too large"
    expected = None if settled.expected is None else settled.expected + more
    return stated.unsure(settled.enclosure, settled.steps, terminal) or stated.excess(expected, settled.worst + more)


def _by_simplices(loop: PiecewiseLoop, stated: Stated, budget: Budget) -> str:
    terminal = in_places(stated.terminal, 1 - LEVEL_ROOM)
    found = _walked(loop, stated, terminal, budget)
    if isinstance(found, str):
        return found
    errors = enclose(loop, stated.claim, terminal, found.steps, Arrival.of(found.done))
    more = Fraction(errors.cost) if np.isfinite(errors.cost) else Fraction(0)
    expected, worst = found.done.expected_cost().fraction(), found.done.worst_cost()[0].fraction()
    return stated.unsure(errors, found.steps, terminal) or stated.excess(expected + more, worst + more)


def _by_fractions(loop: PiecewiseLoop, stated: Stated, budget: Budget) -> str:
    found = _walked(loop, stated, stated.terminal, budget)
    if isinstance(found, str):
        return found
    if found.slack < 0:  # type: ignore[operator]
        return f"an input exceeds its limit by {-float(found.slack):.3g}"  # type: ignore[arg-type]
    return stated.excess(found.done.expected_cost(), found.done.worst_cost()[0])


def _walked(loop: PiecewiseLoop, stated: Stated, terminal: TerminalSet, budget: Budget) -> Walk | str:
    if stated.claim.initial.dimension > 8:
        return "a set in more than 8 dimensions is not cut into simplices"
    try:
        found = walk(loop, stated.claim, terminal, budget)
    except ConvergenceError as error:
        return str(error)
    return found if found.complete else unfinished(found)


def unfinished(found: Walk | CellWalk) -> str:
    """Why a walk proves nothing yet: what ended it, and what share of the starting points it had followed by then."""
    return (f"the walk ended before all starting points arrived ({found.ended}); a share of {found.followed:.4g} of "
            "them did")
