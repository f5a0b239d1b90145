"""The gate for controllers with memory: one certificate that covers limits, convergence and cost from (x_0, xi_0)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inc_casadi import Box, Plant, Regional, Spec
from inc_casadi.dynamic import DynamicCertificate, DynamicINC, certify_dynamic, extended, extended_spec
from inc_casadi.dynamic.fold import visited
from inc_casadi.errors import INCError
from inc_casadi.judgement import judge
from inc_casadi.judgement.clipped import by_clipping
from inc_casadi.judgement.unswitched import by_lyapunov
from inc_casadi.judgement.ways import Way, by_ellipsoid, by_inequality
from inc_casadi.output_range import within_limits
from inc_casadi.pieces.cell_walk import MOST_DIMENSIONS
from inc_casadi.pieces.walk import Budget
from inc_casadi.sets import Polytope, Uniform

from .causes import Cause
from .gate import Verdict

PIECES = "exact pieces"
SUBDIVISION = "exact subdivision of the initial set"


def gate_dynamic(plant: Plant, spec: Spec, dynamic: DynamicINC, budget: Budget | None = None, *,
                 loose: bool = False) -> Verdict:
    """Let a controller with memory through on one certificate that holds (prop:certification_gate).

    From a uniform distribution over a box or polytope exact pieces prove it all (`certify_dynamic`): the initial set of the
    extended plant is X_0 x {xi_0}, flat, and followed as such. In more than 8 dimensions they give the largest cost only:
    there the Lyapunov inequality of a loop that never leaves its linear piece, and bounds on what seldom clipping adds, are
    asked of the extended plant first. From other distributions, and where `loose`, the matrix inequality for all (x, xi) and
    the ellipsoid that contains the initial set are asked of it. How the controller was found plays no part.

    >>> from inc_casadi import INC
    >>> delay = DynamicINC(INC.linear([[-1.0, -0.5], [1.0, 0.0]]), [0.0])
    >>> verdict = gate_dynamic(Plant(1.5, 1.0), Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-3, 3)), delay)
    >>> verdict.accepted, verdict.proofs[1]
    (True, 'input limits kept on every motion: exact subdivision of the initial set')
    """
    budget = budget or Budget()
    until = time.monotonic() + budget.seconds
    posed = dynamic.law.well_posedness()
    if not posed.holds:
        return Verdict(None, np.inf, (), (f"well-posedness: {posed.test}",), (Cause.ILL_POSED,))
    opened = (f"well posed: {posed.test}",)
    if plant.n > MOST_DIMENSIONS and (spec.inputs is None or within_limits(dynamic.readout, spec.inputs)):
        found = _on_extended(plant, spec, dynamic, budget, Verdict(None, np.inf, opened, ()), (by_lyapunov, by_clipping))
        if found.accepted:
            return found
    found = _by_pieces(plant, spec, dynamic, budget, *opened)
    if found.accepted or not (loose or Cause.HOPELESS in found.causes):
        return found
    left = max(until - time.monotonic(), 0.2 * budget.seconds)
    return _on_extended(plant, spec, dynamic, replace(budget, seconds=left), found, (by_inequality, by_ellipsoid))


def _by_pieces(plant: Plant, spec: Spec, dynamic: DynamicINC, budget: Budget, posed: str) -> Verdict:
    if not isinstance(spec.initial, Uniform) or not isinstance(spec.initial.support, Box | Polytope):
        why = f"{PIECES}: the initial distribution is not uniform over a polytope"
        return Verdict(None, np.inf, (posed,), (why,), (Cause.HOPELESS,))
    claim = Regional(spec.initial, spec.inputs, spec.Q, spec.R, spec.discount)
    try:
        certificate = certify_dynamic(plant, dynamic, claim, budget=budget)
        reason = certificate.reason
    except INCError as error:
        return Verdict(None, np.inf, (posed,), (f"{PIECES}: {error}",), (Cause.HOPELESS,))
    if reason:
        return Verdict(None, np.inf, (posed,), (f"{PIECES}: {reason}",), (_cause(reason),))
    return Verdict(certificate, certificate.bound, (posed, *_proofs(spec, certificate)), (), ())


def _proofs(spec: Spec, certificate: DynamicCertificate) -> list[str]:
    inner = certificate.inner
    assert inner.walk is not None
    costs = "expected and worst cost" if np.isfinite(inner.expected) else "worst cost, which bounds the expected one"
    proofs = [f"converges from every initial state: exact subdivision, {len(inner.walk.arrived)} pieces",
              f"{costs}: exact subdivision"]
    return proofs if spec.inputs is None else [f"input limits kept on every motion: {SUBDIVISION}", *proofs]


def _cause(reason: str) -> Cause:
    """The reason in one word, as `judgement.cause_of` has it of static laws."""
    for words, cause in (("not piecewise affine", Cause.SMOOTH), ("time limit", Cause.TIME), ("more than", Cause.PIECES),
                         ("kink", Cause.KINK), ("exceeds its limit", Cause.LIMITS), ("does not stabilize", Cause.UNSTABLE),
                         ("the walk ended", Cause.LOST)):
        if words in reason:
            return cause
    return Cause.UNCERTIFIED


def _on_extended(plant: Plant, spec: Spec, dynamic: DynamicINC, budget: Budget, before: Verdict,
                 ways: Sequence[Way]) -> Verdict:
    """What other ways prove on the extended plant; built-in limits need no box for xi."""
    wide, law = extended(plant, dynamic)
    free = spec.inputs is None or within_limits(dynamic.readout, spec.inputs)
    try:
        asked = extended_spec(replace(spec, inputs=None), dynamic) if free else extended_spec(
            spec, dynamic, visited(plant, dynamic, Regional(spec.initial.support, spec.inputs, spec.Q, spec.R)))  # type: ignore
        found = judge(wide, asked, law, budget, alone=True, ways=ways)
    except INCError as error:
        return replace(before, refusals=(*before.refusals, str(error)))
    if found.best is None:
        return replace(before, refusals=(*before.refusals, *(one.reason for one in found.refused)),
                       causes=(*before.causes, *(one.cause for one in found.refused)))
    kept = ("input limits kept: the range of the readout",) if free and spec.inputs is not None else ()
    return Verdict(found.best.certificate, found.best.certificate.bound, (before.proofs[0], *kept, *found.best.proofs),
                   before.refusals, before.causes)
