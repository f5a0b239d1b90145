"""Bounds on eta and u over boxes: never exceeded by samples, close where they must be, sound for every kind of W."""

from fractions import Fraction

import draws
import numpy as np
import posed
import pytest

from inc_casadi import INC, Identity, LeakyReLU, Logistic, ReLU, Saturation, Tanh
from inc_casadi.errors import DimensionError, NotWellPosedError
from inc_casadi.output_bounds import Boxes, Law, Simplices, bounds_on, enclosure, output_forms, upper_bounds
from inc_casadi.output_bounds.interval import enclose

UNITS = (ReLU(), LeakyReLU(0.3), Tanh(), Saturation(), Logistic(), Identity())


def laws(seed):
    """Laws of each kind: contracting, feedforward, and with a multiplier T only."""
    rng = np.random.default_rng(seed)
    yield draws.controller(rng, m=2, p=3, units=UNITS, gain=1.0, norm=0.9, bias=0.5)
    deep = draws.controller(rng, m=2, p=3, units=UNITS, gain=1.0, bias=0.5)
    yield INC(5 * np.tril(deep.W, -1), deep.U, deep.V, deep.K, deep.b, deep.d, UNITS)
    yield posed.controller(rng, (ReLU(), Saturation(), LeakyReLU(0.2)), kind="symmetric")
    yield posed.controller(rng, (ReLU(), Saturation(), LeakyReLU(0.2)), kind="skew")


def inside(rng, boxes, count=200):
    share = rng.random((len(boxes), count, boxes.lower.shape[1]))
    share[:, : count // 2] = np.round(share[:, : count // 2])  # corners
    return boxes.lower[:, None] + share * (boxes.upper - boxes.lower)[:, None]


@pytest.mark.parametrize("width", [3.0, 0.3, 1e-3, 0.0])
@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))])
def test_no_sample_leaves_the_bounds(seed, width):
    rng = np.random.default_rng(100 + seed)
    C = rng.normal(size=(3, 2))
    for inc in laws(seed):
        lower = rng.normal(size=(30, 2))
        boxes = Boxes(lower, lower + width * rng.uniform(0.1, 1, size=(30, 2)))
        x = inside(rng, boxes)
        y = C @ x.reshape(-1, 2).T
        u, eta = inc(y).T.reshape(30, -1, 2), inc.hidden(y).T.reshape(30, -1, inc.q)
        low, high = bounds_on(inc, C, boxes)
        room = 1e-11 * (1 + np.abs(u))  # of the samples: fixed points are solved to 1e-12
        assert np.all(low[:, None] <= u + room) and np.all(u - room <= high[:, None])
        for box in (enclose(Law(inc, C), boxes.low, boxes.high), enclosure(Law(inc, C), boxes)):
            room = 1e-11 * (1 + np.abs(eta))
            assert np.all(box.eta_low[:, None] <= eta + room) and np.all(eta - room <= box.eta_high[:, None])


@pytest.mark.parametrize("which", range(4))
def test_small_boxes_are_bounded_to_second_order(which):
    inc = list(laws(9))[which]
    C, middle = np.array([[1.0, 0.2], [-0.3, 1.0], [0.5, -0.5]]), np.array([[0.31, -0.17]])
    excess = []
    for half in (1e-2, 1e-3):
        boxes = Boxes(middle - half, middle + half)
        u = inc(C @ inside(np.random.default_rng(0), boxes, 4000)[0].T)
        low, high = bounds_on(inc, C, boxes)
        excess.append(max(np.max(high[0] - u.max(axis=1)), np.max(u.min(axis=1) - low[0])))
    assert excess[1] < 1e-4 and excess[1] < excess[0] / 30 + 1e-9


def test_one_pattern_is_bounded_exactly_whatever_w_is():
    inc = INC([[-3.0]], [[1.0]], [[1.0]], [[0.5]])  # u = 0.75 x for x > 0, although Perron-Frobenius fails
    low, high = bounds_on(inc, np.eye(1), Boxes(np.array([[1.0]]), np.array([[2.0]])))
    assert (low.item(), high.item()) == pytest.approx((0.75, 1.5), abs=1e-9)
    assert low.item() <= 0.75 and high.item() >= 1.5


