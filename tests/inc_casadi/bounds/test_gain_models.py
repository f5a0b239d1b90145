"""On every box the model is a lower bound at every discount, and off by third order only; derivatives by differences."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from gain_draws import draw

from benchmarks.baselines.linear import lyapunov_costs
from inc_casadi import Box, Plant, Spec
from inc_casadi.bounds.gain_algebra import Gains, absolute
from inc_casadi.bounds.gain_contraction import contraction
from inc_casadi.bounds.gain_expansion import expansion, third_order
from inc_casadi.bounds.gain_floor import Floor
from inc_casadi.bounds.gain_halfspaces import HalfSpaces
from inc_casadi.bounds.gain_models import Sizes, models, remainder, source_of

SHAPES = [(3, 2, 1), (2, 1, 2), (4, 2, 2), (1, 1, 1)]


def modelled(plant, spec, centers, widths, b):
    gains = Gains(plant, spec)
    return models(gains, centers, widths, b, contraction(gains, centers, widths))


def values(model, cell, s):
    """The model of one box at points s (k, d)."""
    return model.constant[cell] + s @ model.slope[cell] + np.einsum("ki,ij,kj->k", s, model.curvature[cell], s) / 2


def excesses(plant, spec, center, width, b, rng):
    """J_b minus the model at random gains of one box and at its corners."""
    d = center.size
    model = modelled(plant, spec, center[None], width[None], np.array([b]))
    s = np.vstack([rng.uniform(-1, 1, (200, d)), np.sign(rng.standard_normal((40, d))), np.zeros((1, d))])
    costs = lyapunov_costs(plant, replace(spec, discount=b), (center + width * s).reshape(-1, plant.m, plant.p))
    return costs - values(model, 0, s)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("b", [0.95, 0.6])
def test_the_model_is_below_the_cost_everywhere_in_the_box(shape, b):
    for seed in range(4):
        plant, spec = draw(seed, *shape, radius=0.9)
        rng = np.random.default_rng(seed)
        center = 0.04 * rng.standard_normal(shape[1] * shape[2])
        width = 0.01 * rng.uniform(0.2, 1.0, center.size)
        over = excesses(plant, spec, center, width, b, rng)
        assert np.all(over >= 0) and np.all(np.isfinite(over))


@pytest.mark.parametrize("shape", SHAPES)
def test_halving_a_box_makes_the_error_eight_times_smaller(shape):
    plant, spec = draw(3, *shape)
    rng = np.random.default_rng(7)
    center, width = 0.1 * rng.standard_normal(shape[1] * shape[2]), 0.003 * np.ones(shape[1] * shape[2])
    errors = [np.max(excesses(plant, spec, center, width / k, 0.6, np.random.default_rng(1))) for k in (1, 2, 4)]
    assert errors[0] / errors[1] == pytest.approx(8, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(8, rel=0.1)


def test_unstable_gains_are_bounded_by_smaller_discounts():
    plant, spec = draw(0, 3, 1, 2, radius=1.4)
    center, width = np.array([[0.05, -0.02]]), np.full((1, 2), 0.01)
    gains = Gains(plant, spec)
    shrink = contraction(gains, center, width)
    assert shrink.radius[0] > 1 / spec.discount
    assert np.isinf(modelled(plant, spec, center, width, np.array([spec.discount])).constant[0])
    assert np.all(excesses(plant, spec, center[0], width[0], 0.9 / shrink.radius[0], np.random.default_rng(0)) >= 0)


def test_the_constant_is_below_the_exact_cost_by_rounding_only():
    # 1 / (3 (1 - b (a + F)^2)) in Fractions, on boxes of width 1e-12.
    spec, F = Spec(1.0, 0.0, 1.0, Box(-1, 1), Box(-1, 1)), np.linspace(-2.3, -0.7, 33)
    b = 0.9
    found = modelled(Plant(1.5, 1.0), spec, F[:, None], np.full((33, 1), 1e-12), np.full(33, b))
    second = Fraction(float(spec.initial.second_moment[0, 0]))
    exact = [second / (1 - Fraction(b) * (Fraction(3, 2) + Fraction(float(f))) ** 2) for f in F]
    assert all(Fraction(low) <= true for low, true in zip(found.constant, exact, strict=True))
    np.testing.assert_allclose(found.constant, [float(true) for true in exact], rtol=1e-9)


@pytest.mark.parametrize("shape", SHAPES)
def test_derivatives_are_those_of_the_cost(shape):
    plant, spec = draw(2, *shape, radius=0.8)
    d = shape[1] * shape[2]
    center, h = 0.05 * np.random.default_rng(1).standard_normal(d), 1e-3
    model = modelled(plant, spec, center[None], np.full((1, d), h), np.array([spec.discount]))

    def cost(delta):
        return float(lyapunov_costs(plant, spec, (center + delta).reshape(1, plant.m, plant.p))[0])

    steps = h * np.eye(d)
    slope = [(cost(e) - cost(-e)) / 2 for e in steps]
    curvature = [[(cost(e + f) - cost(e - f) - cost(f - e) + cost(-e - f)) / 4 for f in steps] for e in steps]
    np.testing.assert_allclose(model.slope[0], slope, rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(model.curvature[0], curvature, rtol=1e-2, atol=1e-9)


def test_the_expansion_solves_its_equations_at_each_order():
    plant, spec = draw(1, 3, 2, 2)
    gains, rng = Gains(plant, spec), np.random.default_rng(0)
    center, b = 0.05 * rng.standard_normal((1, 4)), np.array([0.7])
    found = expansion(gains, center, np.ones((1, 4)), b, contraction(gains, center, np.ones((1, 4))).operator)
    i, j = gains.pairs.T

    def left_over(delta):
        G = (center[0] + delta).reshape(2, 2) @ plant.C
        A = plant.A + plant.B @ G
        P = found.P0[0] + np.tensordot(delta, found.P1[0], 1) + np.tensordot(delta[i] * delta[j], found.P2[0], 1)
        return np.linalg.norm(spec.Q + G.T @ spec.R @ G + 0.7 * A.T @ P @ A - P)

    direction = rng.standard_normal(4)
    sizes = [left_over(scale * direction) for scale in (1e-1, 1e-2, 1e-3)]
    assert sizes[0] / sizes[1] == pytest.approx(1000, rel=0.2) and sizes[1] / sizes[2] == pytest.approx(1000, rel=0.02)


def test_the_contraction_holds_for_every_gain_of_the_box():
    plant, spec = draw(4, 4, 2, 2)
    gains, rng = Gains(plant, spec), np.random.default_rng(5)
    center, width = rng.standard_normal((1, 4)), rng.uniform(0.1, 0.5, (1, 4))
    shrink = contraction(gains, center, width)
    for _ in range(50):
        root, s = rng.standard_normal((4, 2)), np.sign(rng.standard_normal(4)) * rng.choice([1.0, 0.7], 4)
        X = root @ root.T
        A = plant.A + plant.B @ (center[0] + width[0] * s).reshape(2, 2) @ plant.C
        i, j = np.triu_indices(4)
        right = np.zeros((4, 4))
        right[i, j] = right[j, i] = shrink.total[0] @ X[i, j]
        assert np.linalg.eigvalsh(right - A.T @ X @ A)[0] > -1e-9 * np.linalg.norm(right)


def test_the_remainder_outweighs_its_source_for_every_gain_of_the_box():
    plant, spec = draw(4, 4, 2, 2, radius=0.6)
    gains, rng, N = Gains(plant, spec), np.random.default_rng(5), 20
    centers, widths, b = 0.1 * rng.standard_normal((N, 4)), rng.uniform(0.03, 0.1, (N, 4)), np.full(N, 0.5)
    shrink = contraction(gains, centers, widths)
    found = expansion(gains, centers, widths, b, shrink.operator)
    source = source_of(gains, found, third_order(gains, found, centers, b), widths, b, shrink)
    R, proved = remainder(gains, widths, b, shrink, source, Sizes(gains, centers, widths, b, shrink.split, found))
    assert np.sum(proved) > 10
    least = np.inf
    for s in np.vstack([np.sign(rng.standard_normal((60, 4))), rng.uniform(-1, 1, (60, 4))]):
        A = plant.A + plant.B @ (centers + widths * s).reshape(N, 2, 2) @ plant.C
        left = R - b[0] * np.swapaxes(A, 1, 2) @ R @ A - source[0]
        low = np.linalg.eigvalsh(left)[:, 0] / np.linalg.norm(source[0], axis=(1, 2))
        least = min(least, float(np.min(low[proved])))
    assert 0 < least < 5


def test_one_matrix_dominates_every_signed_sum():
    rng = np.random.default_rng(2)
    M, weights = rng.standard_normal((3, 7, 4, 4)), rng.uniform(0, 2, (3, 7))
    M = M + np.swapaxes(M, 2, 3)
    X, missed = absolute(M, weights)
    for _ in range(200):
        signs = rng.choice([-1.0, 1.0], 7)
        low = np.linalg.eigvalsh(X - np.einsum("t,Nt,Ntij->Nij", signs, weights, M))[:, 0]
        assert np.all(low >= -missed)
    assert np.all(missed < 1e-6 * np.linalg.norm(X, axis=(1, 2)))
    one = absolute(M[:, :1], weights[:, :1])[0]
    L, V = np.linalg.eigh(M[:, 0])
    np.testing.assert_allclose(one, weights[:, :1, None] * (V * np.abs(L)[:, None]) @ np.swapaxes(V, 1, 2), atol=1e-6)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_convex_floor_is_below_every_gain_and_met_by_the_regulator(shape):
    plant, spec = draw(1, *shape)
    d = shape[1] * shape[2]
    gains = Gains(plant, spec)
    F = 0.3 * np.random.default_rng(0).standard_normal((500, d))
    half = HalfSpaces(F, np.full((500, d), 1e-3), np.zeros((500, 0, d)), np.zeros((500, 0)))
    assert np.all(Floor(gains).on(half) <= lyapunov_costs(plant, spec, F.reshape(-1, plant.m, plant.p)))
    full = Plant(plant.A, plant.B)
    _, g, c = Floor(Gains(full, spec)).floats
    H = Floor(Gains(full, spec)).floats[0]
    best = -np.linalg.solve(H, g)
    cost = float(lyapunov_costs(full, spec, best.reshape(1, full.m, full.n))[0])
    assert c + g @ best == pytest.approx(cost, rel=1e-9)
