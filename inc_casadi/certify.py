"""The verb: ask for a promise about a loop, and get the best evidence that is found."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from .certificate import Certificate, MatrixCertificate
from .claims.base import Claim
from .claims.regional import Regional
from .errors import InvalidInputError
from .inc import INC
from .loop import ClosedLoop, close_loop
from .multipliers import LADDER, Multiplier, as_multiplier
from .pieces.walk import Budget
from .plant import as_plant
from .regional_certificate import certify_region

LARGEST_RELU = 24  # units with a cone up to which "auto" tries the relu multiplier: its unknowns are 2 k^2


def certify(plant: Any, inc: INC, claim: Claim | Regional, *, multiplier: str | Multiplier = "auto",
            budget: Budget | None = None) -> Certificate:
    """Return the best certificate found for a claim about plant and controller; it may not hold, and then says why.

    plant: Plant or control.StateSpace; inc: the controller; claim: `Stability`, `DiscountedCost` or `Regional`; budget:
    how far the exact pieces of a `Regional` claim may go, which needs no multiplier; multiplier, for the others:
    "sector" (eq:M_lambda), "relu", a Multiplier, or "auto". "auto" climbs from sector to relu, wherever they apply,
    and returns the strongest that holds; for a claim with nothing to improve, the first that holds. The note says
    how each rung fared.

    A matrix certificate is sufficient, not necessary: that none is found does not refute the claim.

    Raises DimensionError or InvalidInputError for arguments that do not fit, SolverError when CVXPY is missing.

    >>> import numpy as np
    >>> from inc_casadi import Box, DiscountedCost, LeakyReLU, Plant
    >>> inc = INC([[0.3, 0.2], [0.2, 0.3]], [[1.0], [-1.0]], [[-0.7, 0.7]], [[0.0]], activation=LeakyReLU(0.5))
    >>> claim = DiscountedCost([[1.0]], [[0.05]], 0.98, Box([-1.0], [1.0]))
    >>> certificate = certify(Plant([[1.2]], [[1.0]]), inc, claim)
    >>> certificate.holds(), certificate.prove().succeeded, round(3 * certificate.bound, 4)
    (True, True, 1.0744)
    """
    plant = as_plant(plant)
    if not isinstance(inc, INC):
        raise InvalidInputError(f"inc must be an INC, not {type(inc).__name__}")
    if isinstance(claim, Regional):
        return certify_region(plant, inc, claim, budget)
    if not isinstance(claim, Claim):
        raise InvalidInputError(f"claim must be a Claim such as Stability(), not {claim!r}")
    if isinstance(multiplier, str) and multiplier == "auto":
        rungs: tuple[Multiplier, ...] = LADDER
    else:
        rungs = (as_multiplier(multiplier),)
    loop = close_loop(plant, inc)
    claim.check(plant, inc)
    return _climb(loop, claim, rungs)


def _climb(loop: ClosedLoop, claim: Claim, rungs: tuple[Multiplier, ...]) -> MatrixCertificate:
    """Return the best certificate over the rungs, with a note on each."""
    from .lmi_search import search, unsolved
    if not loop.inc.well_posedness().holds:
        return unsolved(loop.plant, loop.inc, claim, rungs[0], "not well posed: no search was made")
    if len(rungs) == 1 and rungs[0].refusal(loop):
        return unsolved(loop.plant, loop.inc, claim, rungs[0], "the multiplier does not apply: no search was made")
    found: list[MatrixCertificate] = []
    notes = []
    for rung in rungs:
        skipped = len(rungs) > 1 and (rung.refusal(loop) or _too_large(loop, rung))
        if skipped:
            notes.append(f"{rung.name}: not tried, {skipped}")
            continue
        found.append(search(loop.plant, loop.inc, claim, rung))
        holds = found[-1].holds()
        notes.append(f"{rung.name}: " + (f"bound {found[-1].bound:.7g}" if holds else "no certificate found"))
        if holds and claim.yes_or_no:
            break
    return replace(max(found, key=_strength), note="; ".join(notes))


def _strength(certificate: MatrixCertificate) -> tuple[bool, float]:
    """Order certificates: those that hold by what they state, the others by their worst margin."""
    from .lmi_search import worst_margin
    if certificate.holds():
        return True, certificate.claim.merit(certificate.loop, certificate.values)
    return False, worst_margin(certificate)


def _too_large(loop: ClosedLoop, rung: Multiplier) -> str | None:
    bent = sum(ends is not None for ends in loop.cone)
    if rung.name == "relu" and bent > LARGEST_RELU:
        return f"{bent} units make more than {2 * bent ** 2} unknowns; ask for it by name"
    return None
