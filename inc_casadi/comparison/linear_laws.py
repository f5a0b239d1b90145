"""What is known of a linear controller: a Lyapunov inequality for its cost, supports and one more for the limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..certificate import MatrixCertificate
from ..claims import Stability
from ..errors import INCError
from ..linear.controller import LinearController
from ..linear.dynamic_loop import started
from ..linear.linear_cost import LinearCost, linear_cost
from ..linear.lyapunov import discounted_sum
from ..multipliers import as_multiplier
from ..plant import Plant
from ..spec import Spec
from .effort import Effort
from .families import LINEAR, STATIC
from .row import CERTIFIED, LYAPUNOV, NO_LIMITS, OPEN, SEEN, VIOLATED, Cost, Finding, Row
from .violations import STEPS, first_violation


def judge_linear(plant: Plant, spec: Spec, name: str, controller: LinearController, effort: Effort) -> Row:
    """Return what can be certified of a linear controller of finite order from its fixed initial state (`linear_cost`).

    >>> from inc_casadi import Box
    >>> spec = Spec(1.0, 0.0, 0.5, Box(-1, 1), Box(-1, 1))
    >>> row = judge_linear(Plant(1.5, 1.0), spec, "gain", LinearController.static([[-1.0]]), Effort())
    >>> row.certified, row.cost.how, round(row.bound, 6)
    (True, 'Lyapunov', 0.380952)
    """
    if controller.order:
        row = Row(name, controller, f"dynamic linear, order {controller.order}", LINEAR)
    else:
        row = Row(name, controller, "static linear gain", STATIC)
    return with_lyapunov(plant, spec, row, controller)


def with_lyapunov(plant: Plant, spec: Spec, row: Row, controller: LinearController) -> Row:
    """Return the row with cost, limits and convergence of the linear controller that it is about."""
    try:
        found = linear_cost(plant, spec, controller)
    except INCError as error:
        return replace(row, notes=(*row.notes, f"Lyapunov: {error}"))
    reason = found.reason
    row = replace(row, limits=_limits(spec, found), converges=_converges(found))
    if reason:
        value = found.cost if found.P is not None else np.inf
        return replace(row, cost=Cost(value, LYAPUNOV), notes=(*row.notes, f"Lyapunov: {reason}"))
    worst = found.worst
    return replace(row, cost=Cost(found.bound, LYAPUNOV, 0.0, found, "a Lyapunov inequality of the linear loop"),
                   worst=np.nan if worst is None else worst)


def _limits(spec: Spec, found: LinearCost) -> Finding:
    if spec.inputs is None:
        return NO_LIMITS
    if found.admissible:
        return Finding(CERTIFIED, "the first moves by supports, those to come by a Lyapunov inequality")
    start = started(spec.initial, found.controller)
    violation = first_violation(spec.inputs, start, found.loop.F, found.loop.G[: spec.m])
    if violation:
        return Finding(VIOLATED, violation)
    return Finding(SEEN, f"no limit is exceeded in {STEPS} steps from any initial state")


def _converges(found: LinearCost) -> Finding:
    """Whether P = sum_k (F^k)'F^k, for which P - F'P F = I > 0, proves the loop z+ = F z stable (thm:dt_stability)."""
    loop = found.loop
    radius = float(np.max(np.abs(np.linalg.eigvals(loop.F))))
    if radius >= 1:
        return Finding(VIOLATED, f"the linear loop has the spectral radius {radius:.6g}")
    P = discounted_sum(loop.F, np.eye(loop.plant.n))
    if P is None:
        return Finding(OPEN, "the linear loop is too near to the edge of stability")
    stable = MatrixCertificate(loop.plant, loop.inc, Stability(), as_multiplier("sector"), {"P": P, "Lambda": np.zeros(0)})
    return Finding(CERTIFIED, stable.sentence) if stable.holds() else Finding(OPEN, stable.reason)
