"""How many floating-point operations the C of a law takes at most: sums, products, quotients and comparisons, each one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...activations.stack import Units
from ...arrays import Array
from ...inc import INC
from .expressions import curve
from .loops import Loop
from .split_loops import BETWEEN
from .stages import Stage
from .text import MANY_ROWS, padded

DISTANCE = 7  # per unit: difference, its two signs, product, largest, sum, and whether it is zero


class Work(NamedTuple):
    """Operations, and calls of tanh beside them."""

    operations: int
    curved: int

    def plus(self, other: Work, times: int = 1) -> Work:
        """Return the work with another added so many times."""
        return Work(self.operations + times * other.operations, self.curved + times * other.curved)


NONE = Work(0, 0)


def product(matrix: Array) -> Work:
    """Return the work of z += matrix x: none for a matrix of zeros, which is left out; many rows go by four columns.

    >>> product(np.ones((2, 3))).operations, product(np.zeros((2, 3))).operations
    (12, 0)
    """
    rows, count = matrix.shape
    return Work(2 * rows * (padded(count) if rows >= MANY_ROWS else count) if matrix.any() else 0, 0)


def units_once(units: Units) -> Work:
    """Return the work of evaluating units: a test for each kink, a product and a sum; around a tanh at most four more."""
    bent = [curve(unit) is not None for unit in units]
    flat = sum(2 + unit.pieces.kinks.size for unit in units if unit.pieces is not None)
    return Work(int(flat) + 4 * sum(bent), sum(bent))


def evaluation(law: INC, stage: Stage) -> Work:
    """Return the work of phi(c + W eta) in a loop, with the distance to eta."""
    units = law.activations[stage.own]
    return product(law.W[stage.own, stage.own]).plus(units_once(units)).plus(Work(DISTANCE * stage.size, 0))


def trial(law: INC, stage: Stage, cache: bool = False, inner: int = 0) -> Work:
    """Return the work of a Newton trial when all k units have a slope: tangents, elimination, solution, and what judges it.

    Elimination without pivots takes about 2 k^3 / 3, the inverse that a cache keeps 2 k^3, each inner step 2 k^2.

    >>> trial(INC([[0.5]], [[1.0]], [[1.0]], [[0.0]]), Stage(0, 1, 0, 0, True)).operations
    31
    """
    k = stage.size
    rest = np.arange(k)
    steps = k * (1 + k + 2 * k * (k - 1)) if cache else int(np.sum(1 + rest * (1 + 2 * rest)))
    kinks = sum(unit.pieces.kinks.size for unit in law.activations[stage.own] if unit.pieces is not None)
    solved = 4 * k * k + steps
    if inner:
        solved = inner * (2 * padded(k) ** 2 + 2 * padded(k))
    once = Work(solved + 11 * k + int(kinks), 0)
    return once.plus(product(law.W[stage.own, stage.own])).plus(evaluation(law, stage))


def loop_work(law: INC, stage: Stage, loop: Loop, cache: bool) -> Work:
    """Return the work of solving a loop when nothing ends it early."""
    k, units = stage.size, law.activations[stage.own]
    start = units_once(units).plus(Work(DISTANCE * k, 0))
    one, attempt = evaluation(law, stage), trial(law, stage, cache, loop.inner)
    if loop.splitting is not None:
        step = Work(2 * k * k + 8 * k, 0).plus(units_once(units))
        looks = one.plus(product(loop.splitting.back)).plus(Work(2 * k, 0))
        work = start.plus(Work(2 * k * k, 0)).plus(step, loop.steps).plus(looks, loop.steps // BETWEEN)
        again = (loop.steps // BETWEEN).bit_length()
        return work.plus(attempt, loop.trials + cache + again).plus(one) if loop.trials else work
    if loop.trials == 0:
        return start.plus(one, loop.steps)
    return start.plus(one, loop.steps + loop.trials + 1).plus(attempt, loop.trials + cache)


def affine_work(law: INC, stages: tuple[Stage, ...]) -> Work:
    """Return the work outside the loops' own steps: what drives each stage, layers, the output and the tests of y and u."""
    work = Work(2 * law.p + 2 * law.m, 0).plus(product(law.K)).plus(product(law.V))
    for stage in stages:
        work = work.plus(product(law.U[stage.own])).plus(product(law.W[stage.own, stage.read]))
        if not stage.loop:
            work = work.plus(units_once(law.activations[stage.own]))
    return work
