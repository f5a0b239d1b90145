"""How a loop that only a multiplier T proves is solved: Newton's trials, then splitting, judged by the residual."""

from __future__ import annotations

from functools import partial
from math import ceil, log

import numpy as np

from ...activations.stack import Units, lipschitz, slopes
from ...arrays import Array
from ...errors import NotWellPosedError
from ...inc import INC
from ...splitting import Splitting, prepare
from ...well_posed import WellPosedness, error_from_residual
from .loops import GUARD, TRIALS, Loop, values
from .sizes import Sizes, by_column, drive, evaluation_error, image, inherited
from .stages import Stage

BETWEEN = 8  # splitting steps from one look at the residual to the next


def splitting(law: INC, stage: Stage, test: WellPosedness, tol: float, newton: bool) -> Loop:
    """Return how a loop with a multiplier T is solved: the number of splitting steps that suffice in exact arithmetic.

    With w_0 = 0 the splitting steps (`splitting.Splitting`) bring w_k, and v_k with it, within rate^k |w*|_T of the
    limit. Then |eta - eta*| <= |A^{-1}| T^{-1/2} rate^k |w*|_T entry by entry, and the residual is at most 1 + S|W| times
    that. w* = v* + alpha (F v* - g) is bounded linearly in max(1, |c|), so `steps` reach the tolerance tol max(1, |c|)
    for every y.

    Smooth units are given the step size alpha = 1, for which the resolvent is a formula.

    >>> law = INC([[-3.0]], [[1.0]], [[1.0]], [[0.0]])
    >>> loop = splitting(law, Stage(0, 1, 0, 0, True), law.well_posedness(), 1e-12, False)
    >>> loop.method, loop.rate < 1e-6, loop.steps
    ('splitting', True, 8)
    """
    assert test.T is not None
    units, W = law.activations[stage.own], law.W[stage.own, stage.own]
    bent = any(unit.pieces is None for unit in units)
    operators = prepare(W, units, test.T, alpha=1.0 if bent else None)
    rate = max(operators.rate * (1 + 1e-9), 1e-9)
    reach = _limit_size(units, W, test, operators) * _residual_per_unit(units, W, test.T, operators)
    needed = ceil(log(tol / max(reach, tol)) / log(rate)) if rate < 1 else 0
    if rate >= 1 or not np.isfinite(reach):
        raise NotWellPosedError(f"the splitting of a loop of {stage.size} units contracts by {operators.rate:.12g} only")
    steps = BETWEEN * max(1, ceil(needed / BETWEEN))
    return Loop("newton and splitting" if newton else "splitting", rate, np.ones(stage.size), steps, TRIALS if newton else 0,
                0, operators)


def _limit_size(units: Units, W: Array, test: WellPosedness, operators: Splitting) -> float:
    """A bound on |w*|_T / max(1, |c|)."""
    q = len(units)
    c = np.column_stack([np.zeros(q), np.ones(q)])
    start = lipschitz(units)[:, None] * c
    start[:, 0] = [abs(float(unit(0.0))) for unit in units]
    eta = by_column(partial(error_from_residual, test, W, slopes(units), guard=GUARD), start)
    v = eta + np.abs(operators.low)[:, None] * (np.abs(W) @ eta + c)
    w = v + operators.alpha * (np.abs(operators.F) @ v + np.abs(operators.drive) @ c)
    assert test.T is not None
    return GUARD * float(np.sqrt(test.T @ w**2).sum())


def _residual_per_unit(units: Units, W: Array, T: Array, operators: Splitting) -> float:
    """A bound on the residual of eta for an error 1 of v in the norm of T."""
    e = np.abs(operators.back) @ T**-0.5
    return GUARD * float(np.max(e + lipschitz(units) * (np.abs(W) @ e)))


def after_splitting(law: INC, stage: Stage, test: WellPosedness, sizes: Sizes, tol: float) -> Sizes:
    """Return the bounds after a loop whose computed residual passed the test: |phi(W eta + c) - eta| <= tau, entry by
    entry.

    Then the true residual is at most tau + delta(eta), delta the rounding of an evaluation, and X = |eta - eta*| is at
    most h sigma(residual) with h = T^{-1/2} and sigma sublinear (`monotone.error_from_residual`). delta grows with X by a
    matrix D of the size of rounding; where sigma(D h) <= 1/2, X is at most twice the bound with delta at eta*.

    Raises NotWellPosedError where rounding takes more than that half.
    """
    assert test.T is not None
    units, W = law.activations[stage.own], law.W[stage.own, stage.own]
    bound = partial(error_from_residual, test, W, slopes(units), guard=GUARD)
    z, h = drive(law, stage, sizes), test.T**-0.5
    terms = law.p + stage.high - stage.low + stage.size + 2
    far = np.column_stack([np.abs(W) @ h, np.zeros(stage.size)])
    grown = evaluation_error(units, far, terms, sizes.precision) - evaluation_error(units, 0 * far, terms, sizes.precision)
    if not np.all(bound(grown[:, 0]) <= h / 2):
        raise NotWellPosedError(f"the monotonicity {test.monotonicity:.3g} of {stage.size} hidden units is within rounding")
    size = values(law, stage, z, by_column(bound, image(units, z)))
    delta = evaluation_error(units, z + np.abs(W) @ size, terms, sizes.precision)
    scale = np.max(z, axis=0)
    tau = tol * np.array([max(1.0, scale[0]), 0.0] if scale[1] == 0 else [1.0 + scale[0], scale[1]])
    tau = (1 + sizes.precision.eps * (terms + 64)) * tau  # the test is in floats too
    error = 2 * by_column(bound, tau + delta) + by_column(bound, inherited(law, stage, sizes))
    return sizes.with_stage(size, error, z + np.abs(W) @ (size + error), tau)
