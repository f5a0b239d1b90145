"""The first box holds what it should, boxes and half-spaces lose no admissible gain, and minima are never overstated."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from gain_draws import admissible, draw, longest
from scipy.optimize import linprog, minimize

from inc_casadi import Box, Empirical, Plant, Spec
from inc_casadi.bounds.gain_algebra import Gains
from inc_casadi.bounds.gain_box import first_box
from inc_casadi.bounds.gain_cells import boxes, cell_bounds, placed
from inc_casadi.bounds.gain_halfspaces import HalfSpaces, narrowed
from inc_casadi.bounds.gain_later_moves import later_moves
from inc_casadi.bounds.gain_limits import GainLimits, anchors
from inc_casadi.bounds.gain_quadratics import lowest
from inc_casadi.bounds.gain_upper import keeps
from inc_casadi.bounds.halvings import Halvings
from inc_casadi.errors import InfeasibleError, InvalidInputError


def limited(plant, spec, moves=0):
    return GainLimits(Gains(plant, spec), anchors(spec.initial, 0), moves)


@pytest.mark.parametrize("d, k", [(1, 2), (2, 3), (4, 6), (3, 0)])
def test_minima_of_quadratics_are_never_overstated_and_nearly_met(d, k):
    rng = np.random.default_rng(d)
    N = 40
    root = rng.standard_normal((N, d, d))
    curvature = root @ np.swapaxes(root, 1, 2) - (0.2 if d == 2 else 0.0) * np.eye(d)
    slope, rows, room = rng.standard_normal((N, d)), rng.standard_normal((N, k, d)), rng.uniform(0.1, 1, (N, k))
    found = lowest(slope, curvature, rows, room)
    assert np.all(lowest(slope, curvature, rows, room, sweeps=0) <= found + 1e-1 * (1 + np.abs(found)))
    s, errors, patient = rng.uniform(-1, 1, (4000, d)), [], lowest(slope, curvature, rows, room, sweeps=1000)
    for i in range(N):
        inside = s[np.all(s @ rows[i].T <= room[i], axis=1)]
        values = inside @ slope[i] + np.einsum("ki,ij,kj->k", inside, curvature[i], inside) / 2
        assert found[i] <= np.min(values, initial=np.inf)
        if d != 2:
            best = minimize(lambda x, i=i: x @ slope[i] + x @ curvature[i] @ x / 2, np.zeros(d), bounds=[(-1, 1)] * d,
                            constraints=[{"type": "ineq", "fun": lambda x, i=i: room[i] - rows[i] @ x}] if k else [])
            errors.append((best.fun - patient[i]) / (1 + abs(best.fun)))
    assert d == 2 or -1e-7 < min(errors) and max(errors) < 0.05 and np.quantile(errors, 0.9) < 1e-5


def test_a_concave_quadratic_is_bounded_by_its_corners():
    assert lowest(np.zeros((1, 1)), np.full((1, 1, 1), -2.0), np.zeros((1, 0, 1)), np.zeros((1, 0)))[0] == pytest.approx(-1)


def test_the_first_box_is_the_one_of_linear_programs():
    plant, spec = draw(0, 3, 2, 2)
    limits = limited(plant, spec)
    box = first_box(limits, 1e6)
    assert box.reason(limits) == "" and not np.any(box.by_cost) and box.level == np.inf
    rows = np.array([np.kron(h, plant.C @ v) for h in spec.inputs.H for v in spec.initial.vertices.T])
    right = np.repeat(spec.inputs.h, spec.initial.vertices.shape[1])
    true = [[linprog(s * e, rows, right, bounds=(None, None)).fun * s for e in np.eye(4)] for s in (1, -1)]
    np.testing.assert_allclose([box.lower, box.upper], true, rtol=1e-6)
    assert np.all(box.lower <= true[0]) and np.all(box.upper >= true[1])


def test_without_limits_the_first_box_is_bounded_by_cost():
    plant, spec = draw(0, 3, 2, 2)
    spec = replace(spec, inputs=None)
    limits = GainLimits(Gains(plant, spec), np.zeros((3, 0)), 0)
    H, g, c = limits.floor.floats
    level = 2 * (c - g @ np.linalg.solve(H, g))
    box = first_box(limits, level)
    assert box.reason(limits) == "" and np.all(box.by_cost) and box.level == level
    rng = np.random.default_rng(0)
    directions = rng.standard_normal((2000, 4))
    f = -np.linalg.solve(H, g)
    edge = f + directions * np.sqrt((level / 2) / np.einsum("ki,ij,kj->k", directions, H, directions))[:, None]
    assert np.all((edge >= box.lower) & (edge <= box.upper))
    for j, e in enumerate(np.eye(4)):  # tangent to the level set at both ends
        touch = np.linalg.solve(H, e) * np.sqrt((level / 2) / np.linalg.inv(H)[j, j])
        np.testing.assert_allclose([(f + touch)[j], (f - touch)[j]], [box.upper[j], box.lower[j]], rtol=1e-6)


def test_an_altered_first_box_is_refused():
    plant, spec = draw(0, 3, 2, 2)
    limits = limited(plant, spec)
    box = first_box(limits, 1e6)
    assert "imply" in replace(box, upper=box.upper - 1e-6).reason(limits)
    assert "imply" in replace(box, lower=box.lower + 1e-6).reason(limits)
    assert "negative" in replace(box, multipliers=box.multipliers - 1e-6).reason(limits)
    assert box.reason(limits) == "" and replace(box, multipliers=0 * box.multipliers).reason(limits)
    by_cost = first_box(GainLimits(Gains(plant, replace(spec, inputs=None)), np.zeros((3, 0)), 0), 50.0)
    free = GainLimits(Gains(plant, replace(spec, inputs=None)), np.zeros((3, 0)), 0)
    assert by_cost.reason(free) == ""
    assert "cost" in replace(by_cost, upper=by_cost.upper - 1e-6).reason(free)
    assert "cost" in replace(by_cost, level=51.0).reason(free)


def test_a_box_that_nothing_bounds_and_one_that_is_empty_are_refused():
    unpriced = Spec(np.diag([1.0, 0.0]), 0.0, 0.9, Box([-1, -1], [1, 1]))
    blind = Plant([[0.5, 0.0], [0.0, 0.5]], [[0.0], [1.0]])  # the cost does not see the input
    with pytest.raises(InvalidInputError, match="neither the input limits nor the cost"):
        first_box(GainLimits(Gains(blind, unpriced), np.zeros((2, 0)), 0), 1.0)
    with pytest.raises(InfeasibleError, match="keeps the input limits"):
        first_box(limited(blind, replace(unpriced, inputs=Box(1, 2))), 1.0)


def test_cut_boxes_leave_nothing_out():
    plant, spec = draw(0, 3, 1, 2)
    box = first_box(limited(plant, spec), 1e6)
    record, rng = Halvings.none(1), np.random.default_rng(0)
    for _ in range(60):
        record = record.more(rng.choice(record.leaves, 1), rng.integers(0, 2, 1))
    centers, widths = boxes(box, record)
    exact = sum(np.prod([Fraction(float(w)) for w in width]) for width in widths)
    whole = np.prod([Fraction(float(w)) for w in (box.upper - box.lower) / 2])
    assert 1 < exact / whole < 1 + Fraction(1, 10**9)
    points = box.lower + (box.upper - box.lower) * rng.random((5000, 2))
    inside = np.all(np.abs(points[:, None] - centers) <= widths, axis=2)
    assert np.all(inside.any(axis=1))
    # both ends and points on the cuts themselves
    ends = np.stack([centers - widths, centers + widths]).reshape(-1, 2)
    ends = np.clip(ends, box.lower, box.upper)
    assert np.all(np.all(np.abs(ends[:, None] - centers) <= widths, axis=2).any(axis=1))


def test_narrowing_keeps_every_admissible_gain():
    rng = np.random.default_rng(1)
    N, k, d = 300, 5, 3
    half = HalfSpaces(rng.standard_normal((N, d)), rng.uniform(0.1, 1, (N, d)), rng.standard_normal((N, k, d)),
                      rng.uniform(-1.5, 2, (N, k)))
    less, empty = narrowed(half)
    assert 0 < np.sum(empty) < N and np.mean(np.prod(less.widths / half.widths, axis=1)[~empty]) < 0.95
    delta = half.widths[:, None] * rng.uniform(-1, 1, (N, 2000, d))
    kept = np.all(np.einsum("Nkd,Nsd->Nsk", half.rows, delta) <= half.room[:, None], axis=2)
    F = half.centers[:, None] + delta
    near = np.all(np.abs(F - less.centers[:, None]) <= less.widths[:, None], axis=2)
    assert not np.any(kept[empty]) and np.all(near[kept])
    moved = np.einsum("Nkd,Nsd->Nsk", less.rows, F - less.centers[:, None])
    np.testing.assert_allclose((moved - less.room[:, None])[kept], np.einsum(
        "Nkd,Nsd->Nsk", half.rows, delta)[kept] - np.repeat(half.room[:, None], 2000, axis=1)[kept], atol=1e-9)


def test_later_moves_demand_nothing_of_gains_that_keep_the_limits():
    plant, spec = draw(3, 3, 2, 2, radius=1.1)
    rng, points = np.random.default_rng(0), spec.initial.vertices
    centers, widths = 0.3 * rng.standard_normal((60, 4)), np.full((60, 4), 0.05)
    half = later_moves(Gains(plant, spec), points, spec.inputs.h, 6, centers, widths)
    binding = 0
    for i in range(60):
        for s in rng.uniform(-1, 1, (20, 4)):
            F = (centers[i] + widths[i] * s).reshape(2, 2)
            left = half.room[i] - half.rows[i] @ (widths[i] * s)
            x, exceeded = points, []
            for _ in range(6):
                x = (plant.A + plant.B @ F @ plant.C) @ x
                exceeded.append((spec.inputs.H @ F @ plant.C @ x - spec.inputs.h[:, None]).ravel())
            over = np.concatenate(exceeded)
            assert np.all(left >= -over - 1e-12)  # what is left is never less than what the trajectory leaves
            binding += int(np.any(left < 0))
    assert binding > 20


def test_later_moves_are_exact_up_to_second_order():
    plant, spec = draw(3, 3, 2, 2)
    rng, points = np.random.default_rng(0), spec.initial.vertices
    center, s = 0.1 * rng.standard_normal((1, 4)), np.array([0.3, -1.0, 0.5, 1.0])
    errors = []
    for width in (1e-2, 1e-3):
        half = later_moves(Gains(plant, spec), points, spec.inputs.h, 5, center, np.full((1, 4), width))
        F, x, over = (center[0] + width * s).reshape(2, 2), points, []
        for _ in range(5):
            x = (plant.A + plant.B @ F @ plant.C) @ x
            over.append((spec.inputs.H @ F @ plant.C @ x - spec.inputs.h[:, None]).ravel())
        errors.append(np.max(half.room[0] - half.rows[0] @ (width * s) + np.concatenate(over)))
    assert errors[0] / errors[1] == pytest.approx(100, rel=0.1)


def test_whether_a_gain_keeps_the_limits_for_ever_is_what_trajectories_say():
    answers = []
    for seed in range(8):
        plant, spec = draw(seed, 3, 1, 2, radius=0.9)
        limits = limited(plant, spec)
        for F in np.random.default_rng(seed).uniform(-0.5, 0.5, (8, 1, 2)):
            over = longest(plant, spec, F, spec.initial.vertices)
            if abs(over) > 1e-6 and np.max(np.abs(np.linalg.eigvals(plant.A + plant.B @ F @ plant.C))) < 0.995:
                assert keeps(limits, F) == (over < 0)
                answers.append(over < 0)
    assert 8 < sum(answers) < len(answers) - 8


def test_a_mode_that_is_not_seen_may_do_what_it_likes():
    plant = Plant(np.diag([1.5, 0.9]), [[1.0], [0.0]], [[1.0, 0.0]])
    spec = Spec(np.eye(2), 0.0, 0.9, Box([-1, -1], [1, 1]), Box(-1, 1))
    assert keeps(limited(plant, spec), np.array([[-1.0]]))
    assert not keeps(limited(plant, spec), np.array([[-1.001]]))
    assert not keeps(limited(plant, spec), np.array([[-0.4]]))  # unstable


def test_bounds_of_cells_hold_for_every_admissible_gain_in_them():
    from benchmarks.baselines.linear import lyapunov_costs

    plant, spec = draw(2, 3, 1, 2)
    limits = limited(plant, spec)
    box = first_box(limits, 1e6)
    rng = np.random.default_rng(0)
    for depth in (1, 3, 5):
        places = np.zeros((4**depth, 2, 2), dtype=np.int64)
        places[:, 0] = depth
        places[:, 1] = np.indices((2**depth, 2**depth)).reshape(2, -1).T
        centers, widths = placed(box, places)
        found = cell_bounds(limits, centers, widths, np.inf)
        hit = 0
        for i in range(len(places)):
            gains = admissible(plant, spec, spec.initial.vertices, centers[i] - widths[i], centers[i] + widths[i], 200, rng)
            assert not len(gains) or np.min(lyapunov_costs(plant, spec, gains)) >= found.value[i]
            hit += len(gains) > 0
        assert hit > 0
    assert np.sum(np.isinf(found.value)) > 50  # boxes without admissible gains


def test_anchors_are_vertices_or_points_that_occur():
    two = Empirical(np.array([[1.0, -2.0], [0.5, 1.0]]))
    assert anchors(two, 0).shape == (2, 2)
    wide = Spec(np.eye(10), 1.0, 0.9, Box(-np.ones(10), np.arange(1.0, 11.0))).initial
    points = anchors(wide, 0)
    assert points.shape[0] == 10 and np.all(wide.support.contains(points)) and points.shape[1] < 400
