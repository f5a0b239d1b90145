"""What `synthesize_dynamic` returns: a controller with memory, what is proved of it, and what competitors cannot beat."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import final

import numpy as np

from inc_casadi import Plant, Spec
from inc_casadi.bounds import Bound
from inc_casadi.brief import Brief
from inc_casadi.certificate import Certificate, Proof
from inc_casadi.comparison import Comparison
from inc_casadi.comparison.families import ANY, LINEAR
from inc_casadi.comparison.floors import Floor
from inc_casadi.comparison.row import CERTIFIED as LIMITS_CERTIFIED
from inc_casadi.comparison.row import EXACT, SIMULATED, UPPER, Cost, Finding, Row
from inc_casadi.dynamic import DynamicCertificate, DynamicINC
from inc_casadi.estimate import Estimate

from .comparison import THIS
from .gate import Verdict
from .result import CERTIFIED, refuse_uncertified, status_of


@final
@dataclass(frozen=True, eq=False)
class DynamicAttempt(Brief):
    """One candidate: how it was made, the controller, the gate's verdict, the simulation, the seconds it took.

    training: (seconds, cost) as the training went, empty when nothing was trained; of: the attempt that it was trained from;
    timed: whether a time limit cut it short, so that another machine may find more.
    """

    name: str
    dynamic: DynamicINC | None
    verdict: Verdict | None
    estimate: Estimate | None
    seconds: float
    note: str = ""
    training: tuple[tuple[float, float], ...] = ()
    of: str = ""
    timed: bool = False

    @property
    def certified(self) -> bool:
        """Whether the gate accepted the candidate."""
        return self.verdict is not None and self.verdict.accepted

    @property
    def cost(self) -> float:
        """Its certified cost, infinite without."""
        return np.inf if self.verdict is None else self.verdict.cost


@final
@dataclass(frozen=True, eq=False)
class DynamicResult(Brief):
    """The outcome of `synthesize_dynamic`; `print(result)` shows the table of an engineer.

    dynamic: the controller, the best candidate when none passed, None when there was none; certificate: the one that holds,
    or None; proof: how it was settled rigorously; estimate: the simulated cost; bounds: lower bounds by name; history: every
    attempt; notes: reasons and interruptions; seconds: wall time by phase; chosen: the attempt that was taken; ended: why
    the search ended, in words.
    """

    plant: Plant
    spec: Spec
    dynamic: DynamicINC | None
    certificate: Certificate | None
    proof: Proof | None
    estimate: Estimate | None
    bounds: Mapping[str, Bound]
    history: tuple[DynamicAttempt, ...]
    notes: tuple[str, ...]
    seconds: Mapping[str, float]
    chosen: DynamicAttempt | None = field(default=None, repr=False)
    ended: str = ""

    @property
    def status(self) -> str:
        """"certified" when a certificate holds, else "simulation evidence" when all simulated motions keep the limits and
        come to rest, else "failed"."""
        return status_of(self.certificate, self.estimate)

    @property
    def cost(self) -> float:
        """The certified expected cost; infinite when nothing is certified."""
        return self.certificate.bound if self.status == CERTIFIED else np.inf  # type: ignore[union-attr]

    @property
    def worst(self) -> float:
        """The certified largest cost over the initial set, NaN when no certificate states one."""
        return float(getattr(self.certificate, "worst_bound", np.nan)) if self.status == CERTIFIED else np.nan

    def require(self) -> DynamicResult:
        """Return the result itself when it is certified; raises NotCertifiedError with the reasons otherwise."""
        refuse_uncertified(self)
        return self

    def comparison(self) -> Comparison:
        """Return the controller beside its lower bounds: separations, distance to the best possible, contradictions."""
        floors = tuple(Floor(LINEAR if name.startswith("linear") else ANY, bound, "", bound.seconds)
                       for name, bound in self.bounds.items())
        proofs = {} if self.proof is None else {THIS: self.proof}
        rows = () if self.dynamic is None else (_row(self),)
        return Comparison(self.plant, self.spec, rows, floors, proofs)

    def __str__(self) -> str:
        from .dynamic_report import table
        return table(self)

    def report(self) -> str:
        """Return the table that `print` shows."""
        return str(self)

    def save(self, path: str | Path) -> None:
        """Write plant, specification, controller and certificate to a JSON file; `load_dynamic_result` reads it."""
        from .dynamic_storage import save_dynamic_result
        save_dynamic_result(self, path)


def is_exact(certificate: Certificate | None) -> bool:
    """Whether a certificate's bound is the expected cost itself, up to rounding.

    >>> is_exact(None)
    False
    """
    if not isinstance(certificate, DynamicCertificate):
        return False
    return certificate.inner.gap == 0 and bool(np.isfinite(certificate.inner.expected))


def _row(result: DynamicResult) -> Row:
    dynamic, certificate, run = result.dynamic, result.certificate, result.estimate
    assert dynamic is not None
    kind = f"dynamic, order {dynamic.order}, {dynamic.q} unit{'' if dynamic.q == 1 else 's'}"
    row = Row(THIS, dynamic, kind, ANY if dynamic.q else LINEAR)
    if certificate is not None:
        cost = Cost(certificate.bound, EXACT if is_exact(certificate) else UPPER, 0.0, certificate, certificate.sentence)
        return replace(row, limits=Finding(LIMITS_CERTIFIED, "accepted by the gate"), worst=result.worst, cost=cost)
    return row if run is None else replace(row, cost=Cost(run.mean, SIMULATED, run.standard_error))
