"""Which method solves a loop: as asked, where it fits, or whichever took less work on sampled measurements."""

from __future__ import annotations

import numpy as np

from ...activations.stack import derivative, evaluate
from ...arrays import Array
from ...errors import InvalidInputError
from ...inc import INC
from ...sets import Box
from ...well_posed import WellPosedness
from .stages import Stage

SAMPLES, MOST_STEPS, NEWTON_STEPS = 64, 300, 3


def chosen(law: INC, stage: Stage, test: WellPosedness, method: str, tol: float, cache: bool, inputs: Box | None) -> bool:
    """Return whether a loop is given Newton's trials.

    Raises InvalidInputError for "contraction" where the loop does not contract, "splitting" where it does, and a cache of
    patterns for curved units, whose slopes never repeat.
    """
    if cache and any(unit.pieces is None for unit in law.activations[stage.own]):
        raise InvalidInputError("cache keeps the last pattern of piecewise-affine units, but a loop has curved ones")
    if test.contracts and method == "splitting":
        raise InvalidInputError("method is 'splitting', for loops that only a multiplier T proves, but this one contracts")
    if not test.contracts and method == "contraction":
        raise InvalidInputError(f"method is 'contraction', but a loop of {stage.size} units does not contract: {test.test}")
    if method != "auto":
        return method == "newton"
    return cache or not test.contracts or _newton_is_cheaper(law, stage, test, tol, inputs)


def _newton_is_cheaper(law: INC, stage: Stage, test: WellPosedness, tol: float, inputs: Box | None) -> bool:
    """Whether three trials on the units that have a slope take fewer products than the contraction, on average."""
    rng = np.random.default_rng(0)
    y = rng.standard_normal((law.p, SAMPLES)) if inputs is None else inputs.sample(SAMPLES, rng)
    steps, active = _contracted(law, stage, test, y, tol)
    k = stage.size
    return steps * k**2 > NEWTON_STEPS * ((active * k) ** 3 / 3 + 3 * k**2)


def _contracted(law: INC, stage: Stage, test: WellPosedness, y: Array, tol: float) -> tuple[float, float]:
    """Mean number of contraction steps, at most 300, and mean share of units with a slope at the end."""
    units, W = law.activations[stage.own], law.W[stage.own, stage.own]
    c = law.U[stage.own] @ y + law.b[stage.own, None]
    if stage.high:
        c = c + law.W[stage.own, stage.read] @ law.hidden(y)[stage.read]
    eta = evaluate(units, c)
    scale = np.maximum(1.0, np.max(np.abs(eta) / test.weights[:, None], axis=0))
    total = np.zeros(y.shape[1])
    for _ in range(MOST_STEPS):
        new = evaluate(units, W @ eta + c)
        still = np.max(np.abs(new - eta) / test.weights[:, None], axis=0) > tol * scale
        eta, total = new, total + still
        if not still.any():
            break
    return float(np.mean(total)) + 2, float(np.mean(derivative(units, W @ eta + c) != 0))
