"""What is known of a law that is an INC: what the judge proves, a Lyapunov equation where it is linear, and simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..inc import INC
from ..judgement import Cause, Judgement, Passed, Refused, judge
from ..judgement.ways import WAYS, by_ellipsoid, by_inequality, by_pieces
from ..linear.controller import LinearController
from ..plant import Plant
from ..spec import Spec
from .effort import Effort
from .families import ANY, LINEAR, STATIC
from .linear_laws import with_lyapunov
from .row import CERTIFIED, EXACT, LYAPUNOV, NO_LIMITS, UPPER, VIOLATED, Cost, Finding, Row
from .simulated import with_simulation

TOLERANCE = 1e-9


def judge_law(plant: Plant, spec: Spec, name: str, inc: INC, effort: Effort) -> Row:
    """Return what can be certified of an INC (`judgement.judge`), and by simulation what cannot.

    A linear law that exact pieces do not certify is judged by its Lyapunov inequality before anything else.

    >>> from inc_casadi import Box
    >>> spec = Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-1, 1))
    >>> row = judge_law(Plant(1.5, 1.0), spec, "clipped", INC.saturated([[-1.5]], 1.0), Effort())
    >>> row.certified, row.kind, row.cost.how, round(row.bound, 6)
    (True, 'neural, 1 unit', 'exact', 0.358333)
    """
    row = bare_row(name, inc)
    ways = (by_pieces,) if _is_linear(inc) else WAYS
    row = _read(row, judge(plant, spec, inc, effort.budget, ways=ways), spec)
    if row.certified or row.notes and row.notes[0].startswith("not proved well posed"):
        return row
    if len(ways) < len(WAYS) and row.limits.verdict != VIOLATED:
        row = with_lyapunov(plant, spec, row, LinearController.static(inc.without_idle_units().K))
        if row.certified or row.cost.how == LYAPUNOV:  # simulation tells nothing more
            return row
        row = _read(row, judge(plant, spec, inc, effort.budget, ways=(by_inequality, by_ellipsoid)), spec)
    return row if row.certified else with_simulation(plant, spec, row, inc, effort)


def bare_row(name: str, inc: INC) -> Row:
    """Return a row that says what kind of law it is and nothing else.

    >>> bare_row("gain", INC.linear([[2.0]])).family.key
    'static'
    """
    law = inc.without_idle_units()
    if law.q:
        return Row(name, inc, f"neural, {inc.q} unit{'s' if inc.q > 1 else ''}", ANY)
    if np.any(law.d):
        return Row(name, inc, "static affine law", LINEAR)  # a constant is the output of an integrator at rest
    return Row(name, inc, "static linear gain", STATIC)


def _is_linear(inc: INC) -> bool:
    """Whether the law is a linear controller of order zero, whose cost and limits a Lyapunov inequality decides too."""
    law = inc.without_idle_units()
    return not law.q and not np.any(law.d) and bool(np.any(law.K))


def _read(row: Row, found: Judgement, spec: Spec) -> Row:
    """The row with what the judge found."""
    if any(one.cause is Cause.ILL_POSED and one.certificate is None for one in found.refused):
        return replace(row, notes=(f"not proved well posed: {found.posed}",))
    if found.built_in:
        built_in = NO_LIMITS if spec.inputs is None else Finding(CERTIFIED, "built in: the range of the activations")
        row = replace(row, limits=built_in)
    for one in found.refused:
        row = _refuted(replace(row, notes=(*row.notes, one.reason)), one)
    best = found.best or next(iter(found.passed), None)
    return row if best is None else _proved(row, best, found)


def _proved(row: Row, best: Passed, found: Judgement) -> Row:
    """The row with a bound that holds; its limits may be open still."""
    row = replace(row, notes=(*row.notes, *best.short))
    if best.converges and row.converges.verdict != CERTIFIED:
        row = replace(row, converges=Finding(CERTIFIED, best.converges))
    followed = next((one for one in found.passed if one.by_worst), None)  # whose worst cost is known though another is lower
    worst = best.worst if followed is None else followed.worst
    if best.limits and row.limits.verdict != CERTIFIED:
        row = replace(row, limits=Finding(CERTIFIED, best.limits), grounds=best.grounds)
    how = EXACT if best.exact else UPPER
    return replace(row, worst=worst, cost=Cost(best.certificate.bound, how, 0.0, best.certificate, best.cost))


def _refuted(row: Row, found: Refused) -> Row:
    """A walk that saw a limit exceeded: its cost is then that of a controller outside the class."""
    if found.cause is not Cause.LIMITS or found.certificate is None:
        return row
    slack = found.certificate.margins().get("inputs", 0.0)
    if slack >= -TOLERANCE:
        return row
    row = replace(row, limits=Finding(VIOLATED, f"an input exceeds its limit by {-slack:.3g}"))
    if not np.isfinite(found.certificate.expected):
        return row
    return replace(row, cost=Cost(found.certificate.bound, EXACT), converges=Finding(CERTIFIED, "exact subdivision"))
