"""The certificate that a law does what a specification asks, by an ellipsoid that contains all initial states."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from math import inf, isfinite, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array, number
from .certificate import Certificate, Proof
from .certificate_values import posed_values
from .claims.attraction import Attraction
from .ellipsoid_certificate import NO_REST, EllipsoidCertificate
from .errors import InvalidInputError
from .figures import at_most
from .inc import INC
from .local.base import Setting
from .local.containment import Hull, hull_of, largest, margin, norm_above
from .local.rest import Rest, rest_of
from .loop import close_loop
from .plant import Plant, as_plant
from .sets import Ellipsoid
from .spec import Spec

METHOD = "local sectors"
ROUNDING = 1e-9  # share by which a cost computed in floats is rounded up


@dataclass(frozen=True, eq=False)
class EllipsoidalRegion(Certificate):
    """From every initial state of a specification: inputs within limits, convergence, and a bound on the discounted cost.

    `evidence` proves an `Attraction`: of every motion from E = {e'P e <= 1}, e = x - x*, that it stays there, keeps the
    limits, converges to x*, and that sum_k discount^k (e_k'Q e_k + v_k'R v_k) <= e_0'P_cost e_0, v = u - u*. Here E is
    shown to contain all initial states (`local.containment`), and that cost, counted from rest, becomes the one asked for:
    with |.| the norm of sequences and random variables whose square is E sum_k discount^k (x_k'Q x_k + u_k'R u_k),

        |(x, u)| <= |(e, v)| + |(x*, u*)|,    |(x*, u*)|^2 = (x*'Q x* + u*'R u*) / (1 - discount),

    so that the expected cost is at most (sqrt(tr(P_cost E[e_0 e_0'])) + |(x*, u*)|)^2. Where the law keeps the origin the
    second part is zero; without discount it must be. Sufficient, not necessary.

    Parameters
    ----------
    spec : what is asked; its initial states bounded
    evidence : of the ellipsoid; its claim is formed anew from the specification, whatever it was found for
    multiplier : where the initial states fill an ellipsoid, what shows that E contains it; not used otherwise

    >>> from inc_casadi import Box, Tanh
    >>> law = INC([[0.0]], [[1.6]], [[-1.0]], [[0.0]], activation=Tanh())   # |u| < 1 holds x+ = 1.5 x + u for |x| < 2
    >>> found = certify_ellipsoidal(Plant(1.5, 1.0), law, Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-1, 1)))
    >>> found.holds(), found.prove().succeeded, round(found.bound, 1)
    (True, True, 0.5)
    """

    spec: Spec
    evidence: EllipsoidCertificate
    multiplier: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.spec, Spec) or not isinstance(self.evidence, EllipsoidCertificate):
            raise InvalidInputError("an ellipsoidal region needs a Spec and an EllipsoidCertificate, not "
                                    f"{type(self.spec).__name__} and {type(self.evidence).__name__}")
        object.__setattr__(self, "multiplier", number("multiplier", self.multiplier, 0.0))
        self.inner  # noqa: B018  # forming it is the check that all fits

    @cached_property
    def inner(self) -> EllipsoidCertificate:
        """The certificate of the ellipsoid, with the limits and the cost of the specification."""
        return replace(self.evidence, claim=_claim(self.spec.check(self.evidence.plant)))

    @property
    def plant(self) -> Plant:
        """The plant."""
        return self.evidence.plant

    @property
    def inc(self) -> INC:
        """The controller."""
        return self.evidence.inc

    @property
    def ellipsoid(self) -> Ellipsoid:
        """The ellipsoid, its center rounded to floats; InvalidInputError where there is none."""
        return self.inner.ellipsoid

    def storage(self, x: ArrayLike) -> float | Array:
        """Return the storage function of `inner`, whose level set V <= 1 contains all initial states."""
        return self.inner.storage(x)

    @property
    def storage_level(self) -> float:
        """1: the ellipsoid itself."""
        return self.inner.storage_level

    @property
    def bound(self) -> float:
        """The expected discounted cost at most, rounded up; infinite without a certificate's numbers."""
        if self._rest is None or not self.inner.values:
            return inf
        P, initial, middle = self.inner.values["P_cost"], self.spec.initial, self._rest.center
        offset = initial.mean - middle
        moment = initial.covariance + np.outer(offset, offset)
        sizes = np.abs(initial.covariance) + np.outer(*2 * [np.abs(initial.mean) + np.abs(middle)])
        terms = float(np.sum(P * moment)) + 1e-14 * len(P) ** 2 * float(np.sum(np.abs(P) * sizes))
        return self._with_rest(max(terms, 0.0))

    @property
    def worst_bound(self) -> float:
        """The largest discounted cost from any initial state at most, rounded up; infinite without numbers."""
        if self._rest is None or not self.inner.values or isinstance(self._hull, str):
            return inf
        P, middle = self.inner.values["P_cost"], self._rest.center
        highest = largest(self._hull, P, middle)[0]
        if not isinstance(self._hull, Ellipsoid):  # whose largest form is too large by more than rounding already
            sizes = np.abs(self._hull) + np.abs(middle)[:, None]
            highest += 1e-14 * len(P) ** 2 * float(np.max(np.sum(sizes * (np.abs(P) @ sizes), axis=0)))
        return self._with_rest(max(highest, 0.0))

    def margins(self) -> dict[str, float]:
        """Return the margins of `inner`, and "contained": that of the initial states, at least 0 when all are inside."""
        found = dict(self.inner.margins())
        if self.inner.values and self._rest is not None and not isinstance(self._hull, str):
            found["contained"] = margin(self._hull, self.inner.values["P"], self._rest, self.multiplier)
        return found

    @property
    def reason(self) -> str:
        """Why the certificate does not hold; empty when it does."""
        return self.inner.reason or self._around()

    @property
    def sentence(self) -> str:
        """What is proved, in one sentence, or that nothing is."""
        reason = self.reason
        if reason:
            return f"Not certified: {reason}."
        rest = np.array2string(np.round(self.ellipsoid.center, 9) + 0.0, precision=6)
        limits = "" if self.spec.inputs is None else "every input stays within its limits, "
        return (f"From every initial state {limits}the motion stays in an ellipsoid that contains them all and converges to "
                f"x* = {rest}, and the discounted cost (discount {self.spec.discount:g}) is at most {at_most(self.bound)} "
                f"in expectation and at most {at_most(self.worst_bound)} from any of them.")

    def prove(self, method: str = "auto") -> Proof:
        """Settle it rigorously: the ellipsoid as `EllipsoidCertificate.prove` does, the initial states with rounding bounded
        or in Fractions."""
        start = time.perf_counter()
        proof = self.inner.prove(method)
        reason = proof.reason or self._around()
        return Proof(not reason, proof.method, time.perf_counter() - start, reason)

    def _around(self) -> str:
        """What stands in the way apart from the ellipsoid itself."""
        if isinstance(self._hull, str):
            return self._hull
        if not self._rest_size < inf:
            return ("the law does not rest at the origin exactly, and without discount the least offset costs without end "
                    "(b = 0 and d = 0 would do, or a discount below 1)")
        assert self._rest is not None
        P = self.inner.values["P"]
        if margin(self._hull, P, self._rest, self.multiplier) >= 0:
            return ""
        scale = largest(self._hull, P, self._rest.center)[0] ** -0.5
        return f"the ellipsoid contains the initial set scaled by {scale:.6g} about the equilibrium, not all of it"

    def _with_rest(self, square: float) -> float:
        """Return (sqrt(square) + the rest's share)^2 rounded up; the share is P_cost's of unknown digits of x*, and B."""
        assert self._rest is not None
        share = norm_above(self.inner.values["P_cost"], self._half) + self._rest_size
        return (sqrt(square) + share) ** 2 * (1 + ROUNDING) if share else square * (1 + 1e-12)

    @cached_property
    def _half(self) -> np.ndarray:
        """Half widths of the bounds on x* about the floats nearest to their middle, in Fractions."""
        assert self._rest is not None
        ends = zip(self._rest.x_low, self._rest.x_high, map(Fraction, self._rest.center), strict=True)
        return np.array([max(abs(low - c), abs(high - c)) for low, high, c in ends], dtype=object)

    @cached_property
    def _rest_size(self) -> float:
        """|(x*, u*)|, rounded up: 0 for the origin, infinite without discount elsewhere."""
        assert self._rest is not None
        parts = [(self._rest.x_low, self._rest.x_high, self.spec.Q), (self._rest.u_low, self._rest.u_high, self.spec.R)]
        norms = [norm_above(weight, np.maximum(np.abs(low), np.abs(high))) for low, high, weight in parts]
        if not any(norms):
            return 0.0
        return inf if self.spec.discount == 1 else (sum(norms) / sqrt(1 - self.spec.discount)) * (1 + ROUNDING)

    @cached_property
    def _rest(self) -> Rest | None:
        return rest_of(close_loop(self.plant, self.inc))

    @cached_property
    def _hull(self) -> Hull | str:
        return hull_of(self.spec.initial)


def _claim(spec: Spec) -> Attraction:
    return Attraction(inputs=spec.inputs, Q=spec.Q, R=spec.R, discount=spec.discount)


def certify_ellipsoidal(plant: Any, inc: INC, spec: Spec, seconds: float = inf) -> EllipsoidalRegion:
    """Return the certificate of a low cost bound found that holds for all initial states; it may not hold, and says why.

    For units of any kind, bounded inputs on unstable plants too, where no certificate can be global. Unlike exact pieces it
    does not follow motions, so neither long motions nor many pieces hinder it; its bounds are not exact.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    inc : the controller
    spec : what is asked, with bounded initial states
    seconds : after which the search ends with the best found by then

    Raises
    ------
    DimensionError, InvalidInputError : arguments that do not fit, or a continuous plant

    Examples
    --------
    >>> from inc_casadi import Box, Tanh
    >>> law = INC([[0.0]], [[1.6]], [[-1.0]], [[0.0]], activation=Tanh())
    >>> far = certify_ellipsoidal(Plant(1.5, 1.0), law, Spec(1.0, 0.0, 0.9, Box(-4, 4), Box(-1, 1)))
    >>> far.reason.startswith("the largest ellipsoid found contains the initial set scaled by 0.4")
    True
    """
    plant = as_plant(plant)
    if not isinstance(inc, INC):
        raise InvalidInputError(f"inc must be an INC, not {type(inc).__name__}")
    if not isinstance(spec, Spec):
        raise InvalidInputError(f"spec must be a Spec, not {type(spec).__name__}")
    until = time.monotonic() + seconds if isfinite(seconds) else inf
    loop, claim, hull = close_loop(plant, inc), _claim(spec.check(plant)), hull_of(spec.initial)
    claim.check(plant, inc)
    if isinstance(hull, str):
        return _without(plant, inc, spec, hull)
    if not inc.well_posedness().holds:
        return _without(plant, inc, spec, "not well posed: no search was made")
    rest = rest_of(loop)
    if rest is None:
        return _without(plant, inc, spec, NO_REST)
    return _searched(Setting(loop, claim, rest), spec, hull, until)


def _searched(setting: Setting, spec: Spec, hull: Hull, until: float) -> EllipsoidalRegion:
    from .lmi_local_snug import snug
    from .local.methods import method_of

    plant, inc = setting.loop.plant, setting.loop.inc
    offset = spec.initial.mean - setting.rest.center
    refusal = method_of(METHOD).applies(setting)
    values = refusal or snug(setting, hull, spec.initial.covariance + np.outer(offset, offset), until)
    if isinstance(values, str):
        return _without(plant, inc, spec, values)
    evidence = EllipsoidCertificate(plant, inc, setting.claim, METHOD, values | posed_values(inc))
    return EllipsoidalRegion(spec, evidence, largest(hull, values["P"], setting.rest.center)[1])


def _without(plant: Plant, inc: INC, spec: Spec, why: str) -> EllipsoidalRegion:
    return EllipsoidalRegion(spec, EllipsoidCertificate(plant, inc, _claim(spec), METHOD, {}, why))
