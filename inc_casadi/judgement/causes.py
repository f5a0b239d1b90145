"""Why a law was refused, in one word of a fixed list: what a search chooses its next attempt by."""

from __future__ import annotations

from enum import Enum

from ..ellipsoidal_region import EllipsoidalRegion
from ..lmi_local_snug import LATE, NO_COST, NOT_STABLE, REACHES
from ..regional_certificate import RegionalCertificate


class Cause(Enum):
    """A reason for a refusal; the value says it in words.

    It steers the search and proves nothing: a wrong one costs an attempt.
    """

    ILL_POSED = "not well posed"
    UNSTABLE = "does not stabilize around its equilibrium"
    LOST = "loses motions, or they do not settle"
    PIECES = "the proof takes too many pieces"
    TIME = "the proof takes too long"
    LIMITS = "exceeds an input limit"
    KINK = "rests on kinks where nothing is certified"
    SMOOTH = "not piecewise affine, so not to be followed exactly"
    REACH = "no ellipsoid was found that contains the initial set and bounds the cost"
    UNCERTIFIED = "no matrix inequality was found"
    HOPELESS = "this way of proof does not apply to the problem"


def cause_of(certificate: RegionalCertificate) -> Cause:
    """Return why a regional certificate does not hold, from its walk or in its own words.

    >>> from inc_casadi import INC, Box, Plant, Regional, certify
    >>> claim = Regional(Box([-3.0], [3.0]), Box([-1.0], [1.0]), [[1.0]], [[1.0]], 0.9)
    >>> cause_of(certify(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0), claim)).value
    'loses motions, or they do not settle'
    """
    if not certificate.inc.well_posedness().holds:
        return Cause.ILL_POSED
    if any(unit.pieces is None for unit in certificate.inc.without_idle_units().activations):
        return Cause.SMOOTH
    if certificate.walk is not None and not certificate.walk.complete:
        return _unfinished(certificate.walk.ended)
    return _at_rest(certificate.reason)


def _at_rest(reason: str) -> Cause:
    """The cause where no motion was lost: something about the equilibrium, the set around it, or the inputs."""
    if "kink" in reason:
        return Cause.KINK
    if "input limit" in reason or "exceeds its limit" in reason:
        return Cause.LIMITS
    return Cause.UNSTABLE if "does not stabilize" in reason or "no equilibrium" in reason else Cause.HOPELESS


def _unfinished(ended: str) -> Cause:
    if ended.startswith("more than"):
        return Cause.PIECES
    return Cause.TIME if "time limit" in ended else Cause.LOST


def cause_of_ellipsoid(certificate: EllipsoidalRegion) -> Cause:
    """Return why an ellipsoidal region does not hold, in its own words.

    >>> from inc_casadi import INC, Box, Plant, Spec
    >>> from inc_casadi.ellipsoidal_region import certify_ellipsoidal
    >>> wide = Spec([[1.0]], [[1.0]], 0.9, Box([-3.0], [3.0]), Box([-1.0], [1.0]))
    >>> cause_of_ellipsoid(certify_ellipsoidal(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0), wide)).name
    'REACH'
    """
    reason = certificate.reason
    if not certificate.inc.well_posedness().holds:
        return Cause.ILL_POSED
    if LATE in reason:
        return Cause.TIME
    if NOT_STABLE in reason:
        return Cause.UNSTABLE
    return Cause.REACH if REACHES in reason or NO_COST in reason else Cause.HOPELESS
