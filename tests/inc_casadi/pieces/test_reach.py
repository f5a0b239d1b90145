"""Reachable sets: attained at every vertex, never left by a motion, and cut into pieces that fill the initial set."""

import numpy as np
import oracles
import pytest
from scipy.spatial import ConvexHull
from walk_draws import EACH_WALK, draw

from inc_casadi import INC, Box, Plant, Polytope, ReLU, Tanh
from inc_casadi.errors import InvalidInputError, NotWellPosedError
from inc_casadi.pieces.reach import reachable
from inc_casadi.pieces.walk import Budget


@EACH_WALK
def test_vertices_are_reached_and_no_motion_leaves_the_boxes(seed):
    plant, inc, claim = draw(seed)
    steps = 4
    sets = reachable(plant, inc, claim.initial, steps)
    assert sets.steps == steps and sets.ended == ""
    x, u = oracles.roll_out(plant, inc, claim.initial.sample(3000, np.random.default_rng(seed)), steps)
    for k in range(steps + 1):
        start, now = np.concatenate(sets.origins(k)), np.concatenate(sets.polytopes(k))
        attained, _ = oracles.roll_out(plant, inc, start.T, k)
        np.testing.assert_allclose(attained[:, :, k].T, now, atol=1e-9 * (1 + np.abs(now).max()))
        room = 1e-9 * (1 + np.abs(now).max())
        assert np.all(x[:, :, k].T >= sets.boxes[k, 0] - room) and np.all(x[:, :, k].T <= sets.boxes[k, 1] + room)
        direction = np.random.default_rng(k).standard_normal(plant.n)
        assert np.max(direction @ x[:, :, k]) <= sets.support(direction, k) + room
    assert np.all(u.min(axis=1)[:, :steps].T >= sets.inputs[:, 0] - 1e-9)
    assert np.all(u.max(axis=1)[:, :steps].T <= sets.inputs[:, 1] + 1e-9)
    assert np.all(sets.inputs[:, 0] >= u.min(axis=1)[:, :steps].T - 0.5 * np.ptp(sets.inputs, axis=1))


def test_every_sample_is_moved_by_the_map_of_its_own_piece():
    plant, inc, claim = draw(2)
    sets = reachable(plant, inc, claim.initial, 3)
    points = claim.initial.sample(500, np.random.default_rng(9))
    x, _ = oracles.roll_out(plant, inc, points, 3)
    cells = sets.stages[3]
    found = np.zeros(500, dtype=int)
    for i in range(len(cells)):
        names = np.unique(cells.facets[cells.owner == i])
        planes, sign = cells.planes[names // 2], np.where(names % 2 == 0, 1, -1)[:, None]
        inside = np.all(sign * (planes[:, :-1] @ points - planes[:, -1:]) <= 1e-9, axis=0)
        image = cells.motion[i, :, :-1] @ (points[:, inside] - cells.center[i][:, None]) + cells.motion[i, :, -1:]
        np.testing.assert_allclose(image, x[:, inside, 3], atol=1e-7)
        found += inside
    assert np.all(found >= 1)


def test_the_origins_fill_the_initial_set():
    plant, inc, claim = draw(1)
    sets = reachable(plant, inc, claim.initial, 3)
    volume = sum(ConvexHull(part).volume for part in sets.origins(3))
    assert volume == pytest.approx(claim.initial.support.volume, rel=1e-9)


def test_by_hand_on_the_scalar_plant():
    """x+ = 1.5 x - sat(1.5 x) maps [-1, 1] onto [-1/2, 1/2] onto {0}."""
    sets = reachable(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0), Box([-1.0], [1.0]), 2)
    np.testing.assert_allclose(sets.boxes[:, :, 0], [[-1, 1], [-0.5, 0.5], [0, 0]], atol=1e-12)
    np.testing.assert_allclose(sets.inputs[:, :, 0], [[-1, 1], [-0.75, 0.75]], atol=1e-12)
    assert sets.box(1).upper == pytest.approx(0.5) and sets.hull(1).vertices.size == 2


def test_budgets_and_what_does_not_apply():
    plant, inc, claim = draw(1)
    few = reachable(plant, inc, claim.initial, 9, budget=Budget(pieces=5))
    assert few.ended == "more than 5 pieces" and few.steps < 9 and max(few.pieces) <= 5
    with pytest.raises(InvalidInputError, match="known for steps 0 to"):
        few.polytopes(9)
    with pytest.raises(InvalidInputError, match="piecewise affine"):
        reachable(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[1.0]], [[1.0]], [[0.0]], activation=Tanh()), Box([-1], [1]), 1)
    with pytest.raises(InvalidInputError, match="sample the plant"):
        reachable(Plant([[0.5]], [[1.0]], dt=0.0), INC.linear([[1.0]]), Box([-1], [1]), 1)
    with pytest.raises(InvalidInputError, match="dimension 2"):
        reachable(Plant([[0.5]], [[1.0]]), INC.linear([[1.0]]), Box([-1, -1], [1, 1]), 1)
    with pytest.raises(NotWellPosedError):
        reachable(Plant([[0.5]], [[1.0]]), INC([[3.0]], [[1.0]], [[1.0]], [[0.0]], activation=ReLU()), Box([-1], [1]), 1)
    heard = []
    reachable(plant, inc, claim.initial, 2, progress=lambda k, pieces: heard.append((k, pieces)))
    assert [k for k, _ in heard] == [1, 2]


def test_a_flat_set_has_a_box_of_zero_width():
    flat = reachable(Plant([[0.0, 1.0], [0.0, 0.0]], [[1.0], [0.0]]), INC.linear([[0.0, 0.0]]),
                     Polytope.from_vertices([[0, 1, 0], [0, 0, 1]]), 1)
    np.testing.assert_allclose(flat.boxes[1], [[0, 0], [1, 0]], atol=1e-12)
