"""What is known of a law that is an INC: by exact pieces, a matrix inequality, a Lyapunov equation, and simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..certify import certify
from ..claims import DiscountedCost, Invariance, Regional, Stability
from ..errors import INCError
from ..inc import INC
from ..linear.controller import LinearController
from ..output_range import output_range, within_limits
from ..plant import Plant
from ..regional_certificate import RegionalCertificate
from ..sets import Box, Polytope, Uniform
from ..spec import Spec
from .effort import Effort
from .families import ANY, LINEAR, STATIC
from .linear_laws import with_lyapunov
from .row import CERTIFIED, EXACT, LYAPUNOV, NO_LIMITS, UPPER, VIOLATED, Cost, Finding, Row
from .simulated import with_simulation

TOLERANCE = 1e-9


def judge_law(plant: Plant, spec: Spec, name: str, inc: INC, effort: Effort) -> Row:
    """Return what can be certified of an INC, and by simulation what cannot.

    From a uniform distribution on a box or polytope, exact pieces prove limits, convergence and the exact cost at once
    (`Regional`). Where they do not, the cost is bounded by thm:performance (`DiscountedCost`), and the limits are certified
    where they are built in (the range of the activations) or the initial set is invariant within them
    (eq:regional_input_check): the admissibility that thm:general_superiority asks for.

    >>> from inc_casadi import Box
    >>> spec = Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-1, 1))
    >>> row = judge_law(Plant(1.5, 1.0), spec, "clipped", INC.saturated([[-1.5]], 1.0), Effort())
    >>> row.certified, row.kind, row.cost.how, round(row.bound, 6)
    (True, 'neural, 1 unit', 'exact', 0.358333)
    """
    row = bare_row(name, inc)
    posed = inc.well_posedness()
    if not posed.holds:
        return replace(row, notes=(f"not proved well posed: {posed.test}",))
    if spec.inputs is None:
        row = replace(row, limits=NO_LIMITS)
    elif within_limits(inc, spec.inputs):
        row = replace(row, limits=Finding(CERTIFIED, "built in: the range of the activations"))
    for step in (_by_pieces, _by_lyapunov, _by_inequality):
        if row.certified:
            return row
        row = step(plant, spec, row, effort)
    if row.certified or row.cost.how == LYAPUNOV:  # of a linear loop, simulation tells nothing more
        return row
    return with_simulation(plant, spec, row, inc, effort)


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


def _by_pieces(plant: Plant, spec: Spec, row: Row, effort: Effort) -> Row:
    if not isinstance(spec.initial, Uniform) or not isinstance(spec.initial.support, Box | Polytope):
        return _noted(row, "exact pieces: the initial distribution is not uniform over a polytope")
    claim = Regional(spec.initial, spec.inputs, spec.Q, spec.R, spec.discount)
    try:
        certificate = certify(plant, row.controller, claim, budget=effort.budget)
        reason = certificate.reason
    except INCError as error:  # a box of many dimensions has too many simplices
        return _noted(row, f"exact pieces: {error}")
    assert isinstance(certificate, RegionalCertificate)
    if reason:
        return _refuted(_noted(row, f"exact pieces: {reason}"), certificate)
    words = "exact subdivision of the initial set"
    row = replace(row, converges=Finding(CERTIFIED, words), worst=certificate.worst_bound)
    if row.limits.verdict != CERTIFIED:
        row = replace(row, limits=Finding(CERTIFIED, words), grounds=(certificate,))
    if not np.isfinite(certificate.expected):  # the largest cost only, which an inequality may undercut
        words = f"the largest cost, by {words}"
        other = _by_inequality(plant, spec, row, effort)
        if other.certified and other.cost.value < certificate.bound:
            return other
        return replace(row, cost=Cost(certificate.bound, UPPER, 0.0, certificate, words), grounds=())
    how = EXACT if certificate.gap <= 1e-9 * certificate.bound else UPPER
    return replace(row, cost=Cost(certificate.bound, how, 0.0, certificate, words), grounds=())


def _refuted(row: Row, certificate: RegionalCertificate) -> Row:
    """A walk that saw a limit exceeded: its cost is then that of a controller outside the class."""
    slack = certificate.margins().get("inputs", 0.0)
    if slack >= -TOLERANCE:
        return row
    row = replace(row, limits=Finding(VIOLATED, f"an input exceeds its limit by {-slack:.3g}"))
    if not np.isfinite(certificate.expected):
        return row
    return replace(row, cost=Cost(certificate.bound, EXACT), converges=Finding(CERTIFIED, "exact subdivision"))


def _by_inequality(plant: Plant, spec: Spec, row: Row, effort: Effort) -> Row:
    inc: INC = row.controller
    if row.limits.verdict == VIOLATED:
        return row
    if row.cost.how == LYAPUNOV:  # a linear law: nothing more is to be learned
        return row
    bounded = all(np.isfinite(float(end)) for pair in output_range(inc) for end in pair)
    if bounded and plant.discrete and np.max(np.abs(np.linalg.eigvals(plant.A))) >= 1:
        return _noted(row, "matrix inequality: no bounded input stabilizes this unstable plant from everywhere")
    row = _limits_kept(plant, spec, row, effort)
    try:
        certificate = certify(plant, inc, DiscountedCost(spec.Q, spec.R, spec.discount, spec.initial))
        if not certificate.holds():
            return _noted(row, f"matrix inequality: {certificate.reason}")
        words = f"matrix inequality, multiplier {certificate.multiplier.name}"  # type: ignore[attr-defined]
        row = replace(row, cost=Cost(certificate.bound, UPPER, 0.0, certificate, words))
        stable = None if row.converges.verdict == CERTIFIED else certify(plant, inc, Stability())
    except INCError as error:
        return _noted(row, f"matrix inequality: {error}")
    return replace(row, converges=Finding(CERTIFIED, stable.sentence)) if stable and stable.holds() else row


def _limits_kept(plant: Plant, spec: Spec, row: Row, effort: Effort) -> Row:
    """The row with its limits certified, where the initial set is invariant within them."""
    if row.limits.verdict == CERTIFIED or spec.inputs is None:
        return row
    if not isinstance(spec.initial.support, Box | Polytope):
        return _noted(row, "limits: not built in, and the initial states are not those of a box or polytope")
    try:
        kept = certify(plant, row.controller, Invariance(spec.initial.support, spec.inputs), budget=effort.budget)
        if not kept.holds():
            return _noted(row, f"limits: not built in, and the initial set is not invariant within them, {kept.reason}")
    except INCError as error:
        return _noted(row, f"limits: {error}")
    words = "the initial set is invariant within them"
    return replace(row, limits=Finding(CERTIFIED, words), grounds=(*row.grounds, kept))


def _by_lyapunov(plant: Plant, spec: Spec, row: Row, effort: Effort) -> Row:
    """A linear law is a linear controller of order zero, whose cost and limits a Lyapunov inequality decides too."""
    law = row.controller.without_idle_units()
    if law.q or np.any(law.d) or row.limits.verdict == VIOLATED or not np.any(law.K):
        return row
    return with_lyapunov(plant, spec, row, LinearController.static(law.K))


def _noted(row: Row, words: str) -> Row:
    return replace(row, notes=(*row.notes, words))
