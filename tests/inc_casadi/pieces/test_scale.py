"""How far a set can be scaled: certified below, refuted above."""

import numpy as np
import oracles
import pytest

from inc_casadi import INC, Box, Plant, Polytope, Tanh
from inc_casadi.claims.regional import Regional
from inc_casadi.errors import InvalidInputError
from inc_casadi.pieces.scale import largest_scale
from inc_casadi.pieces.walk import Budget

PLANT = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
GAIN = np.array([[-1.0955, -1.9764]])


def test_both_sides_of_the_factor_are_shown():
    region = Polytope.from_vertices([[-0.8, 0.9, 0.3, -0.5], [-0.7, -0.6, 0.8, 0.5]])
    claim = Regional(region, Box([-1.0], [1.0]), np.eye(2), [[0.05]], 0.98)
    inc = INC.saturated(GAIN, 1.0)
    found = largest_scale(PLANT, inc, claim, tolerance=0.01)
    assert found.certificate.holds() and 0.98 * found.refuted < found.factor < found.refuted
    center = region.center[:, None]
    np.testing.assert_allclose(np.sort(found.certificate.claim.initial.vertices, axis=1),
                               np.sort(center + found.factor * (region.vertices - center), axis=1), atol=1e-9)
    x, _ = oracles.roll_out(PLANT, inc, found.witness[:, None], 400)
    assert np.max(np.abs(x[:, 0, -1])) > 10


def test_an_input_limit_alone_can_be_what_refutes():
    """u = -x/2 on [-1, 1] with |u| <= 1: the factor is 2 exactly."""
    claim = Regional(Box([-1.0], [1.0]), Box([-1.0], [1.0]), [[1.0]], [[0.0]])
    found = largest_scale(Plant([[0.9]], [[1.0]]), INC.linear([[-0.5]]), claim)
    assert found.factor == pytest.approx(2.0, rel=2e-3) and found.factor < 2 <= found.refuted * (1 + 1e-8)


def test_a_stable_loop_is_never_refuted_and_nothing_certified_is_said():
    claim = Regional(Box([-1.0], [1.0]), None, [[1.0]], [[0.0]])
    found = largest_scale(Plant([[0.5]], [[1.0]]), INC.saturated([[-0.3]], 1.0), claim)
    assert found.refuted == np.inf and found.witness is None and found.factor == 256
    unstable = largest_scale(Plant([[1.5]], [[1.0]]), INC.saturated([[-0.1]], 1.0), claim)
    assert unstable.factor == 0 and not unstable.certificate.holds() and unstable.refuted < 0.01


def test_what_is_not_piecewise_affine_is_refused():
    claim = Regional(Box([-1.0], [1.0]), None, [[1.0]], [[0.0]])
    with pytest.raises(InvalidInputError, match="piecewise affine"):
        largest_scale(Plant([[0.5]], [[1.0]]), INC([[0.1]], [[1.0]], [[0.3]], [[0.0]], activation=Tanh()), claim)


@pytest.mark.slow
def test_a_slow_motion_refutes_nothing(monkeypatch):
    """x+ = x + u / 250 with u = sat(-x): from 16 the way to rest takes 3750 steps, and every motion comes to rest."""
    monkeypatch.setattr("inc_casadi.pieces.scale.LARGEST", 16.0)
    claim = Regional(Box([-1.0], [1.0]), Box([-1.0], [1.0]), [[1.0]], [[0.0]], 0.9)
    found = largest_scale(Plant([[1.0]], [[0.004]]), INC.saturated([[-1.0]], 1.0), claim, budget=Budget(steps=300))
    assert found.witness is None and found.refuted == np.inf and found.factor >= 1