def test_what_units_have_in_common_is_kept():
    """x+ - (-x)+ - x is 0; intervals alone would give twice the width."""
    inc = INC(np.zeros((2, 2)), [[1.0], [-1.0]], [[1.0, -1.0]], [[-1.0]])
    low, high = bounds_on(inc, np.eye(1), Boxes(np.array([[1.0], [-2.0]]), np.array([[9.0], [-1.0]])))
    assert np.abs(low).max() < 1e-12 and np.abs(high).max() < 1e-12


def test_built_in_limits_are_not_exceeded():
    law = INC.saturated([[2.0, 1.0]], 0.5)
    low, high = bounds_on(law, np.eye(2), Boxes(-np.ones((1, 2)), 3 * np.ones((1, 2))))
    assert -0.5 - 1e-13 < low.item() <= -0.5 and 0.5 <= high.item() < 0.5 + 1e-13


def test_simplices_are_bounded_at_their_corners():
    """Over a simplex a linear law is extreme at corners, where the box around it is larger."""
    law = Law(INC.linear([[1.0, 1.0]]), np.eye(2))
    none, one = np.zeros((1, 2)), np.eye(1)
    forms = output_forms(law, none, one, np.zeros(1), none, one)
    triangle = Simplices.of(np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]]))
    assert upper_bounds(law, forms, triangle).bound.item() == pytest.approx(1.0)
    assert upper_bounds(law, forms, Boxes(np.zeros((1, 2)), np.ones((1, 2)))).bound.item() == pytest.approx(2.0)


def test_halves_of_simplices_cover_them_to_the_last_bit():
    rng = np.random.default_rng(3)
    cells = Simplices.of(rng.normal(size=(2, 3, 2)))
    whole = cells
    for _ in range(9):
        cells = cells.halves(rng.random((len(cells), 2)), np.ones(2))
    assert len(cells) == 2 * 2**9 and np.all(cells.shares.sum(axis=2) == 1.0)
    sizes = np.abs(np.linalg.det(cells.shares))
    assert sizes == pytest.approx(2.0**-9, rel=1e-12)
    assert np.all(cells.low >= whole.low.min(axis=0) - 1e-12) and cells.divisible().all()


def test_rounded_corners_are_allowed_for_where_they_cancel():
    """A corner at the middle of a long edge: its coordinates are tiny, the rounding in computing them is not."""
    third = 1e6 / 3
    edge = Simplices(np.array([[[-third], [third * (1 + 2e-16)]]]), np.zeros(1, int), np.array([[[0.5, 0.5], [0.5, 0.5]]]))
    top = (Fraction(-third) + Fraction(third * (1 + 2e-16))) / 2
    slope = np.full((1, 1, 1), 0.3)
    assert Fraction(edge.most(slope).item()) >= Fraction(0.3) * top and edge.most(slope).item() > 1e-12
    assert Fraction(edge.low.item()) <= top <= Fraction(edge.high.item())


def test_cells_are_halved_until_floats_end():
    cells = Simplices.of(np.array([[[0.0], [1.0]]]))
    depth = 0
    while cells.divisible().all():
        cells, depth = cells.halves(np.ones((1, 1)), np.ones(1)).take(np.array([0])), depth + 1
    assert depth == 49 and cells.corners[0, 1, 0] == 2.0**-49
    tiny = Boxes(np.array([[1.0]]), np.array([[1.0 + 1e-15]]))
    assert not tiny.divisible().any()


def test_what_does_not_fit_is_refused():
    with pytest.raises(DimensionError, match="C has 1 columns"):
        bounds_on(INC.linear([[1.0]]), np.eye(1), Boxes(np.zeros((1, 2)), np.ones((1, 2))))
    with pytest.raises(NotWellPosedError, match="not proved well posed"):
        bounds_on(INC([[2.0]], [[1.0]], [[1.0]], [[0.0]]), np.eye(1), Boxes(np.zeros((1, 1)), np.ones((1, 1))))
