"""Rounds of the BMI loop: propose a law within a trust region, solve its matrix inequality, accept or shrink."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from inc_casadi.arrays import Array
from inc_casadi.inc import INC

from .certified_cost import CertifiedCost, cost_at
from .condition_graph import ConditionGraph
from .controller_step import ControllerStep, controller_step
from .law_family import Family, flat

RADIUS, WIDEST, NARROWEST = 0.5, 4.0, 1e-3  # of the trust region, in scales of theta
WIDER, NARROWER = 2.0, 0.25
GAIN, STALLS = 1e-4, 2  # a round that changes the bound by less than this, relative, has stalled; so many end a rung
REBUILD = 0.3  # an NLP is built anew when the bound has fallen to this part of what it was scaled by
CURVATURE = 0.1  # of the first model, relative to the bound, per squared scale of theta


@dataclass
class Search:
    """One search: how it proposes, its budget, the law it is at (`family.start`), and what it has come through.

    best: the certificate with the least bound, of the claim that is asked for; start_bound, history: see `Alternation`.
    """

    way: str
    family: Family
    max_rounds: int
    began: float
    limit: float
    progress: Callable[[dict[str, Any]], None] | None
    best: CertifiedCost | None = None
    start_bound: float = np.inf
    status: str = "nothing searched"
    history: list[dict[str, Any]] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Wall time since the beginning."""
        return time.perf_counter() - self.began

    @property
    def is_over(self) -> bool:
        """Whether a budget is used up; the status says which."""
        if self.seconds >= self.limit:
            self.status = "time limit"
        elif len(self.history) >= self.max_rounds:
            self.status = "round limit"
        else:
            return False
        return True

    def keep(self, point: CertifiedCost | None) -> None:
        """Remember a certificate that holds when it is the best."""
        if point is not None and (self.best is None or point.certificate.bound < self.best.certificate.bound):
            self.best = point

    def descend(self, graph: ConditionGraph, point: CertifiedCost, phase: str = "cost", most: int | None = None) -> None:
        """Lower the certified cost of one rung until it stalls, the region is too small, or a budget is used up.

        phase: a word for the history; only "cost" counts for `best`; most: accepted rounds.
        """
        radius, stalls, accepted_rounds, B = RADIUS, 0, 0, _first_model(point, self.family)
        step = self._step(graph, point)
        while radius >= NARROWEST and stalls < STALLS and accepted_rounds != most:
            if self.is_over:
                return
            if point.value < REBUILD * step.unit:
                step = self._step(graph, point)
            law = step.propose(self.family, point.deeper, point.slope, radius, B)
            trial = _measured(graph, law)
            B = _updated(B, self.family, law, point, trial)
            accepted = trial is not None and trial.value <= point.value
            stalls += trial is not None and abs(trial.value - point.value) <= GAIN * point.value
            row = {"round": len(self.history), "phase": phase, "rung": graph.inequalities.multiplier.name,
                   "bound": point.value, "trial": np.inf if trial is None else trial.value, "accepted": accepted,
                   "radius": radius, "law": law if accepted else None}
            radius = min(WIDER * radius, WIDEST) if accepted else NARROWER * radius
            if accepted and trial is not None:
                point, self.family, accepted_rounds = trial, self.family.about(law), accepted_rounds + 1
                if phase == "cost":
                    self.keep(trial)
            self._report(row | {"bound": point.value, "seconds": self.seconds})
        self.status = "no more progress"

    def _step(self, graph: ConditionGraph, point: CertifiedCost) -> ControllerStep:
        left = None if np.isinf(self.limit) else max(self.limit - self.seconds, 0.1)
        return controller_step(graph, self.family, point.frame, self.way, point.value, seconds=left)

    def _report(self, row: dict[str, Any]) -> None:
        self.history.append(row)
        if self.progress is not None:
            self.progress(row)


def _measured(graph: ConditionGraph, law: INC) -> CertifiedCost | None:
    """Return the certified cost of a law; a certificate counts only if it holds."""
    found = cost_at(graph, law)
    return found if found is not None and found.certificate.holds() else None


def _first_model(point: CertifiedCost, parts: Family) -> Array:
    """Return the curvature that the quasi-Newton model begins with: a change by one scale costs part of the bound."""
    return np.diag(CURVATURE * point.value / parts.scales**2)


def _updated(B: Array, parts: Family, law: INC, point: CertifiedCost, trial: CertifiedCost | None) -> Array:
    """Return the update of Broyden, Fletcher, Goldfarb and Shanno, where the curvature along the step is positive."""
    if trial is None:
        return B
    s, y = flat(law) - parts.theta, trial.slope - point.slope
    if not s @ y > 1e-10 * np.linalg.norm(s) * np.linalg.norm(y):
        return B
    Bs = B @ s
    return B - np.outer(Bs, Bs) / (s @ Bs) + np.outer(y, y) / (s @ y)
