"""What is known of a controller with memory that is not linear: exact pieces on its folded loop, and simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..claims import Regional
from ..dynamic import DynamicINC, certify_dynamic, extended, extended_spec
from ..dynamic.fold import visited
from ..ellipsoidal_region import certify_ellipsoidal
from ..errors import INCError
from ..linear.controller import LinearController
from ..plant import Plant
from ..sets import Box, Polytope, Uniform
from ..spec import Spec
from .effort import Effort
from .families import ANY, LINEAR
from .linear_laws import judge_linear
from .row import CERTIFIED, EXACT, NO_LIMITS, UPPER, Cost, Finding, Row
from .simulated import with_simulation

PIECES = "exact subdivision of the initial set, the controller's state beside it"
ELLIPSOID = "an ellipsoid of attraction in the states of plant and controller that contains the initial set"
SHARE = 0.5  # of the budget's seconds that an ellipsoid may take
ROUNDING = 1e-9  # share of the cost up to which a gap counts as rounding
FAR = 2.0**40  # the largest state of a controller that a simulation follows


def judge_dynamic(plant: Plant, spec: Spec, name: str, dynamic: DynamicINC, effort: Effort) -> Row:
    """Return what can be certified of a controller with memory (`certify_dynamic`), and by simulation what cannot.

    Without hidden units it is a linear controller, and judged as one, in the class of linear controllers.

    >>> from inc_casadi import INC, Box
    >>> spec = Spec(1.0, 0.0, 0.9, Box(-0.5, 0.5), Box(-1, 1))
    >>> slow = DynamicINC(INC.linear([[-1.0, -0.25], [1.0, 0.0]]), [0.0]).with_saturated_output(Box(-1, 1))
    >>> row = judge_dynamic(Plant(1.5, 1.0), spec, "slow", slow, Effort())
    >>> row.certified, row.kind, row.family.key
    (True, 'dynamic, order 1, 1 unit', 'any')
    """
    if not dynamic.q and not np.any(dynamic.law.d):
        return replace(judge_linear(plant, spec, name, _linear(dynamic), effort), controller=dynamic)
    kind = f"dynamic, order {dynamic.order}, {dynamic.q} unit{'s' if dynamic.q > 1 else ''}"
    row = Row(name, dynamic, kind, ANY if dynamic.q else LINEAR)
    posed = dynamic.law.well_posedness()
    if not posed.holds:
        return replace(row, notes=(f"not proved well posed: {posed.test}",))
    for step in (_by_pieces, _by_ellipsoid, _simulated):
        row = row if row.certified else step(plant, spec, row, effort)
    return row


def _linear(dynamic: DynamicINC) -> LinearController:
    """The controller without hidden units and constants, its numbers only rearranged."""
    K, m, p = dynamic.law.K, dynamic.m, dynamic.p
    return LinearController(K[m:, p:], K[m:, :p], K[:m, p:], K[:m, :p], dynamic.xi_0)


def _by_pieces(plant: Plant, spec: Spec, row: Row, effort: Effort) -> Row:
    if not isinstance(spec.initial, Uniform) or not isinstance(spec.initial.support, Box | Polytope):
        return replace(row, notes=("exact pieces: the initial distribution is not uniform over a polytope",))
    try:
        claim = Regional(spec.initial, spec.inputs, spec.Q, spec.R, spec.discount)
        found = certify_dynamic(plant, row.controller, claim, budget=effort.budget)
        reason = found.reason
    except INCError as error:
        return replace(row, notes=(f"exact pieces: {error}",))
    if reason:
        return replace(row, notes=(f"exact pieces: {reason}",))
    kept = NO_LIMITS if spec.inputs is None else Finding(CERTIFIED, PIECES)
    exact = bool(np.isfinite(found.inner.expected)) and found.inner.gap <= ROUNDING * found.bound
    cost = Cost(found.bound, EXACT if exact else UPPER, 0.0, found, PIECES)
    return replace(row, limits=kept, converges=Finding(CERTIFIED, PIECES), cost=cost, worst=found.worst_bound)


def _by_ellipsoid(plant: Plant, spec: Spec, row: Row, effort: Effort) -> Row:
    """The row with what an ellipsoid in (x, xi) proves: of units of any kind, xi in a box that simulation suggests."""
    support = spec.initial.support
    if not isinstance(support, Box | Polytope):
        return row
    try:
        claim = Regional(support, spec.inputs, spec.Q, spec.R, spec.discount)
        memory = None if spec.inputs is None else visited(plant, row.controller, claim)
        wide, law = extended(plant, row.controller)
        found = certify_ellipsoidal(wide, law, extended_spec(spec, row.controller, memory), SHARE * effort.budget.seconds)
    except INCError as error:
        return replace(row, notes=(*row.notes, f"ellipsoid: {error}"))
    if found.reason:
        return replace(row, notes=(*row.notes, f"ellipsoid: {found.reason}"))
    kept = NO_LIMITS if spec.inputs is None else Finding(CERTIFIED, ELLIPSOID)
    return replace(row, limits=kept, converges=Finding(CERTIFIED, ELLIPSOID), worst=found.worst_bound,
                   cost=Cost(found.bound, UPPER, 0.0, found, ELLIPSOID))


def _simulated(plant: Plant, spec: Spec, row: Row, effort: Effort) -> Row:
    """The row with simulated motions of the extended plant, xi+ as an input of its own that no limit is near to."""
    try:
        wide, law = extended(plant, row.controller)
        l = row.controller.order
        far = Plant(wide.A, np.hstack([wide.B[:, :-l], FAR * wide.B[:, -l:]]), wide.C, wide.dt)
        unit = Box(-np.ones(l), np.ones(l))

        def scaled(y: Array) -> Array:
            both = law(y)
            return np.vstack([both[:-l], both[-l:] / FAR])

        return with_simulation(far, extended_spec(spec, row.controller, unit), row, scaled, effort)
    except INCError as error:
        return replace(row, notes=(*row.notes, f"simulation: {error}"))
