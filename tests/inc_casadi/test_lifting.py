"""Several steps in one stack: the rows map motions as they promise, with and without inputs from outside."""

import draws
import multiplier_draws as md
import numpy as np
import oracles
import pytest

from inc_casadi import INC, LeakyReLU, Plant, ReLU, Saturation, Tanh, close_loop
from inc_casadi.blocks import exact
from inc_casadi.errors import InvalidInputError
from inc_casadi.lifting import lifting_obstacle, unrolled
from inc_casadi.readings import Rational, Rounded

UNITS = (ReLU(), Tanh(), LeakyReLU(0.3), Saturation(), ReLU())


def motion(rng, steps, bias=0.0):
    """A loop and x_k (n, N), eta_k, z_k, u_k along motions of it."""
    plant, inc = draws.plant(rng), draws.controller(rng, units=UNITS, bias=bias)
    x, states, etas, levels, inputs = draws.points(rng, 3, 50), [], [], [], []
    for _ in range(steps + 2):
        eta = oracles.hidden(inc, plant.C @ x)
        states.append(x)
        etas.append(eta)
        levels.append(inc.W @ eta + inc.U @ plant.C @ x)
        inputs.append(inc.K @ plant.C @ x + inc.V @ eta)
        x = plant.A @ x + plant.B @ inputs[-1]
    return close_loop(plant, inc), states, etas, levels, inputs


@pytest.mark.parametrize("steps", [1, 2, 3])
@pytest.mark.parametrize("next_too", [True, False])
def test_the_rows_map_a_motion_as_they_promise(steps, next_too):
    loop, x, eta, z, u = motion(np.random.default_rng(50), steps)
    lifted = unrolled(loop, steps, next_too=next_too)
    last = steps + 1 if next_too else steps
    s = np.vstack([x[0], *eta[:last]])
    assert lifted.width == len(s) == 3 + 5 * last and lifted.q == 5
    np.testing.assert_allclose(lifted.X @ s, np.vstack([x[0], *eta[:steps]]))
    np.testing.assert_allclose(lifted.H @ s, np.vstack(eta[:last]))
    np.testing.assert_allclose(lifted.Z @ s, np.vstack(z[:last]), atol=1e-9)
    np.testing.assert_allclose(lifted.G @ s, u[0], atol=1e-9)
    if next_too:
        np.testing.assert_allclose(lifted.F @ s, np.vstack([x[1], *eta[1: steps + 1]]), atol=1e-9)
    else:
        assert lifted.F.shape == (0, lifted.width)
    assert lifted.units == tuple(range(5)) * last and len(lifted.lower) == len(lifted.upper) == 5 * last
    np.testing.assert_array_equal(lifted.upper, np.tile(loop.upper, last))
    np.testing.assert_array_equal(lifted.lower, np.tile(loop.lower, last))


def test_inputs_from_outside_belong_to_the_first_step():
    rng = np.random.default_rng(51)
    loop, x, eta, _, _ = motion(rng, 1)
    E, w = rng.normal(size=(3, 2)), rng.normal(size=(2, 50))
    lifted = unrolled(loop.with_inputs(E), 1, next_too=True)
    ahead = x[1] + E @ w
    eta_ahead = oracles.hidden(loop.inc, loop.plant.C @ ahead)
    s = np.vstack([x[0], eta[0], w, eta_ahead])
    np.testing.assert_allclose(lifted.F @ s, np.vstack([ahead, eta_ahead]), atol=1e-9)
    np.testing.assert_allclose(lifted.X @ s, np.vstack([x[0], eta[0]]))
    np.testing.assert_allclose(lifted.H @ s, np.vstack([eta[0], eta_ahead]))
    levels = loop.inc.W @ eta_ahead + loop.inc.U @ loop.plant.C @ ahead
    np.testing.assert_allclose(lifted.Z[5:] @ s, levels, atol=1e-9)
    now = unrolled(loop.with_inputs(E), 1, next_too=False)
    assert now.width == 8 and now.inputs == 0 and lifted.inputs == 2
    np.testing.assert_array_equal(now.Z, loop.Z)
    np.testing.assert_array_equal(now.G, loop.G)


@pytest.mark.parametrize("kind", [Rational, Rounded])
def test_other_arithmetics_read_the_same_stack(kind):
    loop = motion(np.random.default_rng(52), 1)[0]
    plain, read = (unrolled(one, 2, next_too=True) for one in (loop, loop.read(kind)))
    for name in ("F", "Z", "X", "H", "G"):
        value = getattr(read, name)
        numbers = value if isinstance(value, np.ndarray) else value.fractions() if kind is Rational else value.value
        np.testing.assert_allclose(numbers.astype(float), getattr(plain, name), atol=1e-12)


def test_the_rational_stack_is_formed_without_rounding():
    loop = close_loop(Plant([[0.1]], [[0.2]]), INC([[0.3]], [[0.7]], [[1.1]], [[0.9]]))
    lifted = unrolled(loop.read(Rational), 1, next_too=True)
    A, B, W, U, V, K = (exact(np.array([value]))[0] for value in (0.1, 0.2, 0.3, 0.7, 1.1, 0.9))
    assert lifted.Z.fractions().tolist() == [[U, W, 0], [U * (A + B * K), U * B * V, W]]


@pytest.mark.parametrize(("dt", "bias", "steps", "noisy", "message"), [
    (0.0, 0.0, 1, None, "discrete time"), (1.0, 1.0, 1, None, "difference of two motions"),
    (1.0, 0.0, 2, False, "one step ahead only, not 2"), (1.0, 0.0, 1, True, "the measurement is disturbed")])
def test_what_cannot_be_lifted_says_why(dt, bias, steps, noisy, message):
    rng = np.random.default_rng(53)
    loop = close_loop(draws.plant(rng, dt=dt), draws.controller(rng, units=UNITS, bias=bias))
    if noisy is not None:
        loop = loop.with_inputs(rng.normal(size=(3, 2)), rng.normal(size=(4, 2)) if noisy else None)
    assert message in lifting_obstacle(loop, steps)
    for next_too in (True, False):
        with pytest.raises(InvalidInputError, match=message):
            unrolled(loop, steps, next_too=next_too)
    if noisy:
        assert message in lifting_obstacle(loop.read(Rational).with_inputs(np.ones((3, 1)), np.ones((4, 1))), steps)
        assert message in lifting_obstacle(loop.read(Rounded).with_inputs(np.ones((3, 1)), np.ones((4, 1))), steps)


def test_what_can_be_lifted_has_no_obstacle():
    rng = np.random.default_rng(54)
    loop = close_loop(draws.plant(rng), draws.controller(rng, units=UNITS))
    for one in (loop, loop.with_inputs(np.ones((3, 2))), loop.read(Rational).with_inputs(np.ones((3, 2)))):
        assert lifting_obstacle(one, 1) is None
    assert lifting_obstacle(loop, 7) is None
    biased = close_loop(*md.square_loop(rng, (ReLU(), ReLU()), dyadic=True, rest=(1.0, -0.5)))
    assert lifting_obstacle(biased, 1) is not None
