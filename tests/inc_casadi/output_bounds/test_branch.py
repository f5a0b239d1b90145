"""Branch and bound: the true maximum by hand, what a budget leaves, and what counts as a refutation."""

import numpy as np
import posed
import pytest

from inc_casadi import INC, ReLU, Saturation, Tanh, monotone
from inc_casadi.activations.stack import slopes
from inc_casadi.errors import ConvergenceError
from inc_casadi.monotone import Multiplier
from inc_casadi.output_bounds import Boxes, Law, greatest, output_forms
from inc_casadi.output_bounds.branch import _Best, _refuted, surely_at_least

ONE = np.eye(1)
BUMP = Law(INC(np.zeros((2, 2)), [[4.0], [4.0]], [[1.0, -1.0]], [[0.0]], [1.0, -1.0], None, Tanh()), ONE)


def forms(law, limit=0.0):
    none = np.zeros((1, law.C.shape[1]))
    return output_forms(law, none, ONE, np.full(1, limit), none, ONE)


def anywhere(points):
    return np.ones(len(points), dtype=bool)


def test_the_top_of_a_bump_is_found():
    """tanh(4x + 1) - tanh(4x - 1) is largest at 0, in the middle of the interval."""
    top = 2 * np.tanh(1.0)
    found = greatest(BUMP, forms(BUMP), Boxes(-ONE, 0.7 * ONE), anywhere, floor=-np.inf, gap=np.full(1, 1e-6))
    assert top <= found.bound.item() <= top + 1e-6 and found.ended == ""
    assert abs(found.points.item()) < 1e-2 and found.reached.item() == pytest.approx(top, abs=1e-5)
    assert greatest(BUMP, forms(BUMP, top + 1e-7), Boxes(-ONE, ONE), anywhere).bound.item() <= 0.0


def test_a_spent_budget_leaves_true_bounds():
    top = 2 * np.tanh(1.0)
    for limits in ({"most_cells": 3}, {"seconds": 0.0}):
        found = greatest(BUMP, forms(BUMP, top + 1e-7), Boxes(-3 * ONE, 2 * ONE), anywhere, **limits)
        assert found.bound.item() > 0.0 and "cells are open after" in found.ended
        assert found.bound.item() >= -1e-7 >= found.reached.item() - 1e-12 and found.refuted is None


def test_points_outside_the_region_are_not_looked_at():
    found = greatest(BUMP, forms(BUMP), Boxes(-ONE, ONE), lambda points: points[:, 0] > 0.5, most_cells=50)
    assert found.reached.item() < 0.5 and found.bound.item() >= 2 * np.tanh(1.0)


def test_a_value_above_zero_by_rounding_refutes_nothing():
    law = Law(INC.linear([[1.0]]), ONE)
    assert _refuted(law, forms(law, 1.0), _Best(np.full(1, 1e-15), np.ones((1, 1))), 0.0) is None
    assert _refuted(law, forms(law, 1.0 - 1e-12), _Best(np.full(1, 1e-12), np.ones((1, 1))), 0.0) == 0
    assert -1e-13 < surely_at_least(law, forms(law, 1.0), np.ones(1)) <= 0.0


def test_errors_from_residuals_are_those_of_the_theory():
    rng = np.random.default_rng(4)
    inc = posed.controller(rng, (ReLU(), Saturation(), ReLU()), p=1, m=1)
    test, residual = inc.well_posedness(), rng.random((5, 3))
    assert test.T is not None
    multiplier, ends = Multiplier(test.T, test.monotonicity), slopes(inc.activations)
    for found, given in zip(Law(inc, ONE).errors(residual), residual, strict=True):
        assert found == pytest.approx(monotone.error_from_residual(ends, inc.W, multiplier, given), rel=2e-6)
    chain = INC([[0.5, 0.0], [1.0, 0.0]], [[1.0], [0.0]], [[1.0, 1.0]], [[0.0]])
    assert Law(chain, ONE).errors(np.array([[1.0, 0.0]])) == pytest.approx(np.array([[2.0, 2.0]]), rel=1e-4)
    assert np.all(Law(chain, ONE)._weighted_errors(np.array([[1.0, 0.0]])) >= 2.0)


def test_a_contraction_too_weak_for_floats_is_said():
    law = Law(INC([[1 - 1e-10]], [[1.0]], [[1.0]], [[0.0]], activation=Tanh()), ONE)
    with pytest.raises(ConvergenceError, match="too near 1"):
        law.errors(np.ones((1, 1)))
