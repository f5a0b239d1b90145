"""The gate: a candidate passes only on a certificate that holds (prop:certification_gate) or a regional proof."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inc_casadi import INC, Plant, Spec
from inc_casadi.brief import Brief
from inc_casadi.certificate import Certificate
from inc_casadi.ellipsoidal_region import EllipsoidalRegion
from inc_casadi.judgement import Judgement, judge
from inc_casadi.pieces.walk import Budget
from inc_casadi.regional_certificate import RegionalCertificate

from .causes import Cause


@dataclass(frozen=True, eq=False)
class Verdict(Brief):
    """What the gate says of a candidate.

    certificate: the one that holds with the lowest cost, or None; cost: its certified expected cost, infinite without;
    proofs: what is proved, in words; refusals: what is not, each with its reason; causes: the same, one word each.
    """

    certificate: Certificate | None
    cost: float
    proofs: tuple[str, ...]
    refusals: tuple[str, ...]
    causes: tuple[Cause, ...] = ()

    @property
    def accepted(self) -> bool:
        """Whether the candidate is certified."""
        return self.certificate is not None

    @property
    def settled(self) -> bool:
        """Whether no other law is worth trying for the reasons given: accepted, and not on a bound that is loose.

        Loose is the bound of an ellipsoid, and that of exact pieces where they give the largest cost only.
        """
        loose = isinstance(self.certificate, EllipsoidalRegion) or (
            isinstance(self.certificate, RegionalCertificate) and not np.isfinite(self.certificate.expected))
        return self.accepted and not loose


def gate(plant: Plant, spec: Spec, inc: INC, budget: Budget | None = None) -> Verdict:
    """Let a candidate through on one certificate that covers limits and cost (`inc_casadi.judgement.judge`).

    Tried are the affine piece that no motion leaves, the exact regional proof, bounded clipping, then, where input limits
    are built in or absent, the global inequality, then an ellipsoid around the initial set. The optimizer plays no part.

    >>> from inc_casadi import Box, Tanh
    >>> law = INC([[0.0]], [[1.6]], [[-1.0]], [[0.0]], activation=Tanh())
    >>> verdict = gate(Plant(1.5, 1.0), Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-1, 1)), law)
    >>> verdict.accepted, [cause.name for cause in verdict.causes]
    (True, ['SMOOTH', 'HOPELESS'])
    """
    found = judge(plant, spec, inc, budget, alone=True)
    return _verdict(found)


def _verdict(found: Judgement) -> Verdict:
    reasons = tuple(one.reason for one in found.refused)
    causes = tuple(one.cause for one in found.refused)
    posed = () if Cause.ILL_POSED in causes else (f"well posed: {found.posed}",)
    best = found.best
    if best is None:
        return Verdict(None, np.inf, posed, reasons, causes)
    return Verdict(best.certificate, best.certificate.bound, (*posed, *best.proofs), reasons, causes)
