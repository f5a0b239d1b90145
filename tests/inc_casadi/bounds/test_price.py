"""Prices on the first inputs: the best inputs under them, bounds of cells with them, in floats and exactly."""

import numpy as np
import pytest

from inc_casadi import Box, Plant, Spec, Uniform
from inc_casadi.blocks import exact
from inc_casadi.bounds.cell_bounds import Trials, cell_bounds
from inc_casadi.bounds.exact_cells import exact_bounds
from inc_casadi.bounds.moves import rollout
from inc_casadi.bounds.partition import partition
from inc_casadi.bounds.pressing import foreseen, responses
from inc_casadi.bounds.price import Price
from inc_casadi.bounds.proposals import propose
from inc_casadi.bounds.sequences import costs, factor, optimal_sequences

N, M, T, R = 3, 2, 4, 2
LIMITS = Box([-0.3, -0.5], [0.4, 0.2])


def draw(seed):
    rng = np.random.default_rng(seed)
    root, last = rng.standard_normal((2, N, N))
    spec = Spec(root @ root.T, np.diag([0.1, 0.3]), 0.9, Box([-0.9, -0.5, -0.7], [0.6, 1.1, 0.4]), LIMITS)
    return Plant(0.6 * rng.standard_normal((N, N)), rng.standard_normal((N, M))), spec, last @ last.T, rng


def priced_cost(plant, spec, P, x0, u, price):
    """Cost and price (c,) of inputs u (T, m, c) from x0 (n, c); price (r, m, c)."""
    return costs(spec, P, rollout(plant.A, plant.B, x0, u), u) + np.sum(price * u[:len(price)], axis=(0, 1))


def foreseen_inputs(plant, spec, P, x0, slopes):
    free = factor(plant, spec, P, LIMITS.H, np.zeros((T, len(LIMITS.H), 1)))
    offsets, bend = foreseen(plant, free, slopes[..., None])
    return np.einsum("tmn,nc->tmc", responses(plant, free.gains, offsets)[..., 0], x0), free.hessian[0] + bend[0]


@pytest.mark.parametrize("seed", range(2))
def test_no_other_inputs_cost_less_under_a_price_that_is_linear_in_the_state(seed):
    plant, spec, P, rng = draw(seed)
    slopes, x0 = rng.standard_normal((R, M, N)), rng.standard_normal((N, 5))
    u, hessian = foreseen_inputs(plant, spec, P, x0, slopes)
    best = priced_cost(plant, spec, P, x0, u, slopes @ x0)
    np.testing.assert_allclose(best, np.sum(x0 * (hessian @ x0), axis=0) / 2, rtol=1e-9)
    for _ in range(20):
        assert np.all(priced_cost(plant, spec, P, x0, u + 1e-3 * rng.standard_normal(u.shape), slopes @ x0) > best)


def test_the_best_sequences_within_limits_under_a_price():
    plant, spec, P, rng = draw(3)
    x0, price = rng.standard_normal((N, 4)), 3 * rng.standard_normal((R, M, 4))
    found = optimal_sequences(plant, spec, LIMITS, P, x0, T, price=price).u
    best = priced_cost(plant, spec, P, x0, found, price)
    for _ in range(100):
        other = LIMITS.lower[:, None] + (LIMITS.upper - LIMITS.lower)[:, None] * rng.random((T, M, 4))
        near = found + 0.01 * (other - found)
        assert np.all(priced_cost(plant, spec, P, x0, near, price) > best - 1e-9)
    assert np.any(found != optimal_sequences(plant, spec, LIMITS, P, x0, T).u)


def on_cells(rng, cells, size=1.0):
    c = cells.probabilities.size
    numbers = size * rng.standard_normal((R, M, c)), size * rng.standard_normal((R, M, N, c))
    return Price(numbers[0], numbers[1], np.zeros((R, M, c)))


def test_the_bound_of_a_cell_is_below_the_least_priced_cost_and_close_to_it():
    plant, spec, P, rng = draw(1)
    cells = partition(Uniform(spec.initial.support), 512)
    shapes, price = cells.shapes, on_cells(rng, cells)
    found = propose(plant, spec, P, np.arange(512), shapes, T, price)
    xi = rng.uniform(-1, 1, (8, N, 512))
    x0 = shapes.centers + np.einsum("nqc,sqc->snc", shapes.spans, xi)
    at = price.at + np.einsum("rmnc,snc->srmc", price.slopes, x0 - shapes.centers)
    flat, flat_at = x0.transpose(1, 0, 2).reshape(N, -1), at.transpose(1, 2, 0, 3).reshape(R, M, -1)
    u = optimal_sequences(plant, spec, LIMITS, P, flat, T, price=flat_at).u
    least = priced_cost(plant, spec, P, flat, u, flat_at).reshape(8, 512)
    mean, error = least.mean(), least.mean(axis=1).std() / np.sqrt(8)
    assert mean - 0.03 * np.abs(least).mean() < found.values.mean() < mean + 4 * error


def test_floats_and_fractions_agree_and_floats_are_lower():
    plant, spec, P, rng = draw(4)
    cells = partition(Uniform(spec.initial.support), 8)
    price, which = on_cells(rng, cells), np.arange(8)
    trials = propose(plant, spec, P, which, cells.shapes, T, price).trials
    values = cell_bounds(plant, spec, P, cells.shapes, trials, price)
    precise = Price(exact(price.at), price.slopes, price.rounding)
    found = exact_bounds(plant, spec, P, cells.shapes, cells.exact(), trials, precise)
    gap = found.astype(float) - values
    assert np.all(gap > 0) and np.all(gap < 1e-11 * (1 + np.abs(values)))
    unsure = Price(price.at, price.slopes, price.rounding + 1e-3)
    assert np.all(cell_bounds(plant, spec, P, cells.shapes, trials, unsure) < values - 1e-4)


def test_halves_of_a_large_batch_keep_their_prices(monkeypatch):
    plant, spec, P, rng = draw(5)
    cells = partition(Uniform(spec.initial.support), 8)
    price = on_cells(rng, cells)
    trials = Trials(np.arange(8), np.zeros((T, M, 8)), np.zeros((T, M, N, 8)))
    whole = cell_bounds(plant, spec, P, cells.shapes, trials, price)
    monkeypatch.setattr("inc_casadi.bounds.cell_bounds._NUMBERS", 1)
    np.testing.assert_allclose(cell_bounds(plant, spec, P, cells.shapes, trials, price), whole, rtol=1e-12)
