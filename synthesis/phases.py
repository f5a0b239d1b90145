"""The phases of one training: from few nodes to more, in the form asked for, each beginning where the last one ended."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from inc_casadi.arrays import Array

from .objective import Objective
from .outcome import Outcome
from .phase_log import PhaseLog
from .rollout import Parameters, Scenario, roll
from .training_nodes import COARSE, FINE, LIFTED_COARSE, LIFTED_FINE
from .training_setup import Setup

FORMS = ("auto", "shooting", "lifted", "projected")
SHORT_HORIZON, SHORT_ITERATIONS = 2, 40
_POOR = 4.0  # a start this many times above the cost without input limits is first brought near by a short horizon
_BACKOFF, _TIGHTENED = 1.2, 3  # half-spaces are tightened by this much of the violation seen, at most so many times
_MOST_MARGIN = 0.05  # of the lifted form, as a share of the sets' size
_CHEAPER = 5  # steps of projected gradients for one of IPOPT


@dataclass(frozen=True, eq=False)
class Form:
    """How the NLP is written and solved: see `train` for the options. "auto" is settled before a search begins."""

    name: str = "auto"
    method: str = "adjoint"
    hessian: str = "auto"
    steps: str = "spectral"
    readout: bool = True

    @property
    def budgets(self) -> tuple[int, int]:
        """Most nodes of the coarse phase and of the fine ones."""
        return (LIFTED_COARSE, LIFTED_FINE) if self.name == "lifted" else (COARSE, FINE)


@dataclass(frozen=True, eq=False)
class Search:
    """The phases of one training, each at most `max_iterations` long; the log holds what they have come to so far."""

    setup: Setup
    form: Form
    max_iterations: int
    log: PhaseLog

    def run(self, law: Parameters) -> list[Parameters]:
        """Return the laws that the phases end with, each phase beginning where the last one ended."""
        laws: list[Parameters] = []
        margin, beside = np.zeros(self.setup.rows), np.zeros((self.setup.plant.n, 0))
        coarse, fine = self.form.budgets
        fewer = (self.max_iterations + 1) // 2
        phases = [("coarse", coarse, self.max_iterations), ("fine", fine, fewer)]
        if self.setup.rows:
            phases += [("tightened", fine, fewer)] * _TIGHTENED
        begun = roll(self.setup.scenario(coarse), law).cost
        # The lifted form needs no such help: it begins along a motion that need not be the law's.
        if not begun <= _POOR * self.setup.scale and self.form.name != "lifted":
            phases.insert(0, ("short", coarse, SHORT_ITERATIONS))
        for name, budget, iterations in phases:
            if self.log.is_over or iterations == 0:
                break
            found = self.setup.settled(self._phase(name, budget, margin, beside, law, iterations))
            if name == "short" and np.isfinite(begun) and roll(self.setup.scenario(coarse), found).cost >= begun:
                continue
            law = found
            laws.append(law)
            excess = self.setup.judge(law)[1]
            margin = margin + _BACKOFF * np.maximum(excess, 0.0)
            if self.form.name == "lifted" and self.setup.rows:
                # A hard constraint is met at its nodes: what fails between them is cured by nodes there, hardly by margins.
                margin = np.minimum(margin, _MOST_MARGIN * self.setup.reach)
                beside = np.unique(np.hstack([beside, self.setup.worst_starts(law)]), axis=1)
            if name in ("fine", "tightened") and np.all(excess <= 0.0):
                break
        return laws

    def _phase(self, name: str, budget: int, margin: Array, beside: Array, law: Parameters, iterations: int) -> Parameters:
        return self.log.entered(name, partial(self._solved, name, budget, margin, beside, law, max_iterations=iterations))

    def _solved(self, name: str, budget: int, margin: Array, beside: Array, law: Parameters, **options: Any) -> Outcome:
        inputs, states = self.setup.split(margin)
        if self.form.name == "lifted":
            return self._lifted(name, budget, inputs, states, beside, law, **options)
        scenario = self.setup.scenario(budget, inputs, SHORT_HORIZON if name == "short" else None)
        if self.form.name == "projected":
            from .projected import descend

            options["max_iterations"] *= _CHEAPER
            return descend(self._objective(scenario), law, steps=self.form.steps, **options)
        from .nlp import minimize

        sketch, hessian = self.setup.sketch(scenario), self.form.hessian
        if hessian == "auto":
            hessian = "limited-memory" if sketch is None else "gauss-newton"
        return minimize(self._objective(scenario, sketch), law, method=self.form.method, hessian=hessian, **options)

    def _lifted(self, name: str, budget: int, inputs: Array, states: Array, beside: Array, law: Parameters,
                **options: Any) -> Outcome:
        from .lifted import LEVELS, minimize_lifted

        pair, hard = self.setup.states, self.setup.rows > 0 or not self.form.readout
        scenario = self.setup.scenario(budget, inputs, corners=hard, beside=beside)
        return minimize_lifted(self._objective(scenario), law, readout=self.form.readout, gain=self.setup.gain,
                               states=None if pair is None else (pair[0], pair[1] - states),
                               levels=LEVELS if name == "coarse" else LEVELS[1:], **options)

    def _objective(self, scenario: Scenario, sketch: Scenario | None = None) -> Objective:
        return Objective(scenario, self.setup.layout, self.setup.scale, sketch)
