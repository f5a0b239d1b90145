"""Wherever a Plant is accepted, so is a control.StateSpace, with the same answer."""

import control
import numpy as np
import pytest

from inc_casadi import (
    INC,
    Box,
    DiscountedCost,
    Plant,
    Regional,
    Spec,
    Stability,
    bounds,
    certify,
    close_loop,
    equilibrium,
    simulate,
)
from synthesis import synthesize

A, B = np.array([[0.9, 0.3], [0.0, 0.8]]), np.array([[0.1], [0.5]])
PLANT, SYSTEM = Plant(A, B, dt=0.5), control.ss(A, B, np.eye(2), np.zeros((2, 1)), 0.5)
LAW = INC.saturated([[-0.1, -0.3]], 1.0)
SPEC = Spec(np.eye(2), [[0.1]], 0.95, Box([-1.0, -1.0], [1.0, 1.0]), Box([-1.0], [1.0]))


def test_both_give_the_same_answers():
    np.testing.assert_array_equal(close_loop(SYSTEM, LAW).F, close_loop(PLANT, LAW).F)
    np.testing.assert_array_equal(equilibrium(SYSTEM, LAW).x, equilibrium(PLANT, LAW).x)
    np.testing.assert_array_equal(simulate(SYSTEM, LAW, [1.0, 0.5], steps=4).x, simulate(PLANT, LAW, [1.0, 0.5], steps=4).x)
    for claim in (Stability(0.99), DiscountedCost(SPEC.Q, SPEC.R, 0.95, SPEC.initial),
                  Regional(SPEC.initial, SPEC.inputs, SPEC.Q, SPEC.R, 0.95)):
        ours, theirs = (certify(plant, LAW, claim) for plant in (PLANT, SYSTEM))
        assert theirs.holds() and theirs.bound == ours.bound
    for bound in (bounds.first_move, bounds.affine_moves, bounds.any_controller):
        assert float(bound(SYSTEM, SPEC)) == pytest.approx(float(bound(PLANT, SPEC)), rel=1e-12)
    results = [synthesize(plant, SPEC, hidden=0, verbose=False) for plant in (PLANT, SYSTEM)]
    assert results[0].cost == results[1].cost
