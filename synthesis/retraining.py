"""Retrain with the certificate: the penalty of eq:cert_aware_loss, then the BMI loop, on a law refused or to be improved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from inc_casadi import INC, Plant, Spec
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.certify import certify
from inc_casadi.claims import DiscountedCost
from inc_casadi.multipliers import Sector

from .alternation import Alternation, alternate
from .law_family import NAMES, Frozen, readout

PENALTY, MARGIN = 1e3, 1e-2  # rho in costs of the LQR loop, and how far inside the inequality, in units of nu at the start


@dataclass(frozen=True, eq=False)
class Retrained:
    """A law retrained with its certificate: the certified bound before (infinite if none) and after, and how it went."""

    inc: INC
    before: float
    after: float
    note: str
    history: tuple[tuple[float, float], ...]


def with_certificate(plant: Plant, spec: Spec, inc: INC, kappa: float, iterations: int, seconds: float,
                     seed: int = 0, frozen: Sequence[str] = ()) -> Retrained:
    """Return a law whose certified bound on the discounted cost is no higher than that of `inc`, by the BMI loop.

    A law without a certificate is first retrained on cost plus rho max(0, nu + margin)^2 at the numbers (P, Lambda) of the
    best certificate that was tried (eq:cert_aware_loss), if no input limits are built in; `alternate` makes feasible what
    is still refused. A saturated readout stays what it is, and so do the matrices that are named frozen.

    Raises InvalidInputError for a law that is not 0 at 0 or does not contract by kappa, and as `alternate`.
    """
    claim = DiscountedCost(spec.Q, spec.R, spec.discount, spec.initial)
    first = certify(plant, inc, claim, multiplier="sector")
    law, steps = inc, ["alternation"]
    if not first.holds() and spec.inputs is None:
        assert isinstance(first, MatrixCertificate)
        law = penalized(plant, spec, inc, first, kappa, iterations, seconds / 2, seed, frozen)
        steps.insert(0, "penalty")
    found = alternate(plant, law, claim, kappa=kappa, frozen=_masks(inc, spec, frozen), max_rounds=iterations,
                      seconds=seconds)
    before = first.bound if first.holds() else np.inf
    after = found.certificate.bound if found.certificate.holds() else np.inf
    return Retrained(found.inc, before, after, f"{', '.join(steps)}: {_words(before, after)} ({found.status})", _rows(found))


def penalized(plant: Plant, spec: Spec, inc: INC, tried: MatrixCertificate, kappa: float, iterations: int,
              seconds: float, seed: int, frozen: Sequence[str] = ()) -> INC:
    """Return what training makes of a law when the violation nu at a certificate's numbers is penalized."""
    from .ball import balanced, row_bound
    from .condition_graph import condition_graph
    from .nlp import minimize
    from .objective import Objective
    from .rollout import Parameters
    from .training_nodes import COARSE
    from .training_setup import setup
    from .violation import Penalized, violation_at

    start = balanced(inc, row_bound(inc.activations, kappa))
    if inc.preserves_origin:  # with biases u would be 0 at y = 0 up to rounding only
        frozen = (*frozen, "b", "d")
    problem = setup(plant, spec, start, kappa=kappa, horizon=None, order=None, anchored=True, frozen=frozen, terminal=None,
                    seed=seed)
    graph = condition_graph(plant, start, tried.claim, Sector())
    values = {name: np.asarray(value) for name, value in tried.values.items()}
    nu = max(violation_at(graph, start, values)[0], 1e-12)
    objective = Penalized(Objective(problem.scenario(COARSE), problem.layout, problem.scale), graph, values,
                          rho=PENALTY * problem.scale / nu**2, margin=MARGIN * nu)
    outcome = minimize(objective, Parameters.of(start), hessian="gauss-newton", max_iterations=iterations,
                       time_limit=seconds)
    return problem.inner(problem.settled(outcome.law))


def _masks(inc: INC, spec: Spec, frozen: Sequence[str]) -> Frozen:
    """What the BMI loop leaves alone: the readout that builds the limits in, and the matrices that are named."""
    named = [name for name in frozen if name in NAMES]
    if spec.inputs is None:
        return named
    return readout(inc) | {name: np.ones(getattr(inc, name).shape, dtype=bool) for name in named}


def _words(before: float, after: float) -> str:
    said = [f"{value:.7g}" if np.isfinite(value) else "none" for value in (before, after)]
    return f"certified bound {said[0]} before, {said[1]} after"


def _rows(found: Alternation) -> tuple[tuple[float, float], ...]:
    return tuple((row["seconds"], row["bound"]) for row in found.history if row["phase"] == "cost")
