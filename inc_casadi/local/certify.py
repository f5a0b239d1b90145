"""Ask for a region of attraction, and get the largest ellipsoid that any local method certifies."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..certificate_values import posed_values
from ..claims.attraction import Attraction
from ..ellipsoid_certificate import NO_REST, EllipsoidCertificate
from ..errors import InvalidInputError
from ..hindrance import linearization, point, too_fast
from ..inc import INC
from ..loop import ClosedLoop, close_loop
from ..plant import as_plant
from .base import LocalMethod, Setting
from .lines import lines
from .methods import METHODS, method_of
from .rest import Rest, rest_of

MOST_ROWS = 40  # n + q up to which "auto" tries the dead zone's cone program


def certify_attraction(plant: Any, inc: INC, claim: Attraction, method: str = "auto") -> EllipsoidCertificate:
    """Return the certificate of the largest ellipsoid found; it may not hold, and then says why.

    plant: Plant or control.StateSpace; method: the name of a local method ("linear", "convex hull", "dead zone", ...) or
    "auto", which asks every method that applies and takes the largest in what the claim maximizes.

    Sufficient, not necessary: that none is found does not mean that the equilibrium attracts nothing.

    Raises DimensionError or InvalidInputError for arguments that do not fit, SolverError when a solver is missing.

    >>> from inc_casadi import Plant
    >>> found = certify_attraction(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.2]], 1.0), Attraction())
    >>> found.holds(), 3.99 < found.volume < 4.0   # the interval (-2, 2) is all that can be steered
    (True, True)
    """
    plant = as_plant(plant)
    if not isinstance(inc, INC):
        raise InvalidInputError(f"inc must be an INC, not {type(inc).__name__}")
    if not isinstance(claim, Attraction):
        raise InvalidInputError(f"claim must be an Attraction, not {claim!r}")
    loop = close_loop(plant, inc)
    claim.check(plant, inc)
    methods = METHODS if method == "auto" else (method_of(method),)
    if not inc.well_posedness().holds:
        return EllipsoidCertificate(plant, inc, claim, methods[0].name, {}, "not well posed: no search was made")
    rest = rest_of(loop)
    if rest is None:
        return EllipsoidCertificate(plant, inc, claim, methods[0].name, {}, NO_REST)
    setting = Setting(loop, claim, rest)
    repelled = _repelled(loop, rest)
    if repelled and (len(methods) > 1 or not methods[0].applies(setting)):
        return EllipsoidCertificate(plant, inc, claim, methods[0].name, {}, repelled)
    found = [_skipped(way, setting) or _with(way, setting) if len(methods) > 1 else _with(way, setting) for way in methods]
    best = max(found, key=_strength)
    return replace(best, note="; ".join(f"{one.method}: {_outcome(one)}" for one in found))


def _repelled(loop: ClosedLoop, rest: Rest) -> str:
    """Why the equilibrium attracts no neighbourhood, by the linearization there; empty where that tells nothing."""
    found = linearization(loop.plant, loop.inc, rest.center)
    if found is None:
        return ""
    trouble = too_fast(loop.plant, found[0], 1.0 if loop.plant.discrete else 0.0)
    return f"the equilibrium {point(found[1])} does not attract: its linearization has {trouble}" if trouble else ""


def _skipped(way: LocalMethod, setting: Setting) -> EllipsoidCertificate | None:
    """A certificate that says why "auto" leaves a method out, or None."""
    plant, inc = setting.loop.plant, setting.loop.inc
    why = ""
    if way.name == "dead zone" and plant.n + inc.q > MOST_ROWS:
        why = f"n + q = {plant.n + inc.q} is more than {MOST_ROWS}, which takes minutes; ask for it by name"
    if way.name == "local sectors" and not inc.W.any() and np.all(lines(setting).bend != 0):
        why = "all units are bent and none reads another, so the dead zone method says the same"
    return EllipsoidCertificate(plant, inc, setting.claim, way.name, {}, why) if why else None


def _with(way: LocalMethod, setting: Setting) -> EllipsoidCertificate:
    """Return what one method finds."""
    plant, inc, claim = setting.loop.plant, setting.loop.inc, setting.claim
    refusal = way.applies(setting)
    values = refusal or way.search(setting)
    if isinstance(values, str):
        return EllipsoidCertificate(plant, inc, claim, way.name, {}, values)
    return EllipsoidCertificate(plant, inc, claim, way.name, values | posed_values(inc))


def _strength(found: EllipsoidCertificate) -> tuple[bool, float]:
    holds = found.holds()
    return holds, found.claim.merit(found.values["P"]) if holds else 0.0


def _outcome(found: EllipsoidCertificate) -> str:
    if not found.holds():
        return found.reason
    return f"{'volume' if found.claim.directions is None else 'scale'} {found.bound:.7g}"
