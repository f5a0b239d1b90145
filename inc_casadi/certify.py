"""The verb: ask for a promise about a loop, and get the best evidence that is found."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .certificate import Certificate, MatrixCertificate
from .claims.attraction import Attraction
from .claims.base import Claim
from .claims.invariance import Invariance
from .claims.regional import Regional
from .ellipsoidal_region import certify_ellipsoidal
from .errors import InvalidInputError
from .inc import INC
from .inequalities import Inequalities
from .invariance_certificate import certify_invariance
from .lmi_search import search, unsolved, worst_margin
from .lmi_solvers import Solvers
from .local.certify import certify_attraction
from .loop import ClosedLoop, close_loop
from .multipliers import LADDER, Multiplier, Sector, as_multiplier
from .pieces.walk import Budget
from .plant import Plant, as_plant
from .regional_certificate import certify_region
from .spec import Spec

MOST_UNKNOWNS = 1500  # up to which "auto" tries a rung: about ten seconds for each search


def certify(plant: Any, inc: INC, claim: Claim | Regional | Attraction | Invariance, *,
            multiplier: str | Multiplier = "auto", solver: str = "auto", method: str = "auto",
            budget: Budget | None = None) -> Certificate:
    """Return the best certificate found for a claim about plant and controller; it may not hold, and then says why.

    plant: Plant or control.StateSpace; inc: the controller; claim: what is to be shown.

    Everywhere: a `Claim` such as `Stability`, `DiscountedCost`, `L2Gain`, `Margins`, `Robust`, `Polytopic` or `Together`.
    multiplier: "sector" (eq:M_lambda), "slope" (units of one function), "relu" (complete for kinks), "lifted" (Lyapunov
    functions of x and eta), a Multiplier such as `Lifted(2)`, or "auto". "auto" climbs them in this order, wherever they
    apply, and returns the strongest that holds; for a claim with nothing to improve, the first that holds. The note says
    how each rung fared. solver: "interior point", "clarabel", or "auto", the former with the latter for what it gives up on.

    From a set: `Regional` (method: "pieces", exact, which "auto" stands for, or "ellipsoid": units of any kind, bounds on
    cost), `Attraction` (the largest ellipsoid; method: "linear", "convex hull", "dead zone", "local sectors", "polytope",
    or "auto", the largest of all) and `Invariance` (of a given set; method: "pieces", "mixed-integer", "bounds", or "auto").
    budget: how far exact pieces may go, and for how many seconds an ellipsoid is searched for.

    A matrix certificate is sufficient, not necessary: that none is found does not refute the claim.

    Raises DimensionError or InvalidInputError for arguments that do not fit, SolverError when a solver is missing.

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
        return _regional(plant, inc, claim, method, budget or Budget())
    if isinstance(claim, Attraction):
        return certify_attraction(plant, inc, claim, method)
    if isinstance(claim, Invariance):
        return certify_invariance(plant, inc, claim, method, budget)
    if not isinstance(claim, Claim):
        raise InvalidInputError(f"claim must be a Claim such as Stability(), not {claim!r}")
    if method != "auto":
        raise InvalidInputError(f"method is {method!r}, but {type(claim).__name__} is about every state and proved by "
                                "matrix inequalities, among which `multiplier` chooses; methods are for claims about a set, "
                                "such as Regional or Attraction")
    if isinstance(multiplier, str) and multiplier == "auto":
        rungs: tuple[Multiplier, ...] = LADDER
    else:
        rungs = (as_multiplier(multiplier),)
    loop = close_loop(plant, inc)
    claim.check(plant, inc)
    return _climb(loop, claim, rungs, Solvers(solver))


def _regional(plant: Plant, inc: INC, claim: Regional, method: str, budget: Budget) -> Certificate:
    if method in ("auto", "pieces"):
        return certify_region(plant, inc, claim, budget)
    if method != "ellipsoid":
        raise InvalidInputError(f"method is {method!r}, but for a Regional claim it must be 'auto', 'pieces' or 'ellipsoid'")
    spec = Spec(claim.Q, claim.R, claim.discount, claim.initial, claim.inputs)
    return certify_ellipsoidal(plant, inc, spec, budget.seconds)


def _climb(loop: ClosedLoop, claim: Claim, rungs: tuple[Multiplier, ...], how: Solvers) -> MatrixCertificate:
    """Return the best certificate over the rungs, with a note on each."""
    if not loop.inc.well_posedness().holds:
        return unsolved(loop.plant, loop.inc, claim, Sector(), "not well posed: no search was made")
    obstacle = claim.obstacle(loop.plant, loop.inc)
    if obstacle:
        return unsolved(loop.plant, loop.inc, claim, Sector(), f"{obstacle}: no search was made")
    if len(rungs) == 1 and (refusal := claim.refusal(loop, rungs[0])):
        return unsolved(loop.plant, loop.inc, claim, Sector(), f"{rungs[0].name} was asked for, but {refusal}: no search "
                                                               f"was made. {_instead(loop, claim)}")
    found: list[MatrixCertificate] = []
    notes = []
    for rung in rungs:
        skipped = len(rungs) > 1 and (claim.refusal(loop, rung) or _too_large(loop, claim, rung))
        if skipped:
            notes.append(f"{rung.name}: not tried, {skipped}")
            continue
        found.append(search(loop.plant, loop.inc, claim, rung, solver=how.name))
        holds = found[-1].holds()
        notes.append(f"{rung.name}: " + (f"bound {found[-1].bound:.7g}" if holds else "no certificate found"))
        if holds and claim.yes_or_no:
            break
    if not found:
        return unsolved(loop.plant, loop.inc, claim, Sector(), "; ".join(notes))
    return replace(max(found, key=_strength), note="; ".join(notes))


def _instead(loop: ClosedLoop, claim: Claim) -> str:
    """Return which rungs do apply, in words."""
    names = [repr(rung.name) for rung in LADDER if not claim.refusal(loop, rung)]
    return f"What applies here: {', '.join(names)}; 'auto' takes the strongest" if names else "No multiplier applies here"


def _strength(certificate: MatrixCertificate) -> tuple[bool, float]:
    """Order certificates: those that hold by what they state, the others by their worst margin."""
    if certificate.holds():
        return True, certificate.claim.merit(certificate.loop, certificate.values)
    return False, worst_margin(certificate)


def _too_large(loop: ClosedLoop, claim: Claim, rung: Multiplier) -> str | None:
    size = sum(int(np.count_nonzero(unknown.free)) for unknown in Inequalities(loop, claim, rung).unknowns)
    return f"{size} unknowns are more than {MOST_UNKNOWNS}; ask for it by name" if size > MOST_UNKNOWNS else None
