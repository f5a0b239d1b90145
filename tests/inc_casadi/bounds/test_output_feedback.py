"""No controller that measures y = C x undercuts the bound, whatever it remembers; and one nearly reaches it."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import Box, Gaussian, Plant, Polytope, Spec, Uniform
from inc_casadi.bounds import any_controller, any_output_feedback
from inc_casadi.bounds.cells_bound import expected
from inc_casadi.bounds.grid_price import GridPrice
from inc_casadi.bounds.output_feedback import OutputFeedbackBound
from inc_casadi.bounds.partition import partition
from inc_casadi.bounds.unmeasured import UnmeasuredBound, unmeasured
from inc_casadi.bounds.value_iteration import value_iteration
from inc_casadi.errors import InvalidInputError

LAGS = Plant([[0.9, 0.3], [0.0, 0.8]], [[0.1], [0.5]], C=[[1.0, 0.0]])
SPEC = Spec(np.eye(2), [[0.1]], 0.95, Box([-1.0, -2.0], [1.0, 2.0]), Box(-0.8, 0.8))
BOTH = any_output_feedback(LAGS, SPEC, cells=500)


def observed(plant, spec, x, first, steps=200):
    """Costs from the columns of x where u_0 = first(y_0) and then the state, known by now, goes to the clipped regulator."""
    K = value_iteration(plant, spec, 300)[1]
    total = np.zeros(x.shape[1])
    for k in range(steps):
        u = K @ x if k else first(plant.C @ x)
        u = u if spec.inputs is None else np.clip(u, spec.inputs.lower[:, None], spec.inputs.upper[:, None])
        total += spec.discount**k * (np.sum(x * (spec.Q @ x), axis=0) + np.sum(u * (spec.R @ u), axis=0))
        x = plant.A @ x + plant.B @ u
    return total


def nodes(box, counts):
    """Points of equal weight, two in each of so many halved intervals: the mean of a cubic is exact."""
    places = [(np.arange(c // 2)[:, None] + 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3)).ravel() / (c // 2) for c in counts]
    axes = [low + (high - low) * each for low, high, each in zip(box.lower, box.upper, places, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij")).reshape(len(axes), -1)


def test_an_observer_without_noise_comes_close_to_it_and_not_below():
    x = nodes(SPEC.initial.support, (60, 60))
    K = value_iteration(LAGS, SPEC, 300)[1]
    costs = [observed(LAGS, SPEC, x, lambda y, s=s: s * K[:, :1] @ y).mean() for s in (0.8, 0.9, 1.0, 1.1)]
    assert BOTH.value < min(costs) < 1.003 * BOTH.value
    assert any_controller(LAGS, SPEC, cells=100).value < 0.8 * BOTH.value  # most of the gap was the price of not knowing


def test_the_best_first_move_on_a_grid_of_measurements_is_not_below():
    """u_0 chosen for every y_0 from a list: no formula of the bound is used."""
    x = nodes(SPEC.initial.support, (24, 24))
    moves = np.linspace(-0.8, 0.8, 17)
    costs = np.stack([observed(LAGS, SPEC, x, lambda y, u=u: np.full_like(y, u), 100) for u in moves])
    best = costs.reshape(17, 24, 24).mean(axis=2).min(axis=0).mean()
    assert BOTH.value < best < 1.004 * BOTH.value


def test_it_holds_and_is_proved_in_exact_arithmetic():
    exactly = BOTH.exact_value()
    assert isinstance(BOTH, OutputFeedbackBound) and BOTH.holds() and BOTH.prove()
    assert isinstance(exactly, Fraction) and 0 < float(exactly) - BOTH.value < 1e-9 * BOTH.value
    assert not replace(BOTH, value=float(exactly) * (1 + 1e-14)).prove()


def test_without_limits_it_is_the_least_cost_by_hand():
    """A double integrator of which the position is measured: u_0 = K E[x_0 | y_0], and u_k = K x_k afterwards."""
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.0], [1.0]], C=[[1.0, 0.0]])
    spec = Spec(np.eye(2), 1.0, 0.9, Box([-1, -2], [1, 2]))
    bound = any_output_feedback(plant, spec)
    K = value_iteration(plant, spec, 300)[1]
    x = nodes(spec.initial.support, (60, 60))
    true = observed(plant, spec, x, lambda y: K[:, :1] @ y).mean()
    assert isinstance(bound, UnmeasuredBound) and bound.holds() and bound.prove()
    assert bound.value == pytest.approx(true, rel=1e-8) and bound.value < true


def test_a_scalar_that_is_not_measured_at_first():
    """x+ = 2 x + u, seen through a delay of one step: u_0 = 0 is best, so the cost is that of x_0 and of 2 x_0 later on."""
    plant = Plant([[2.0, 0.0], [1.0, 0.0]], [[1.0], [0.0]], C=[[0.0, 1.0]])
    spec = Spec(np.diag([1.0, 0.0]), 0.0, 1.0, Box([-1, -1], [1, 1]))
    bound = any_output_feedback(plant, spec)
    assert bound.value == pytest.approx(5 / 3, rel=1e-8) and bound.value < 5 / 3  # x_0^2 + (2 x_0)^2, then x_2 = 0
    assert unmeasured(plant, replace(spec, initial=Gaussian([0, 0], np.eye(2) / 3))).value == pytest.approx(5 / 3, rel=1e-8)


def test_two_steps_of_ignorance_are_discounted_and_counted_to_the_step():
    """x+ = 2 x + u seen two steps late, beta = 1/2: u_0 = u_1 = 0, so E cost = (1 + 4 beta + 16 beta^2) / 3."""
    plant = Plant([[2.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[1.0], [0.0], [0.0]], C=[[0.0, 0.0, 1.0]])
    spec = Spec(np.diag([1.0, 0.0, 0.0]), 0.0, 0.5, Box([-1, -1, -1], [1, 1, 1]))
    assert unmeasured(plant, spec).value == pytest.approx(7 / 3, rel=1e-8)
    assert unmeasured(plant, replace(spec, R=0.5 * np.eye(1)), steps=2).value == pytest.approx(3 / 3, rel=1e-8)


def test_random_laws_with_memory_never_cost_less():
    rng = np.random.default_rng(0)
    x0 = nodes(SPEC.initial.support, (30, 30))
    for _ in range(12):
        F, H = rng.standard_normal((2, 2)), rng.standard_normal((2, 1))
        K, D = rng.standard_normal((1, 2)), rng.standard_normal(1)
        F *= 0.8 / np.max(np.abs(np.linalg.eigvals(F)))
        x, xi, total = x0, np.zeros((2, x0.shape[1])), np.zeros(x0.shape[1])
        for k in range(120):
            y = LAGS.C @ x
            u = np.clip(K @ np.tanh(xi) + D * y, -0.8, 0.8)
            total += SPEC.discount**k * (np.sum(x**2, axis=0) + 0.1 * u[0] ** 2)
            x, xi = LAGS.A @ x + LAGS.B @ u, F @ xi + H @ y
        assert total.mean() > BOTH.value


def test_the_full_state_measured_in_other_coordinates_leaves_nothing_unknown():
    turned = Plant(LAGS.A, LAGS.B, C=[[1.0, 1.0], [1.0, -1.0]])
    assert any_output_feedback(turned, SPEC, cells=100).value == any_controller(turned, SPEC, cells=100).value


def test_it_is_never_less_than_what_it_is_made_of():
    for C in ([[0.3, 1.0]], [[0.0, 1.0]]):
        plant = Plant(LAGS.A, LAGS.B, C=C)
        bound, full = any_output_feedback(plant, SPEC, cells=100), any_controller(plant, SPEC, cells=100)
        assert bound.holds() and bound.value >= max(unmeasured(plant, SPEC).value, full.value)


def test_two_inputs_three_states_and_a_late_coordinate():
    rng = np.random.default_rng(5)
    A = np.array([[0.9, 0.4, 0.0], [0.1, 0.8, 0.5], [0.0, -0.3, 1.05]])
    plant = Plant(A, rng.standard_normal((3, 2)), C=[[1.0, 0.0, 0.0]])
    spec = Spec(np.eye(3), np.diag([0.1, 0.3]), 0.9, Box([-1, -0.5, 0.0], [0.5, 1.0, 1.5]), Box([-0.5, -0.4], [0.3, 0.6]))
    bound = any_output_feedback(plant, spec, cells=120)
    K = value_iteration(plant, spec, 200)[1]
    x = spec.initial.sample(4000, rng)
    total, now, mean = np.zeros(4000), x, spec.initial.mean[:, None]
    for k in range(150):
        guess = now if k > 1 else now - np.linalg.matrix_power(A, k) @ ((x - mean) * [[0.0], [k == 0], [1.0]])
        u = np.clip(K @ guess, spec.inputs.lower[:, None], spec.inputs.upper[:, None])
        total += spec.discount**k * (np.sum(now**2, axis=0) + np.sum(u * (spec.R @ u), axis=0))
        now = plant.A @ now + plant.B @ u
    assert bound.holds() and bound.prove() and len(bound.price.offsets) == 2
    assert bound.value < total.mean() + 3 * total.std() / 63 < 1.15 * bound.value


def test_any_price_at_all_leaves_a_lower_bound():
    """Numbers are made into prices of mean zero, so wrong ones prove less, and never too much."""
    rng, price = np.random.default_rng(1), BOTH.price
    for scale in (0.01, 1.0):
        other = replace(price, offsets=price.offsets + scale * rng.standard_normal(price.offsets.shape),
                        slopes=price.slopes + scale * rng.standard_normal(price.slopes.shape))
        assert replace(BOTH, price=other).dual()[0] < BOTH.dual()[0]


def test_with_prices_a_cell_is_not_raised_to_the_cost_without_limits():
    cells = partition(Uniform(Box(-1, 1)), 2)
    figures = SPEC, np.eye(1), cells, np.array([2.0, -3.0])
    assert [expected(*figures, priced)[0] for priced in (False, True)] == pytest.approx([7 / 6, -0.5])


def test_prices_have_the_mean_zero_given_the_measurement():
    counts, rng = np.array([4, 2]), np.random.default_rng(2)
    price = GridPrice(LAGS, SPEC.initial.support, counts, rng.standard_normal((1, 1, 8)), rng.standard_normal((1, 1, 2, 8)))
    cells = replace(BOTH.cells, record=BOTH.cells.record.none(1))
    for axis, times in ((0, 3), (1, 4)):
        for _ in range(times):
            cells = cells.halved(cells.leaves, np.full(cells.leaves.size, axis))
    found = price.on(cells, cells.leaves)
    assert price.divides(cells) and np.all(found.slopes[:, :, 0] == 0)
    by_measurement = {}
    for center, at in zip(cells.centroids.T, found.at[0, 0], strict=True):
        by_measurement.setdefault(center[0], []).append(at)
    assert len(by_measurement) == 8 and max(abs(sum(each)) for each in by_measurement.values()) < 1e-14


def test_what_is_seen_but_not_told_has_no_price():
    """y_1 tells x_2 + x_3 and neither of them: a price on u_1 that is a step in x_2 would not have the mean 0 given y_1."""
    plant = Plant([[1.0, 1.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.5]], np.ones((3, 1)), C=[[1.0, 0.0, 0.0]])
    box, counts = Box([-1, -1, -1], [1, 1, 1]), np.array([2, 2, 2])
    numbers = np.random.default_rng(3).standard_normal((2, 1, 8))
    price = GridPrice(plant, box, counts, numbers, np.zeros((2, 1, 3, 8)))
    first, second = price.centered(numbers)[:, 0].reshape(2, 2, 2, 2)
    np.testing.assert_allclose(first.sum(axis=(1, 2)), 0, atol=1e-14)
    assert np.abs(first).max() > 0.1 and not np.any(second) and not np.any(price.hidden[1])


def test_altered_numbers_are_refused():
    group, price = BOTH.trials[0], BOTH.price
    moved = Plant(LAGS.A, LAGS.B, C=[[0.0, 1.0]])
    for fake in (replace(BOTH, value=BOTH.value * (1 + 1e-9)),
                 replace(BOTH, trials=(group.take(np.arange(group.members.size - 1)), *BOTH.trials[1:])),
                 replace(BOTH, price=replace(price, offsets=np.nan * price.offsets)),
                 replace(BOTH, price=replace(price, counts=4 * price.counts)),
                 replace(BOTH, price=replace(price, plant=moved)),
                 replace(BOTH, price=replace(price, box=Box([-1, -2], [1, 2.5]))),
                 replace(BOTH, plant=moved),
                 replace(BOTH, plant=Plant(LAGS.A, LAGS.B))):
        assert not fake.holds() and not fake.prove()


def test_a_price_that_does_not_cancel_out_is_refused_however_low_the_value():
    short = replace(BOTH.price, counts=np.array([1, BOTH.price.offsets.shape[2]]))  # parts that cut through the cells
    for fake in (replace(BOTH, value=0.0, price=short), replace(BOTH, value=0.0, trials=BOTH.trials[:0]),
                 replace(BOTH, value=0.0, trials=(BOTH.trials[0].take(np.arange(1, BOTH.trials[0].members.size)),))):
        assert not fake.holds() and isinstance(fake.exact_value(), str)


def test_a_time_limit_leaves_a_bound():
    bound = any_output_feedback(LAGS, SPEC, seconds=0.0)
    assert bound.holds() and bound.cut_short and bound.value >= unmeasured(LAGS, SPEC).value


def test_other_limits_and_distributions_are_served():
    hexagon = Polytope.from_vertices([[-0.5, 0.5, 0.3, -0.3], [-0.2, 0.1, 0.5, -0.5]])
    two = Plant(LAGS.A, [[0.1, 0.4], [0.5, 0.0]], C=LAGS.C)
    limited = any_output_feedback(two, replace(SPEC, R=np.eye(2), inputs=hexagon), cells=30)
    assert isinstance(limited, OutputFeedbackBound) and limited.holds() and limited.prove()
    corners = Polytope.from_vertices([[-1.0, 1.0, 0.2], [-1.0, 0.3, 1.0]])
    flat = any_output_feedback(LAGS, replace(SPEC, initial=corners), cells=30)
    assert flat.value == any_controller(LAGS, replace(SPEC, initial=corners), cells=30).value
    round_ = any_output_feedback(LAGS, Spec(SPEC.Q, SPEC.R, 0.95, Gaussian([0, 0], np.eye(2)), Box(-8, 8)), cells=30)
    assert isinstance(round_, UnmeasuredBound) and round_.prove()


def test_continuous_time_is_refused():
    with pytest.raises(InvalidInputError, match="continuous"):
        any_output_feedback(Plant(LAGS.A, LAGS.B, C=LAGS.C, dt=0.0), SPEC)
