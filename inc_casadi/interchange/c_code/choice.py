"""Which method solves a loop: as asked, where it fits, or whichever took less work on sampled measurements."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...activations.stack import derivative, evaluate
from ...arrays import Array
from ...errors import InvalidInputError
from ...inc import INC
from ...sets import Box
from ...well_posed import WellPosedness
from .loops import Way
from .stages import Stage
from .text import may_vanish

SAMPLES, MOST_STEPS, MOST_INNER = 64, 300, 60
REFERENCE = 1e-13  # the tolerance at which the work of trials is estimated
SHORT = 24.0  # what starting a short loop of the elimination costs, in multiply-adds of long ones; measured
BENT = 130.0  # what a tanh costs, likewise
CURVED_TRIALS = 4.0


class Sampled(NamedTuple):
    """Contraction steps on average and nearly always (9 in 10), the latter for `REFERENCE` too; mean share of units with a
    slope; trials of Newton."""

    steps: float
    mostly: int
    reference: int
    active: float
    trials: float


def chosen(law: INC, stage: Stage, test: WellPosedness, method: str, tol: float, cache: bool, inputs: Box | None) -> Way:
    """Return whether a loop is given Newton's trials, and how these solve their pattern.

    Raises InvalidInputError for "contraction" where the loop does not contract, "splitting" where it does, and a cache of
    patterns for curved units, whose slopes never repeat.
    """
    if cache and any(unit.pieces is None for unit in law.activations[stage.own]):
        raise InvalidInputError("cache keeps the last pattern of piecewise-affine units, but a loop has curved ones")
    if test.contracts and method == "splitting":
        raise InvalidInputError("method is 'splitting', for loops that only a multiplier T proves, but this one contracts")
    if not test.contracts and method == "contraction":
        raise InvalidInputError(f"method is 'contraction', but a loop of {stage.size} units does not contract: {test.test}")
    if method in ("contraction", "splitting"):
        return Way(False)
    if cache or not test.contracts:
        return Way(True)
    return _cheapest(law, stage, _sampled(law, stage, test, tol, inputs), may_refuse=method == "auto")


def _cheapest(law: INC, stage: Stage, found: Sampled, may_refuse: bool) -> Way:
    """The way that takes the least work: contraction, or trials solved by elimination or by inner steps.

    Work is counted in multiply-adds of long loops, on sampled averages; nothing that is proved rests on it. That of trials
    is taken at one tolerance, so that a smaller one leads from contraction to trials and never back.
    """
    units, k = law.activations[stage.own], stage.size
    some = found.active * k
    bent = BENT * sum(unit.pieces is None for unit in units)
    one = k * (some if may_vanish(units) else k) + 10.0 * k + bent
    elimination = some**3 / 3 + SHORT * some**2
    newton = 2 * one + found.trials * (one + min(elimination, _inner_work(found.reference, some)))
    if may_refuse and found.steps * one <= newton:
        return Way(False)
    return Way(True, max(1, found.mostly - 2) if _inner_work(found.mostly, some) < elimination else 0)


def _inner_work(mostly: int, some: float) -> float:
    inner = max(1, mostly - 2)
    return (inner + 1.5) * some**2 + 50.0 * inner if inner <= MOST_INNER else np.inf


def _sampled(law: INC, stage: Stage, test: WellPosedness, tol: float, inputs: Box | None) -> Sampled:
    """Run the contraction on sampled measurements, at most 300 steps."""
    rng = np.random.default_rng(0)
    y = rng.standard_normal((law.p, SAMPLES)) if inputs is None else inputs.sample(SAMPLES, rng)
    units, W = law.activations[stage.own], law.W[stage.own, stage.own]
    c = law.U[stage.own] @ y + law.b[stage.own, None]
    if stage.high:
        c = c + law.W[stage.own, stage.read] @ law.hidden(y)[stage.read]
    eta = evaluate(units, c)
    first = derivative(units, W @ eta + c)
    scale = np.maximum(1.0, np.max(np.abs(eta) / test.weights[:, None], axis=0))
    bounds, total = np.outer([tol, REFERENCE], scale), np.ones((2, SAMPLES))
    for _ in range(MOST_STEPS):
        new = evaluate(units, W @ eta + c)
        still = np.max(np.abs(new - eta) / test.weights[:, None], axis=0) > bounds
        eta, total = new, total + still
        if not still.any():
            break
    last = derivative(units, W @ eta + c)
    mostly, reference = np.ceil(np.quantile(total, 0.9, axis=1)).astype(int).tolist()
    return Sampled(float(np.mean(total[0])) + 1, mostly, reference, float(np.mean(last != 0)),
                   _trials(law, stage, first, last))


def _trials(law: INC, stage: Stage, first: Array, last: Array) -> float:
    """About how many trials Newton takes: one where the first pattern is the last, else one or two more."""
    if any(unit.pieces is None for unit in law.activations[stage.own]):
        return CURVED_TRIALS
    return 1.0 + 1.5 * float(np.mean(np.any(first != last, axis=0)))
