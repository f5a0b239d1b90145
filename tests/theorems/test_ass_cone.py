"""ass:cone: |phi(r) - phi(s)| <= |r - s| componentwise, sampled on pairs that straddle every kink."""

import numpy as np
import oracles
import pytest

from inc_casadi import INC, CenteredLogistic, Identity, LeakyReLU, Logistic, ReLU, Saturation, Tanh

UNITS = [ReLU(), LeakyReLU(0.3), Saturation(), Tanh(), CenteredLogistic(), Identity(), Logistic()]
SPECIAL = np.array([-1.0, 0.0, 1.0])  # all kinks of these functions


def pairs():
    rng = np.random.default_rng(11)
    near = np.concatenate([SPECIAL, SPECIAL + 1e-6, SPECIAL - 1e-6, rng.normal(size=60), 30 * rng.normal(size=20)])
    return (grid.ravel() for grid in np.meshgrid(near, near))


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: type(unit).__name__)
def test_every_activation_is_nonexpansive(unit):
    r, s = pairs()
    change = np.abs(oracles.phi(unit, r) - oracles.phi(unit, s))
    assert np.all(change <= np.abs(r - s) * (1 + 1e-9) + 1e-15)
    np.testing.assert_allclose(unit(r), oracles.phi(unit, r), rtol=1e-14, atol=1e-15)  # and it is this function
    steepest = np.max(change[r != s] / np.abs(r - s)[r != s])
    assert steepest == pytest.approx(max(map(abs, unit.slopes)), rel=1e-4)  # what the activation states is not idle


def test_the_logistic_function_does_not_preserve_the_origin_and_the_centered_one_does():
    assert oracles.phi(Logistic(), 0.0) == 0.5 and Logistic().sector is None
    assert oracles.phi(CenteredLogistic(), 0.0) == 0.0 and CenteredLogistic().sector is not None
    zero = np.zeros((1, 1))
    assert not INC(zero, [[1.0]], [[1.0]], zero, activation=Logistic()).preserves_origin


def test_a_leaky_slope_above_one_would_break_it_and_is_refused():
    assert abs(2.0 * -1.0 - 2.0 * -2.0) > abs(-1.0 - -2.0)
    with pytest.raises(ValueError, match=r"leaky ReLU slope"):
        LeakyReLU(2.0)
