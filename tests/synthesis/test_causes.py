"""Each refusal has the cause that its loop shows."""

import numpy as np
import pytest

from inc_casadi import INC, Box, Gaussian, Plant, Spec, Tanh
from inc_casadi.ellipsoidal_region import EllipsoidalRegion
from inc_casadi.pieces.walk import Budget
from synthesis.causes import Cause, first_of
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
    (PAIR, SQUARE, INC.saturated([[-1.1, -2.0]], 1.0), Budget(seconds=0.0), [Cause.TIME, Cause.HOPELESS, Cause.TIME]),
    (STEEP, scalar(UNIT), INC.linear([[-1.5]]), Budget(), [Cause.LIMITS, Cause.LIMITS, Cause.HOPELESS]),
    (MILD, scalar(UNIT, Box([0.1], [1.0])), INC.linear([[0.0]]), Budget(),
     [Cause.LIMITS, Cause.LIMITS, Cause.HOPELESS]),
    (STEEP, scalar(UNIT, None), INC([[0.0]], [[1.0]], [[-0.1]], [[-0.2]]), Budget(),
     [Cause.KINK, Cause.UNCERTIFIED, Cause.UNSTABLE]),
    (STEEP, scalar(WIDE), SMOOTH, Budget(), [Cause.SMOOTH, Cause.HOPELESS, Cause.REACH]),
    (STEEP, scalar(Gaussian([0.0], [[1.0]]), None), INC.linear([[-0.2]]), Budget(),
     [Cause.HOPELESS, Cause.HOPELESS, Cause.UNCERTIFIED, Cause.HOPELESS]),
], ids=["ill posed", "unstable", "lost", "time", "limits", "rest beyond limits", "kink", "smooth", "normal"])
def test_the_cause_is_what_the_loop_shows(plant, spec, law, budget, causes):
    verdict = gate(plant, spec, law, budget)
    assert not verdict.accepted and list(verdict.causes) == causes
    assert len(verdict.causes) == len(verdict.refusals)


@pytest.mark.parametrize(("plant", "spec", "law", "budget", "first"), [
    (PAIR, SQUARE, INC.saturated([[-1.1, -2.0]], 1.0), Budget(pieces=2), Cause.PIECES),
    (STEEP, scalar(UNIT), SMOOTH, Budget(), Cause.SMOOTH)], ids=["pieces", "smooth"])
def test_where_motions_cannot_be_followed_an_ellipsoid_may_do(plant, spec, law, budget, first):
    verdict = gate(plant, spec, law, budget)
    assert isinstance(verdict.certificate, EllipsoidalRegion) and verdict.certificate.holds()
    assert list(verdict.causes) == [first, Cause.HOPELESS]


def test_how_far_the_ellipsoid_reaches_is_said_and_asks_for_no_retry():
    verdict = gate(STEEP, scalar(WIDE), SMOOTH)
    reach = float(verdict.refusals[-1].split("scaled by ")[1].split()[0])
    assert 0.7 < reach <= 1.915 / 2.5  # the next equilibria, 0.5 x = tanh x, are at +-1.915
    assert first_of(verdict.causes[1:]) is None
