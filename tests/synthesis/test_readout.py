"""Limits put into a law and taken out again, and units added: the same law each time."""

import numpy as np
import oracles
import pytest

from inc_casadi import INC, Box, ReLU, Saturation, Spec, Tanh
from synthesis.readout import has_readout, inner_of, limited, wider

LIMITS = Box([-0.5, 0.1], [0.7, 2.0])
SPEC = Spec(np.eye(3), np.eye(2), 0.9, Box(-np.ones(3), np.ones(3)), LIMITS)


def law(seed=0, units=4, unit=None):
    rng = np.random.default_rng(seed)
    W = 0.2 * rng.normal(size=(units, units))
    return INC(W, rng.normal(size=(units, 3)), rng.normal(size=(2, units)), rng.normal(size=(2, 3)), rng.normal(size=units),
               rng.normal(size=2), unit or ReLU())


@pytest.fixture
def points():
    return 2 * np.random.default_rng(1).normal(size=(3, 40))


def test_the_inner_law_comes_back(points):
    inner = law()
    clipped = limited(inner, SPEC)
    back = inner_of(clipped, SPEC)
    assert has_readout(clipped) and not has_readout(inner) and back.q == inner.q
    assert back(points) == pytest.approx(inner(points), abs=1e-12)
    u = oracles.control(clipped, points)
    assert u == pytest.approx(np.clip(inner(points), LIMITS.lower[:, None], LIMITS.upper[:, None]), abs=1e-9)


def test_what_is_built_in_is_not_built_in_twice():
    clipped = limited(law(), SPEC)
    assert limited(clipped, SPEC) is clipped and inner_of(law(), SPEC).q == 4


@pytest.mark.parametrize("change", ["read back", "direct", "other unit", "mixed outputs"])
def test_another_form_is_left_alone(change):
    clipped = limited(law(), SPEC)
    W, V, K, units = clipped.W.copy(), clipped.V.copy(), clipped.K.copy(), list(clipped.activations)
    if change == "read back":
        W[0, -1] = 0.1
    elif change == "direct":
        K[0, 0] = 0.1
    elif change == "other unit":
        units[-1] = Tanh()
    else:
        V[0, -1] = 0.1
    other = INC(W, clipped.U, V, K, clipped.b, clipped.d, units)
    assert not has_readout(other) and inner_of(other, SPEC) is other


def test_idle_units_change_nothing(points):
    more = wider(law(), law(3, 5, Saturation()))
    assert more.q == 9 and more(points) == pytest.approx(law()(points), abs=1e-12)
