"""Each refusal has the cause that its loop shows."""

import numpy as np
import pytest

from inc_casadi import INC, Box, Gaussian, Plant, Spec, Tanh
from inc_casadi.pieces.walk import Budget
from synthesis.causes import Cause
from synthesis.gate import gate

UNIT, WIDE = Box([-1.0], [1.0]), Box([-2.5], [2.5])
STEEP, MILD = Plant([[1.5]], [[1.0]]), Plant([[0.8]], [[1.0]])
SMOOTH = INC([[0.0]], [[1.0]], [[-1.0]], [[0.0]], activation=Tanh())
PAIR = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
SQUARE = Spec(np.eye(2), [[0.05]], 0.98, Box([-0.8, -0.8], [0.8, 0.8]), UNIT)


def scalar(initial, inputs=UNIT):
    return Spec([[1.0]], [[0.1]], 0.9, initial, inputs)


@pytest.mark.parametrize(("plant", "spec", "law", "budget", "causes"), [
    (STEEP, scalar(UNIT), INC([[1.5]], [[1.0]], [[1.0]], [[0.0]]), Budget(), [Cause.ILL_POSED]),
    (STEEP, scalar(UNIT), INC.saturated([[-0.2]], 1.0), Budget(), [Cause.UNSTABLE, Cause.HOPELESS]),
    (STEEP, scalar(WIDE), INC.saturated([[-1.5]], 1.0), Budget(), [Cause.LOST, Cause.HOPELESS]),
    (PAIR, SQUARE, INC.saturated([[-1.1, -2.0]], 1.0), Budget(pieces=2), [Cause.PIECES, Cause.HOPELESS]),
    (PAIR, SQUARE, INC.saturated([[-1.1, -2.0]], 1.0), Budget(seconds=0.0), [Cause.TIME, Cause.HOPELESS]),
    (STEEP, scalar(UNIT), INC.linear([[-1.5]]), Budget(), [Cause.LIMITS, Cause.HOPELESS]),
    (MILD, scalar(UNIT, Box([0.1], [1.0])), INC.linear([[0.0]]), Budget(), [Cause.LIMITS, Cause.HOPELESS]),
    (STEEP, scalar(UNIT, None), INC([[0.0]], [[1.0]], [[-0.1]], [[-0.2]]), Budget(), [Cause.KINK, Cause.UNCERTIFIED]),
    (STEEP, scalar(UNIT), SMOOTH, Budget(), [Cause.SMOOTH, Cause.HOPELESS]),
    (STEEP, scalar(Gaussian([0.0], [[1.0]]), None), INC.linear([[-0.2]]), Budget(), [Cause.HOPELESS, Cause.UNCERTIFIED]),
], ids=["ill posed", "unstable", "lost", "pieces", "time", "limits", "rest beyond limits", "kink", "smooth", "normal"])
def test_the_cause_is_what_the_loop_shows(plant, spec, law, budget, causes):
    verdict = gate(plant, spec, law, budget)
    assert not verdict.accepted and list(verdict.causes) == causes
    assert len(verdict.causes) == len(verdict.refusals)
