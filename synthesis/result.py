"""What `synthesize` returns: a controller, what is proved of it, and what the competitors cannot beat."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from inc_casadi import INC, Plant, Spec
from inc_casadi.bounds import Bound
from inc_casadi.brief import Brief
from inc_casadi.certificate import Certificate, Proof
from inc_casadi.comparison import Comparison
from inc_casadi.ellipsoidal_region import EllipsoidalRegion
from inc_casadi.errors import NotCertifiedError
from inc_casadi.estimate import Estimate
from inc_casadi.linear import ClippedCost, UnswitchedCost
from inc_casadi.regional_certificate import RegionalCertificate

from .gate import Verdict

if TYPE_CHECKING:
    from .dynamic_result import DynamicResult

CERTIFIED, EVIDENCE, FAILED = "certified", "simulation evidence", "failed"


def status_of(certificate: Certificate | None, run: Estimate | None) -> str:
    """Return "certified" when a certificate holds, else "simulation evidence" when all simulated motions keep the limits and
    come to rest, else "failed"."""
    if certificate is not None and certificate.holds():
        return CERTIFIED
    if run is not None and run.settled and np.isfinite(run.mean) and run.excess <= 1e-9:
        return EVIDENCE
    return FAILED


def refuse_uncertified(result: Result | DynamicResult) -> None:
    """Raise NotCertifiedError with the reasons unless the result is certified."""
    if result.status != CERTIFIED:
        refusals = result.chosen.verdict.refusals if result.chosen and result.chosen.verdict else ()
        raise NotCertifiedError(f"status is {result.status!r}: " + "; ".join((*refusals, *result.notes)))


@dataclass(frozen=True, eq=False)
class Attempt(Brief):
    """One candidate: how it was made, the law, the gate's verdict, the simulation, the seconds it took.

    training: (seconds, cost) as the training went, empty when nothing was trained; inner: the law without its input limits;
    of, why: the attempt that it is a retry of, and the reason; before: the certified bound that retraining with the
    certificate began with, NaN otherwise; timed: whether a time limit cut it short, so that another machine may find more.
    """

    name: str
    inc: INC | None
    verdict: Verdict | None
    estimate: Estimate | None
    seconds: float
    note: str = ""
    training: tuple[tuple[float, float], ...] = ()
    inner: INC | None = None
    of: str = ""
    why: str = ""
    before: float = np.nan
    timed: bool = False

    @property
    def certified(self) -> bool:
        """Whether the gate accepted the candidate."""
        return self.verdict is not None and self.verdict.accepted


@dataclass(frozen=True, eq=False)
class Result(Brief):
    """The outcome of `synthesize`. `print(result)` shows the table of an engineer, `result.plot()` the pictures.

    inc: the controller, the best candidate when none passed, None when there was no candidate; status: "certified",
    "simulation evidence" or "failed", and nothing else is ever said; certificate: the one that holds, or None;
    proof: how it was settled rigorously;
    estimate: the simulated cost; bounds: lower bounds by name; linear: what the linear competitors found cost; history:
    every attempt; notes: reasons and interruptions; seconds: wall time by phase; chosen: the attempt that was taken;
    ended: why the search ended, in words.
    """

    plant: Plant
    spec: Spec
    inc: INC | None
    certificate: Certificate | None
    proof: Proof | None
    estimate: Estimate | None
    bounds: Mapping[str, Bound]
    linear: Mapping[str, float]
    history: tuple[Attempt, ...]
    notes: tuple[str, ...]
    seconds: Mapping[str, float]
    chosen: Attempt | None = field(default=None, repr=False)
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
        """The certified largest cost over the initial set, NaN when no certificate about that set states one."""
        stated = self.certificate
        kinds = RegionalCertificate | EllipsoidalRegion | UnswitchedCost | ClippedCost
        if self.status == CERTIFIED and isinstance(stated, kinds):
            return stated.worst_bound
        return np.nan

    def require(self) -> Result:
        """Return the result itself when it is certified; raises NotCertifiedError with the reasons otherwise."""
        refuse_uncertified(self)
        return self

    def __str__(self) -> str:
        from .report import table
        return table(self)

    def comparison(self) -> Comparison:
        """Return the controller beside its lower bounds: separations, distance to the best possible, contradictions."""
        from .comparison import compared
        return compared(self)

    def plot(self, path: str | Path | None = None, **options: Any) -> Any:
        """Return a Matplotlib figure of trajectories, inputs, regions and bounds; written to `path` when given.

        options: `width` and `dpi` of `inc_casadi.plotting.plot_result`.
        """
        from inc_casadi.plotting import plot_result
        return plot_result(self, path, **options)

    def plot_search(self, path: str | Path | None = None, **options: Any) -> Any:
        """Return a Matplotlib figure of what was tried, when, and at what cost; written to `path` when given.

        options: `width` and `dpi` of `inc_casadi.plotting.plot_training`.
        """
        from inc_casadi.plotting import plot_training
        return plot_training(self, path, **options)

    def save(self, path: str | Path) -> None:
        """Write plant, specification, controller and certificate to a JSON file; `load_result` reads it."""
        from .storage import save_result
        save_result(self, path)
