"""By how much the initial set may grow under a controller, where that is quickly said."""

from __future__ import annotations

from typing import Any

from benchmarks.plants import Case
from inc_casadi import INC, Box, Polytope, Regional, Uniform, largest_scale
from inc_casadi.pieces.walk import Budget
from inc_casadi.regional_certificate import RegionalCertificate

TOLERANCE, PIECES = 1e-2, 20_000
MANY = PIECES // 2


def hopeless(evidence: Any) -> str:
    """Return why a larger initial set is not worth trying, "" where it is.

    Exact pieces that did not do for the set itself, or took almost as many as a larger set may take, will not do for that.

    evidence : the certificate of the law from the set itself

    >>> hopeless(None)
    'its certificate is not one of exact pieces'
    """
    if not isinstance(evidence, RegionalCertificate) or evidence.walk is None:
        return "its certificate is not one of exact pieces"
    pieces = len(evidence.walk.arrived)
    return f"the set itself takes {pieces} pieces, more than {MANY}" if pieces > MANY else ""


def growth(case: Case, controller: Any, seconds: float, seed: int = 0) -> tuple[float | None, float | None]:
    """Return (factor, refuted) of `largest_scale` for a static law that is certified from the set itself.

    It is certified up to `factor`, so from 1 on, and from the set grown by `refuted` a motion breaks an input limit or does
    not come to rest.

    Parameters
    ----------
    case : its initial states must be uniform over a box or polytope
    seconds : for each of some six certificates

    Returns
    -------
    Two factors; None where nothing is known. factor = 256 says that the search went no farther.

    Raises
    ------
    INCError : exact pieces do not apply to this law

    >>> from benchmarks.plants import scalar
    >>> factor, refuted = growth(scalar(), INC.saturated([[-1.5]], 1.0), 1.0)
    >>> bool(1.95 < factor < 2.0 <= refuted < 2.05)
    True
    """
    plant, spec = case.plant, case.spec
    if not isinstance(controller, INC) or not plant.discrete or not isinstance(spec.initial, Uniform):
        return None, None
    if not isinstance(spec.initial.support, Box | Polytope):
        return None, None
    claim = Regional(spec.initial, spec.inputs, spec.Q, spec.R, spec.discount)
    found = largest_scale(plant, controller, claim, tolerance=TOLERANCE, budget=Budget(PIECES, seconds=seconds), seed=seed)
    refuted = found.witness is not None and found.refuted > 1  # what is said from within the certified set is rounding
    return max(1.0, float(found.factor)), float(found.refuted) if refuted else None
