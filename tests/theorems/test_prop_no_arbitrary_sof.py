"""prop:no_arbitrary_sof: every controller is a static output law, so none beats the best of all static output laws."""

import draws
import numpy as np
import oracles
import pytest

from inc_casadi import INC, Box, Plant, Spec, bounds, compare
from inc_casadi.errors import InvalidInputError


def test_a_controller_is_one_function_of_the_present_measurement():
    # The same y gives the same u, whatever came before, whatever is evaluated beside it, and by another iteration.
    rng = np.random.default_rng(61)
    inc = draws.controller(rng, bias=0.5, gain=1.0)
    y = rng.normal(size=(inc.p, 50))
    u = inc(y)
    again = inc(np.concatenate([100 * y[:, ::-1], y], axis=1))[:, 50:]
    np.testing.assert_allclose(again, u, atol=1e-10)
    np.testing.assert_allclose(np.stack([inc(point) for point in y.T], axis=1), u, atol=1e-10)
    np.testing.assert_allclose(oracles.control(inc, y), u, atol=1e-9)


def test_a_static_law_that_is_no_network_is_as_good_as_the_best_network():
    # On x+ = 1.5 x + u, |u| <= 1, mu(x) = -sign(x) min(|1.5 x|, 1), typed without units, costs what -sat(1.5 x) does: for
    # r = 0 every law has |x_1| >= max(1.5 |x_0| - 1, 0), and these attain it and rest at 0 from then on.
    x = np.linspace(-1, 1, 2001)
    total = np.zeros_like(x)
    state = x.copy()
    for _ in range(5):
        total += state**2
        state = 1.5 * state - np.sign(state) * np.minimum(np.abs(1.5 * state), 1)
    network = oracles.roll_out(Plant(1.5, 1.0), INC.saturated([[-1.5]], 1.0), x[None], 5)
    np.testing.assert_allclose(total, np.sum(network[0][0] ** 2, axis=-1), atol=1e-15)
    least = x**2 + np.maximum(1.5 * np.abs(x) - 1, 0) ** 2
    np.testing.assert_allclose(total, least, atol=1e-15)


@pytest.mark.parametrize("seed", [0, 1])
def test_no_certified_cost_is_below_the_bound_on_all_controllers(seed):
    rng = np.random.default_rng(seed)
    plant = draws.plant(rng, n=2, m=1, p=2, radius=1.05)
    plant = Plant(plant.A, plant.B)
    spec = Spec(np.eye(2), 0.1, 0.9, Box([-1, -1], [1, 1]), Box(-1, 1))
    floor = bounds.any_controller(plant, spec, cells=200)
    x0 = spec.initial.sample(3000, rng)
    for gain in ([[-0.3, -0.1]], [[-0.6, -0.5]], [[0.0, 0.0]]):
        x, u = oracles.roll_out(plant, INC.saturated(gain, 1.0), x0, 200)
        paid = oracles.discounted_cost(x, u, spec.Q, spec.R, spec.discount)
        assert floor.value <= paid.mean() + 4 * paid.std() / np.sqrt(3000)


def test_a_comparison_separates_nobody_from_all_controllers():
    spec = Spec(1.0, 0.0, 1.0, Box(-1, 1), Box(-1, 1))
    laws = {"clipped": INC.saturated([[-1.5]], 1.0), "gain": [[-1.0]]}
    found = compare(Plant(1.5, 1.0), spec, laws, bounds=["any", "linear"])
    assert found.separates("clipped", "linear") and not found.separates("clipped", "any")
    assert not found.separates("gain", "any") and "prop:no_arbitrary_sof" in str(found)
    with pytest.raises(InvalidInputError):
        found.separates("clipped", "nonlinear static")
