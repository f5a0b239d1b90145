"""Whether what a saved comparison says of its controllers and classes agrees with the evidence that it holds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from ..bounds import Bound
from ..bounds.affine_bound import AffineMovesBound
from ..bounds.any_controller import AnyControllerBound
from ..bounds.output_feedback import OutputFeedbackBound
from ..bounds.unmeasured import UnmeasuredBound
from ..bounds.value_iteration import UnlimitedBound
from ..claims import DiscountedCost, Invariance, Regional
from ..comparison import Comparison
from ..comparison.families import ANY, LINEAR, STATIC, Family
from ..comparison.row import CERTIFIED, Row
from ..dynamic import DynamicCertificate, DynamicINC, extended, extended_spec
from ..ellipsoidal_region import EllipsoidalRegion
from ..inc import INC
from ..invariance_certificate import InvarianceCertificate
from ..linear import ClippedCost, LinearController, LinearCost, UnswitchedCost
from ..output_range import within_limits
from ..plant import Plant
from ..regional_certificate import RegionalCertificate
from ..sets import Box, Polytope
from ..spec import Spec
from .encoding import digest, encoded
from .kinds import BESIDE

COVERING = (RegionalCertificate, DynamicCertificate, EllipsoidalRegion, LinearCost, UnswitchedCost,
            ClippedCost, InvarianceCertificate)
"""Certificates that state, of a specification that fits them, that inputs stay within the limits."""


def disagreement(comparison: Comparison) -> str:
    """Return in words how a comparison differs from its evidence, or nothing.

    `compare` makes rows from evidence, so there they agree. In a file anything may stand: a certificate that holds, but of
    another plant, or beside a lower cost than it proves. Certificates and bounds must speak of the comparison's plant and
    specification and of the row's controller; a certified cost is not below what its certificate states, which is computed
    again; limits are kept by a certificate or by the range of the activations; a class is not larger than the bound says.
    Whether certificates and bounds hold is another question, which they answer themselves.

    >>> from inc_casadi import Box, Plant, compare
    >>> spec = Spec(Q=1.0, R=0.0, discount=1.0, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> disagreement(compare(Plant(1.5, 1.0), spec, {"clipped": INC.saturated([[-1.5]], 1.0)}, bounds=["linear"]))
    ''
    """
    for row in comparison.rows:
        found = _of_row(comparison, row)
        if found:
            return f"controller {row.name!r}: {found}"
    for floor in comparison.floors:
        found = "" if floor.bound is None else strange_bound(floor.bound, comparison.plant, comparison.spec, floor.family)
        if found:
            return f"the lower bound on {floor.family.title} {found}"
    return ""


def strange_bound(bound: Bound, plant: Plant, spec: Spec, family: Family) -> str:
    """Return in words why a lower bound is not one on this class for this plant and specification, or nothing.

    >>> from inc_casadi import Box, Plant, bounds
    >>> spec = Spec(Q=1.0, R=0.0, discount=1.0, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> strange_bound(bounds.first_move(Plant(1.5, 1.0), spec), Plant(1.5, 1.0), spec, ANY)
    'is one on a smaller class'
    """
    if not (same(bound.plant, plant) and same(bound.spec, spec)):
        return "is about another plant or specification"
    return "is one on a smaller class" if family.rank > _rank(bound) else ""


def strange_certificate(certificate: Any, plant: Plant, spec: Spec, controller: Any) -> str:
    """Return in words why a certificate does not speak of this plant, specification and controller, or nothing.

    >>> from inc_casadi import Box, DiscountedCost, Plant, certify
    >>> plant, law, spec = Plant(0.5, 1.0), INC.linear([[-0.1]]), Spec(Q=1.0, R=0.0, discount=1.0, initial=Box(-1, 1))
    >>> found = certify(plant, law, DiscountedCost(spec.Q, spec.R, spec.discount, spec.initial))
    >>> strange_certificate(found, plant, spec, law), strange_certificate(found, plant, spec, INC.linear([[0.1]]))
    ('', 'is about another plant or controller')
    """
    if isinstance(certificate, EllipsoidalRegion) and isinstance(controller, DynamicINC):
        spec = _with_memory(spec, controller, certificate.spec.inputs)
        plant, controller = extended(plant, controller)
    if not (same(getattr(certificate, "plant", None), plant) and _about(certificate, controller)):
        return "is about another plant or controller"
    return "" if _fits(certificate, spec) else "is about another specification"


def same(left: Any, right: Any) -> bool:
    """Return whether two things are written alike, bit for bit, but for what stands beside their fields.

    >>> same(INC.linear([[1.0]]), INC.linear([[1.0]])), same(INC.linear([[0.0]]), INC.linear([[-0.0]]))
    (True, False)
    """
    return left is right or digest(_bare(encoded(left))) == digest(_bare(encoded(right)))


def _bare(content: Any) -> Any:
    """JSON content without what is written beside the fields: a polytope may have its vertices already, or not yet."""
    if isinstance(content, list):
        return [_bare(entry) for entry in content]
    if not isinstance(content, dict):
        return content
    beside = {name for kind, names in BESIDE.items() if content.get("kind") == kind.__name__ for name in names}
    if "data" in content:
        return {"kind": content["kind"], "data": {name: _bare(entry) for name, entry in content["data"].items()
                                                  if name not in beside}}
    return {name: entry if name == "array" else _bare(entry) for name, entry in content.items()}


def _rank(bound: Bound) -> int:
    """The rank of the largest class that a kind of bound is known to cover."""
    if isinstance(bound, AnyControllerBound | OutputFeedbackBound | UnmeasuredBound | UnlimitedBound):
        return ANY.rank
    return LINEAR.rank if isinstance(bound, AffineMovesBound) else STATIC.rank


def _of_row(comparison: Comparison, row: Row) -> str:
    evidence = row.cost.evidence
    if evidence is None:
        return ""
    for one in row.evidence:
        found = strange_certificate(one, comparison.plant, comparison.spec, row.controller)
        if found:
            return f"a certificate {found}"
    if not row.cost.value >= evidence.bound:  # type: ignore[attr-defined]
        return f"its cost is stated as {row.cost.value!r}, but its certificate proves {evidence.bound!r}"  # type: ignore
    if row.limits.verdict == CERTIFIED and not limits_kept(row.evidence, row.controller, comparison.spec):
        return "that it keeps the input limits rests on nothing"
    return ""


def _about(evidence: Any, controller: Any) -> bool:
    if isinstance(evidence, LinearCost):
        given = controller
        if isinstance(controller, INC):
            law = controller.without_idle_units()
            if law.q or np.any(law.d):
                return False
            given = LinearController.static(law.K)
        return same(evidence.controller, given)
    return same(evidence.dynamic if isinstance(evidence, DynamicCertificate) else getattr(evidence, "inc", None), controller)


def _with_memory(spec: Spec, controller: DynamicINC, stated: Box | Polytope | None) -> Spec:
    """The specification of plant and controller together, the states of the controller limited as the certificate has it."""
    l = controller.order
    if spec.inputs is None or stated is None:
        return extended_spec(replace(spec, inputs=None), controller)
    if isinstance(stated, Box):
        return extended_spec(spec, controller, Box(stated.lower[-l:], stated.upper[-l:]))
    return extended_spec(spec, controller, Box(-stated.h[-l:], stated.h[-2 * l:-l]))


def _fits(evidence: Any, spec: Spec) -> bool:
    if isinstance(evidence, LinearCost | EllipsoidalRegion | UnswitchedCost | ClippedCost):
        return same(evidence.spec, spec)
    claim = getattr(evidence, "claim", None)
    if isinstance(claim, Regional):
        return same(claim, Regional(spec.initial, spec.inputs,  # type: ignore[arg-type]
                                    spec.Q, spec.R, spec.discount))
    if isinstance(claim, DiscountedCost):
        return same(claim, DiscountedCost(spec.Q, spec.R, spec.discount, spec.initial))
    return isinstance(claim, Invariance) and spec.inputs is not None \
        and same(claim, Invariance(spec.initial.support, spec.inputs))  # type: ignore[arg-type]


def limits_kept(certificates: Iterable[Any], controller: Any, spec: Spec) -> bool:
    """Return whether one of the certificates covers the input limits, or the range of the activations does; none may hold.

    >>> from inc_casadi import Box
    >>> spec = Spec(Q=1.0, R=0.0, discount=1.0, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> limits_kept((), INC.saturated([[2.0]], 1.0), spec), limits_kept((), INC.linear([[2.0]]), spec)
    (True, False)
    """
    if spec.inputs is None or any(isinstance(one, COVERING) for one in certificates):
        return True
    return isinstance(controller, INC) and within_limits(controller, spec.inputs)
