"""What a linear dynamic controller costs, for certain, and that it keeps the input limits for ever."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, columns
from ..certificate import Certificate, MatrixCertificate, Proof
from ..claims import DiscountedCost
from ..errors import InvalidInputError
from ..figures import at_most
from ..inc import INC
from ..loop import ClosedLoop, close_loop
from ..multipliers import as_multiplier
from ..plant import Plant, as_plant
from ..readings import Rounded
from ..spec import Spec
from ..storage_function import quadratic_about
from .controller import LinearController
from .dynamic_loop import started, static_form
from .input_limits import limit_weight, limits_broken
from .lyapunov import bounding_sum, discounted_sum

_CONTINUOUS = "the cost is a sum over steps, but the plant is continuous (dt = 0): use plant.sampled(dt)"


@dataclass(frozen=True, eq=False)
class LinearCost(Certificate):
    """The certified cost of an admissible linear controller: P for the cost, W for the input limits.

    z = (x, xi), z+ = A_e z, u = G z is the loop (`static_form`). P - beta A_e'P A_e - Q_e - G'RG > 0 and P > 0 prove
    that the discounted cost from (x_0, xi_0) is at most z_0'P z_0, so at most `bound` = tr(P E z_0 z_0') on average.
    W - A_e'W A_e - G'R_w G > 0 bounds the energy of the inputs to come, by which `limits_broken` shows that they stay
    within the limits for ever; it also proves that the loop is stable. Without input limits P is all that is asked.

    Parameters
    ----------
    plant, spec, controller : what is claimed about
    P : (n + l, n + l), None when the loop is not stable in the discounted sense
    W : (n + l, n + l), None when there are no limits or the loop is not stable

    Notes
    -----
    Sufficient; the initial states of a polytope are the hull of its stored vertices. Source: thm:performance, for a
    loop without hidden units.
    """

    plant: Plant
    spec: Spec
    controller: LinearController
    P: Array | None
    W: Array | None

    def __post_init__(self) -> None:
        if not self.plant.discrete:
            raise InvalidInputError(_CONTINUOUS)

    @cached_property
    def loop(self) -> ClosedLoop:
        """The loop in static form."""
        plant, gain = static_form(self.plant, self.controller)
        return close_loop(plant, INC.linear(gain))

    @property
    def bound(self) -> float:
        """An upper bound on the expected cost, rounded up; infinite without P."""
        return np.inf if self.P is None else self._cost_part(self.P).bound

    def storage(self, x: ArrayLike) -> float | Array:
        """Return V(x) = z'P z, z = (x, xi_0), at a state (n,) or columns (n, N): the cost from there is at most that.

        Raises InvalidInputError without P.
        """
        if self.P is None:
            raise InvalidInputError(f"there is no storage function: {self.reason}")
        points, single = columns("x", x, self.plant.n)
        xi = np.repeat(self.controller.xi_0[:, None], points.shape[1], axis=1)
        values = quadratic_about(np.concatenate([points, xi]), self.P, np.zeros(len(self.P)))
        return float(np.asarray(values)[0]) if single else values

    @property
    def cost(self) -> float:
        """The expected cost itself, up to rounding; infinite when it does not converge."""
        P = discounted_sum(self.loop.F, _stage(self.loop, self.spec.Q, self.spec.R), self.spec.discount)
        S0 = started(self.spec.initial, self.controller).second_moment
        return np.inf if P is None else float(np.sum(P * S0))

    @property
    def worst(self) -> float | None:
        """An upper bound on the cost from the worst vertex; None when the vertices cannot be listed."""
        try:
            z = started(self.spec.initial, self.controller).vertices
        except InvalidInputError:
            return None
        if self.P is None:
            return np.inf
        forms = np.ones((1, len(z))) @ ((self.P @ Rounded.lift(z)) * z)
        return float(np.max(forms.value + forms.error))

    @property
    def admissible(self) -> bool:
        """Whether it is proved that the input limits are kept for ever, from every initial state."""
        return not self._limits_reason()

    @property
    def reason(self) -> str:
        """Why the certificate does not hold, or an empty string when it does."""
        return self._cost_reason() or self._limits_reason()

    @property
    def sentence(self) -> str:
        """What is proved, in one sentence, or that nothing is."""
        reason = self.reason
        if reason:
            return f"Not certified: {reason}."
        order = self.controller.order
        kept = "" if self.spec.inputs is None else "keeps the input limits from every initial state and "
        worst = self.worst
        most = "" if worst is None else f", and at most {at_most(worst)} from the worst"
        named = f"linear controller of order {order}" if order else "static linear controller"
        return f"This {named} {kept}costs at most {at_most(self.bound)} on average over the initial states{most}."

    def margins(self) -> dict[str, float]:
        """Return the margins of the inequalities in P and W, as `MatrixCertificate.margins` measures them."""
        return {f"{part}: {name}": value for part, certificate in self._parts.items()
                for name, value in certificate.margins().items()}

    def prove(self) -> Proof:
        """Settle both inequalities and the limits, in floats with every rounding bounded or in exact arithmetic."""
        begun = perf_counter()
        proofs = [part.prove() for part in self._parts.values()]
        reason = next((proof.reason for proof in proofs if not proof), "") or self.reason
        method = " and ".join(dict.fromkeys(proof.method for proof in proofs)) or "none"
        return Proof(not reason, method, perf_counter() - begun, reason)

    @cached_property
    def _parts(self) -> dict[str, MatrixCertificate]:
        parts = {} if self.P is None else {"cost": self._cost_part(self.P)}
        return parts if self.W is None or self._weight is None else {**parts, "limits": self._energy_part(self.W)}

    @cached_property
    def _weight(self) -> Array | None:
        return None if self.spec.inputs is None else limit_weight(self.spec.inputs)

    def _cost_part(self, P: Array) -> MatrixCertificate:
        """P as a bound on the discounted cost."""
        return self._certificate(P, self.spec.Q, self.spec.R, self.spec.discount)

    def _energy_part(self, W: Array) -> MatrixCertificate:
        """W as a bound on the energy of the inputs to come."""
        assert self._weight is not None
        return self._certificate(W, 0 * self.spec.Q, self._weight, 1.0)

    def _certificate(self, P: Array, Q: Array, R: Array, discount: float) -> MatrixCertificate:
        size, initial = self.loop.plant, started(self.spec.initial, self.controller)
        claim = DiscountedCost(_padded(Q, size.n), _padded(R, size.m), discount, initial)
        return MatrixCertificate(self.loop.plant, self.loop.inc, claim, as_multiplier("sector"),
                                 {"P": P, "Lambda": np.zeros(0)})

    def _cost_reason(self) -> str:
        if self.P is None:
            radius = np.sqrt(self.spec.discount) * np.max(np.abs(np.linalg.eigvals(self.loop.F)))
            return (f"the cost is infinite, or the sum does not settle: the loop has the spectral radius {radius:.9g} "
                    "with the discount in it, and one below 1 is needed")
        return self._cost_part(self.P).reason

    def _limits_reason(self) -> str:
        inputs = self.spec.inputs
        if inputs is None:
            return ""
        if self._weight is None:
            return "u = 0, where a stable linear loop ends, is not well inside the input limits"
        if self.W is None:
            return (f"the loop is not stable, with spectral radius {np.max(np.abs(np.linalg.eigvals(self.loop.F))):.9g}, so "
                    "it is not proved that its inputs stay within the limits")
        return self._energy_part(self.W).reason or limits_broken(
            self.loop, inputs, self.spec.initial, self.controller.xi_0, self.W)


def linear_cost(plant: Any, spec: Spec, controller: LinearController) -> LinearCost:
    """Return what a linear dynamic controller costs, with the numbers that prove it, or with the reason against it.

    P = sum_k beta^k (A_e^k)'(Q_e + G'RG) A_e^k, raised by the least share from 1e-13 on that rounding allows to prove.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    spec : Spec
    controller : LinearController that fits the plant

    Raises
    ------
    InvalidInputError : a continuous plant
    DimensionError : spec or controller do not fit the plant

    Examples
    --------
    >>> from inc_casadi import Box, Plant, Spec
    >>> spec = Spec(Q=1.0, R=0.0, discount=0.5, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> found = linear_cost(Plant(1.5, 1.0), spec, LinearController.static([[-1.0]]))
    >>> round(found.bound, 9), found.admissible, bool(found.prove())  # 1 / (3 (1 - beta / 4)), thm:lsof_sep
    (0.380952381, True, True)
    >>> print(linear_cost(Plant(1.5, 1.0), spec, LinearController.static([[-1.2]])).reason)
    at k = 0 an input exceeds a limit by 20 % of it: facet 0 of the input limits
    """
    plant = as_plant(plant)
    spec.check(plant)
    if not plant.discrete:
        raise InvalidInputError(_CONTINUOUS)
    bare = LinearCost(plant, spec, controller, None, None)
    loop, weight = bare.loop, bare._weight
    P = bounding_sum(loop.F, _stage(loop, spec.Q, spec.R), spec.discount, lambda P: bare._cost_part(P).surely())
    W = None if weight is None else bounding_sum(
        loop.F, _stage(loop, 0 * spec.Q, weight), 1.0, lambda W: bare._energy_part(W).surely())
    return replace(bare, P=P, W=W)


def _stage(loop: ClosedLoop, Q: Array, R: Array) -> Array:
    G = loop.G[: len(R)]
    return _padded(Q, loop.plant.n) + G.T @ R @ G


def _padded(weight: Array, size: int) -> Array:
    padded = np.zeros((size, size))
    padded[: len(weight), : len(weight)] = weight
    return padded
