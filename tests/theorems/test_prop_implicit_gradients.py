"""prop:implicit_gradients: sensitivities and adjoints of the fixed point, against differences of Picard's iteration."""

from dataclasses import replace

import draws
import numpy as np
import oracles
import pytest

from inc_casadi import INC, CenteredLogistic, LeakyReLU, Logistic, ReLU, Saturation, Tanh

UNITS = (ReLU(), LeakyReLU(0.3), Tanh(), Saturation(), CenteredLogistic(), Logistic())
NAMES = ("W", "U", "V", "K", "b", "d")


def example(seed=41):
    rng = np.random.default_rng(seed)
    inc = draws.controller(rng, units=UNITS, bias=0.7, gain=1.0, norm=0.8)
    return inc, rng.normal(size=inc.p), rng.normal(size=inc.m)


def difference(value, step=1e-6):
    """Return the central difference of a function of one number at 0."""
    return (value(step) - value(-step)) / (2 * step)


def loss(inc, y):
    """l(u) = u'u / 2 + sum of sin(u), with gradient u + cos(u)."""
    u = oracles.control(inc, y[:, None])[:, 0]
    return u @ u / 2 + np.sin(u).sum()


def test_the_jacobian_is_the_derivative_of_the_law():
    inc, y, _ = example()
    columns = [difference(lambda t, e=e: oracles.control(inc, (y + t * e)[:, None])[:, 0]) for e in np.eye(inc.p)]
    np.testing.assert_allclose(inc.jacobian(y), np.column_stack(columns), atol=1e-7)


@pytest.mark.parametrize("name", NAMES)
def test_the_adjoint_is_the_gradient_to_every_parameter(name):
    inc, y, _ = example()
    u = oracles.control(inc, y[:, None])[:, 0]
    found = getattr(inc.adjoint(y, u + np.cos(u)), name)
    value = getattr(inc, name)
    true = np.zeros_like(value)
    for entry in np.ndindex(value.shape):
        direction = np.zeros_like(value)
        direction[entry] = 1.0
        true[entry] = difference(lambda t, e=direction: loss(replace(inc, **{name: value + t * e}), y))
    assert np.max(np.abs(true)) > 1e-3
    np.testing.assert_allclose(found, true, atol=2e-7)


def test_the_gradient_to_the_measurement():
    inc, y, _ = example()
    u = oracles.control(inc, y[:, None])[:, 0]
    true = [difference(lambda t, e=e: loss(inc, y + t * e)) for e in np.eye(inc.p)]
    np.testing.assert_allclose(inc.adjoint(y, u + np.cos(u)).y, true, atol=2e-7)


def test_the_adjoint_fixed_point_solved_by_iteration_gives_the_same():
    # eq:adjoint_fixed_point, v = D (W'v + V'q), iterated; then b and y as eq:parameter_gradients says.
    inc, y, q = example()
    z = inc.W @ oracles.hidden(inc, y[:, None])[:, 0] + inc.U @ y + inc.b
    D = np.array([difference(lambda t, unit=unit, at=at: float(oracles.phi(unit, at + t)))
                  for unit, at in zip(inc.activations, z, strict=True)])
    v = np.zeros(inc.q)
    for _ in range(500):
        v = D * (inc.W.T @ v + inc.V.T @ q)
    found = inc.adjoint(y, q)
    np.testing.assert_allclose(found.b, v, atol=1e-7)
    np.testing.assert_allclose(found.y, inc.K.T @ q + inc.U.T @ v, atol=1e-7)


def test_the_system_is_nonsingular_for_every_generalized_slope():
    rng = np.random.default_rng(42)
    W = rng.normal(size=(5, 5))
    W = 0.99 * W / np.max(np.abs(np.linalg.eigvals(np.abs(W))))
    D = np.concatenate([rng.integers(0, 2, size=(500, 5)), rng.uniform(size=(500, 5))])  # kinks give any slope in [0, 1]
    smallest = np.linalg.svd(np.eye(5) - D[:, :, None] * W, compute_uv=False)[:, -1]
    assert smallest.min() > 1e-3


def test_at_a_kink_the_jacobian_is_one_of_the_one_sided_ones():
    inc = INC([[0.5]], [[1.0]], [[1.0]], [[0.0]], activation=ReLU())  # u = 2 max(y, 0)
    assert inc.jacobian([0.0]).item() in (0.0, 2.0)
