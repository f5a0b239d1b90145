"""The regional certificate of a controller with memory: from x_0 in a set and xi_0 fixed, or of its folded loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..arrays import Array
from ..certificate import Certificate, Proof
from ..claims.regional import Regional
from ..errors import InvalidInputError
from ..figures import at_most
from ..pieces.conewise import conewise_law
from ..pieces.walk import Budget
from ..plant import Plant, as_plant
from ..regional_certificate import RegionalCertificate, certify_region
from ..sets import Box
from .controller import DynamicINC
from .extended import extended
from .flat import FlatCertificate, certify_flat, extended_claim
from .fold import built_in, folded, visited


@dataclass(frozen=True, eq=False)
class DynamicCertificate(Certificate):
    """From every x_0 of a set, xi_0 as it is: inputs within limits, convergence, the exact discounted cost.

    Without a box for xi it holds when the walk from the flat set X_0 x {xi_0} ends well (`flat.FlatCertificate`), in n
    dimensions. With a box it holds when the regional certificate of the folded loop holds, in n + l dimensions: by the
    theorem in `folded` the two claims are the same. Either loop is formed anew from plant, controller, claim and memory,
    whatever `evidence` was found for.

    Parameters
    ----------
    plant : in discrete time; dynamic : the controller; claim : Regional about the plant
    memory : Box that all of xi stays in, certified too, or None
    evidence : a regional certificate, for its terminal set, note and budget alone
    """

    plant: Plant
    dynamic: DynamicINC
    claim: Regional
    memory: Box | None
    evidence: RegionalCertificate

    def __post_init__(self) -> None:
        object.__setattr__(self, "plant", as_plant(self.plant))
        if not isinstance(self.evidence, RegionalCertificate):
            raise InvalidInputError(f"evidence must be a RegionalCertificate, not {type(self.evidence).__name__}")
        self.inner  # noqa: B018  # forming it is the check that all fits

    @cached_property
    def inner(self) -> RegionalCertificate | FlatCertificate:
        """The certificate of the folded loop, or that from the flat set."""
        found = self.evidence
        if self.memory is None:
            return FlatCertificate(self.plant, self.dynamic, self.claim, found.P, found.level, found.budget, found.note)
        problem = folded(self.plant, self.dynamic, self.claim, self.memory)
        return replace(found, plant=problem.plant, inc=problem.inc, claim=problem.claim)

    @property
    def bound(self) -> float:
        """The expected discounted cost rounded up by 1e-9 of its size; infinite when unknown.

        Where the expectation is not worked out (n > 8, with a box n + l > 8) it is the largest cost.
        """
        return self.inner.bound

    @property
    def worst_bound(self) -> float:
        """The largest discounted cost over the initial set, likewise."""
        return self.inner.worst_bound

    @property
    def worst_start(self) -> Array:
        """The x_0 (n,) where the largest cost is attained; NaN when unknown."""
        return self.inner.worst[1][: self.plant.n]

    @property
    def reason(self) -> str:
        """Why the certificate does not hold; empty when it does."""
        reason = self.inner.reason
        of_xi = self.memory is not None and reason.startswith("an input exceeds")
        return f"{reason} (of u, or xi of its box)" if of_xi else reason

    @property
    def sentence(self) -> str:
        """What is proved, in one sentence, or that nothing is."""
        if self.reason:
            return f"Not certified: {self.reason}."
        kept = "" if self.claim.inputs is None else "every input stays within its limits" + (
            " (built in), " if built_in(self.dynamic, self.claim) else ", ")
        mean = f"at most {at_most(self.bound)} in expectation and " if np.isfinite(self.bound) else ""
        start, box = _listed(self.dynamic.xi_0), "" if self.memory is None else ", xi stays in its box"
        return (f"From every starting point of the initial set and the controller's state xi_0 = {start} {kept}the "
                f"motion converges{box}, and the discounted cost (discount "
                f"{self.claim.discount:g}) is {mean}at most {at_most(self.worst_bound)} from any point.")

    def margins(self) -> Mapping[str, float]:
        """Return the margins of the inner certificate; "inputs" is that of u, where it is watched, and of xi's box."""
        return self.inner.margins()

    def prove(self, seconds: float | None = None) -> Proof:
        """Settle it rigorously: either loop is formed without rounding but of products with -2, and `inner` proved.

        seconds: for all of it, without limit when left out; what is open then is not proved.
        """
        return self.inner.prove(seconds)


def certify_dynamic(plant: Any, dynamic: DynamicINC, claim: Regional, memory: Box | None = None,
                    budget: Budget | None = None) -> DynamicCertificate:
    """Return the best certificate found that a controller with memory does what `claim` says; it may not hold, and says why.

    For piecewise-affine controllers. All other claims are `certify(*extended(plant, dynamic), claim)` with a claim about
    the extended plant: they hold for the motions from (x_0, xi_0) among others.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    dynamic : DynamicINC
    claim : Regional about the plant
    memory : Box in R^l that xi must stay in, which is certified then, by the folded loop in n + l dimensions. None for the
        walk from the flat set, in n dimensions; where the equilibrium lies on kinks, which that does not know, the folded
        loop is tried with a box from simulation (`visited`)
    budget : how far exact pieces may go

    Raises
    ------
    DimensionError, InvalidInputError : as `folded`; a claim that is not Regional

    Examples
    --------
    >>> from inc_casadi import INC, Box
    >>> from inc_casadi.dynamic import observer
    >>> plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]])  # only the position is measured
    >>> held = observer(plant, [[2.0], [1.0]], INC.saturated([[-0.5, -1.2]], 0.5))
    >>> claim = Regional(Box([-1.0, -0.5], [1.0, 0.5]), Box(-0.5, 0.5), [[1, 0], [0, 1]], [[0.1]], 0.95)
    >>> certificate = certify_dynamic(plant, held, claim)
    >>> certificate.holds(), round(certificate.bound, 3)
    (True, 2.874)
    """
    if not isinstance(claim, Regional):
        raise InvalidInputError(f"claim is {claim!r}, but must be Regional: for others certify(*extended(plant, dynamic), "
                                "claim) takes a claim about the extended plant")
    if memory is None:
        found = _from_flat_set(plant, dynamic, claim, budget)
        if found.evidence.P is not None or not _rests_on_kinks(plant, dynamic):
            return found
        memory = visited(plant, dynamic, claim)
    problem = folded(plant, dynamic, claim, memory)
    evidence = certify_region(problem.plant, problem.inc, problem.claim, budget)
    return DynamicCertificate(plant, dynamic, claim, memory, evidence)


def _from_flat_set(plant: Any, dynamic: DynamicINC, claim: Regional, budget: Budget | None) -> DynamicCertificate:
    found = certify_flat(plant, dynamic, claim, budget)
    evidence = RegionalCertificate(*extended(plant, dynamic), extended_claim(dynamic, claim), found.P, found.level,
                                   found.budget, found.note)
    return DynamicCertificate(plant, dynamic, claim, None, evidence)


def _rests_on_kinks(plant: Any, dynamic: DynamicINC) -> bool:
    law = dynamic.law
    if any(unit.pieces is None for unit in law.activations) or not law.well_posedness().holds:
        return False
    return not isinstance(conewise_law(*extended(plant, dynamic)), str)


def _listed(x: Array) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in x) + "]"
