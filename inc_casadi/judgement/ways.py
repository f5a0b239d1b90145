"""The ways of proof: a linear loop that no motion leaves, exact pieces, an inequality for all states, an ellipsoid.

Each answers a question, given what was found before; None where it is not worth asking.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from ..certificate import MatrixCertificate
from ..certify import certify
from ..claims import DiscountedCost, Invariance, Regional, Stability
from ..ellipsoidal_region import certify_ellipsoidal
from ..errors import INCError
from ..multipliers import LADDER
from ..output_range import output_range
from ..regional_certificate import RegionalCertificate, certify_region
from ..sets import Box, Polytope, Uniform
from .causes import Cause, cause_of, cause_of_ellipsoid
from .clipped import by_clipping
from .findings import BUILT_IN, Finding, Passed, Question, Refused
from .unswitched import by_lyapunov

Way = Callable[[Question, Sequence[Finding], float], Finding | None]
PIECES, INEQUALITY, ELLIPSOID = "exact pieces", "global LMI", "ellipsoid"
SUBDIVISION = "exact subdivision of the initial set"
EXACT = 1e-9  # share of the cost up to which a gap counts as rounding
SHARE = 0.2  # of the budget's seconds that an ellipsoid may take at least, however long the pieces took
NO_LIMITS = "there are no input limits"


def by_pieces(asked: Question, before: Sequence[Finding], until: float) -> Finding:
    """Follow all motions from a polytope (`Regional`): limits, convergence, and the exact cost at once."""
    spec = asked.spec
    if not isinstance(spec.initial, Uniform) or not isinstance(spec.initial.support, Box | Polytope):
        return Refused(PIECES, "the initial distribution is not uniform over a polytope", Cause.HOPELESS)
    claim = Regional(spec.initial, spec.inputs, spec.Q, spec.R, spec.discount)
    try:
        certificate = certify_region(asked.plant, asked.inc, claim, asked.budget)
        reason = certificate.reason
    except INCError as error:  # a box of many dimensions has too many simplices
        return Refused(PIECES, str(error), Cause.HOPELESS)
    if reason:
        return Refused(PIECES, reason, cause_of(certificate), certificate)
    return _followed(asked, certificate)


def _followed(asked: Question, certificate: RegionalCertificate) -> Passed:
    assert certificate.walk is not None
    known = bool(np.isfinite(certificate.expected))
    costs = "expected and worst cost" if known else "worst cost, which bounds the expected one"
    proofs = [f"converges from every initial state: exact subdivision, {len(certificate.walk.arrived)} pieces",
              f"{costs}: exact subdivision"]
    if asked.spec.inputs is not None:
        proofs.insert(0, "input limits kept on every motion: exact subdivision")
    return Passed(PIECES, certificate, SUBDIVISION if known else f"the largest cost, by {SUBDIVISION}", SUBDIVISION,
                  SUBDIVISION, certificate.worst_bound, known and certificate.gap <= EXACT * certificate.bound, not known,
                  proofs=tuple(proofs))


def by_inequality(asked: Question, before: Sequence[Finding], until: float) -> Finding | None:
    """Bound the cost from everywhere (`DiscountedCost`), where the limits are built in or the initial set is invariant.

    What eq:regional_input_check and thm:general_superiority ask for. Invariance takes a certificate of its own, so it is
    left out where one must do alone.
    """
    if any(isinstance(one, Refused) and one.cause is Cause.LIMITS for one in before) and not asked.alone:
        return None
    plant, spec, inc = asked.plant, asked.spec, asked.inc
    bounded = all(np.isfinite(float(end)) for pair in output_range(inc) for end in pair)
    if bounded and plant.discrete and float(np.max(np.abs(np.linalg.eigvals(plant.A)))) >= 1:
        return Refused(INEQUALITY, "the input is bounded, and no bounded input stabilizes this unstable plant globally",
                       Cause.HOPELESS)
    if asked.alone and not asked.built_in:
        return Refused(INEQUALITY, "the input limits are not built into the controller", Cause.HOPELESS)
    try:
        certificate = certify(plant, inc, DiscountedCost(spec.Q, spec.R, spec.discount, spec.initial))
    except INCError as error:
        return Refused(INEQUALITY, str(error), Cause.HOPELESS)
    if not certificate.holds():
        return Refused(INEQUALITY, certificate.reason, Cause.UNCERTIFIED, certificate)
    assert isinstance(certificate, MatrixCertificate)
    return _for_all_states(asked, certificate)


def _for_all_states(asked: Question, certificate: MatrixCertificate) -> Finding:
    limits, grounds, short = _limits_kept(asked)
    settles = _settles(asked)
    if asked.alone and not settles:
        return Refused(INEQUALITY, f"the cost is bounded with the discount {asked.spec.discount:g}, but no inequality shows "
                       "that motions come to rest", Cause.UNCERTIFIED, certificate)
    proofs = ["expected cost: linear matrix inequality, for every initial state"]
    if settles:
        proofs.append(f"stability: linear matrix inequality, {settles}")
    if asked.spec.inputs is not None and limits:
        proofs.insert(0, f"input limits kept everywhere: {limits}")
    words = f"matrix inequality, multiplier {certificate.multiplier.name}"
    return Passed(INEQUALITY, certificate, words, limits, settles, grounds=grounds,
                  proofs=tuple(proofs), short=short)


def _settles(asked: Question) -> str:
    """The sentence of `Stability` where it holds: with a discount a bounded cost does not show that motions settle.

    Any rung of the ladder will do, so the first one that holds is taken; its rate need not be the best.
    """
    for rung in LADDER:
        try:
            stable = certify(asked.plant, asked.inc, Stability(), multiplier=rung)
        except INCError:
            continue
        if stable.holds():
            return stable.sentence
    return ""


def _limits_kept(asked: Question) -> tuple[str, tuple, tuple[str, ...]]:
    """Why the limits are kept, the certificates for it, and why not."""
    spec = asked.spec
    if asked.built_in:
        return NO_LIMITS if spec.inputs is None else BUILT_IN, (), ()
    assert spec.inputs is not None
    if not isinstance(spec.initial.support, Box | Polytope):
        return "", (), ("limits: not built in, and the initial states are not those of a box or polytope",)
    try:
        kept = certify(asked.plant, asked.inc, Invariance(spec.initial.support, spec.inputs), budget=asked.budget)
    except INCError as error:
        return "", (), (f"limits: {error}",)
    if not kept.holds():
        return "", (), (f"limits: not built in, and the initial set is not invariant within them, {kept.reason}",)
    return "the initial set is invariant within them", (kept,), ()


def by_ellipsoid(asked: Question, before: Sequence[Finding], until: float) -> Finding | None:
    """Bound the cost on an ellipsoid that contains the initial set (`EllipsoidalRegion`), where no close bound is known."""
    if any(isinstance(one, Passed) and one.limits and not one.loose or _is_lost(one) for one in before):
        return None
    left = max(until - time.monotonic(), SHARE * asked.budget.seconds)
    try:
        certificate = certify_ellipsoidal(asked.plant, asked.inc, asked.spec, left)
    except INCError as error:
        return Refused(ELLIPSOID, str(error), Cause.HOPELESS)
    if certificate.reason:
        return Refused(ELLIPSOID, certificate.reason, cause_of_ellipsoid(certificate), certificate)
    words = "an ellipsoid of attraction that contains the initial set"
    proofs = [f"converges from every initial state: {words}", "expected and worst cost: at most so much on this ellipsoid"]
    if asked.spec.inputs is not None:
        proofs.insert(0, "input limits kept on every motion: " + (BUILT_IN if asked.built_in else words))
    return Passed(ELLIPSOID, certificate, words, words, words, certificate.worst_bound, proofs=tuple(proofs))


def _is_lost(found: Finding) -> bool:
    """Whether pieces saw a motion diverge, a limit broken or an unstable rest: then there is no such ellipsoid."""
    if not isinstance(found, Refused):
        return False
    return found.cause in (Cause.LIMITS, Cause.UNSTABLE) or found.cause is Cause.LOST and "a motion grew" in found.why


WAYS: tuple[Way, ...] = (by_lyapunov, by_clipping, by_pieces, by_clipping, by_inequality, by_ellipsoid)
