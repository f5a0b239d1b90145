"""A result beside its lower bounds, so that what follows is said by the same code as in every comparison."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from inc_casadi.comparison import Comparison
from inc_casadi.comparison.families import ANY, LINEAR
from inc_casadi.comparison.floors import Floor
from inc_casadi.comparison.laws import bare_row
from inc_casadi.comparison.row import CERTIFIED, EXACT, SIMULATED, UPPER, Cost, Finding, Row
from inc_casadi.linear import UnswitchedCost
from inc_casadi.regional_certificate import RegionalCertificate

if TYPE_CHECKING:
    from .result import Result

THIS = "this controller"


def compared(result: Result) -> Comparison:
    """Return the comparison of a result's controller with its lower bounds; no row without a controller.

    A certificate that the gate accepted covers the input limits too, as prop:certification_gate asks.
    """
    floors = tuple(Floor(LINEAR if name.startswith("linear") else ANY, bound, "", bound.seconds)
                   for name, bound in result.bounds.items())
    proofs = {} if result.proof is None else {THIS: result.proof}
    rows = () if result.inc is None else (_row(result),)
    return Comparison(result.plant, result.spec, rows, floors, proofs)


def _row(result: Result) -> Row:
    assert result.inc is not None
    row = bare_row(THIS, result.inc)
    certificate, run = result.certificate, result.estimate
    if certificate is not None:
        exact = isinstance(certificate, UnswitchedCost) and certificate.gap == 0 or (
            isinstance(certificate, RegionalCertificate) and certificate.gap == 0
            and bool(np.isfinite(certificate.expected)))
        words = certificate.sentence
        return replace(row, limits=Finding(CERTIFIED, "accepted by the gate"), worst=result.worst,
                       cost=Cost(certificate.bound, EXACT if exact else UPPER, 0.0, certificate, words))
    return row if run is None else replace(row, cost=Cost(run.mean, SIMULATED, run.standard_error))
