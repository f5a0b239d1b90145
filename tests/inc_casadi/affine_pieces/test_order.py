"""Which laws lie above and below: cells by sampling, and a network whose pieces must be cut."""

import numpy as np
import pytest

from inc_casadi import INC, Box, Plant, largest_difference, regions
from inc_casadi.affine_pieces import order as module
from inc_casadi.affine_pieces import represent
from inc_casadi.affine_pieces.order import contradictory, distinct_laws, order
from inc_casadi.affine_pieces.pieces import collected
from inc_casadi.errors import InvalidInputError

SQUARE = Box([-2.0, -2.0], [2.0, 2.0])


def crossing():
    """A network of 16 regions whose own max-min form, the minimum of all laws above each region, is wrong."""
    rng = np.random.default_rng(286)
    sizes = (2, 3, 3, 3, 1)
    layers = zip(sizes[:-1], sizes[1:], strict=True)
    law = INC.from_layers([(rng.normal(size=(b, a)), 0.3 * rng.normal(size=b)) for a, b in layers])
    return law, regions(Plant(np.eye(2), np.ones((2, 1))), law, SQUARE)


def test_absolute_value_by_hand():
    found = order(collected([(Box([-2.0], [0.0]), [[-1.0]], [0.0]), (Box([0.0], [3.0]), [[1.0]], [0.0])]), 0, 1e-9)
    assert found.gain.tolist() == [[-1.0], [1.0]] and found.error < 1e-15
    assert found.above.tolist() == [[True, False], [False, True]] and found.below.all()


def test_a_form_from_pieces_as_they_are_can_be_wrong():
    law, found = crossing()
    x = SQUARE.sample(20_000, np.random.default_rng(0))
    values = found.G[:, 0] @ x + found.g
    corners = found.simplices @ found.G[:, 0].T + found.g[:, 0]
    own = np.take_along_axis(corners, found.which[:, None, None], axis=2)
    above = [np.all((corners >= own - 1e-12)[found.which == i], axis=(0, 1)) for i in range(len(found))]
    plain = np.max([values[rows].min(axis=0) for rows in above], axis=0)
    assert np.max(plain - law(x)[0]) > 0.005 and np.min(plain - law(x)[0]) > -1e-9


def test_such_pieces_are_cut_until_the_form_is_right():
    law, found = crossing()
    made = represent(found)
    assert largest_difference(law, made.inc, SQUARE).value < 1e-13 and made.inc.q >= len(found) - 1
    uncut, cut = collected(found), order(collected(found), 0, 1e-9)
    assert len(cut.above) > len(uncut.corners) and not contradictory(cut.above, cut.below).any()


def test_too_many_cells_are_refused(monkeypatch):
    monkeypatch.setattr(module, "CELLS", 20)
    with pytest.raises(InvalidInputError, match="more than 20 cells"):
        order(collected(crossing()[1]), 0, 1e-9)


def test_laws_that_contradict_are_refused():
    pieces = collected([(Box([0.0], [1.0]), [[0.0]], [0.0]), (Box([1.0], [2.0]), [[0.0]], [1.0])])
    with pytest.raises(InvalidInputError, match="output 0 is no continuous function"):
        order(pieces, 0, 1e-9)


def test_equal_laws_are_one_and_rounding_is_cleared():
    shapes = [Box([float(i)], [i + 1.0]) for i in range(4)]
    laws = zip(shapes, [1.0, 1e-17, 1.0 + 1e-12, -1e-17], [0.0, 1.0, -1.0, 2.0], strict=True)
    gain, _, which = distinct_laws(collected([(shape, [[k]], [d]) for shape, k, d in laws]), 0, 1e-9)
    assert gain.ravel().tolist() == [1.0, 0.0, 1.0 + 1e-12, 0.0] and which.tolist() == [0, 1, 2, 3]
    shifted = collected([(shapes[0], [[1.0]], [0.0]), (shapes[1], [[1.0 + 1e-12]], [0.0]), (shapes[2], [[1.0]], [1e-8])])
    for tol, which in ((1e-9, [0, 0, 1]), (1e-13, [0, 1, 2])):
        assert distinct_laws(shifted, 0, tol)[2].tolist() == which


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("jump", [1e-4, -1e-4])
def test_error_is_how_far_a_law_counted_on_one_side_lies_on_the_other(sign, jump):
    pieces = collected([(Box([0.0], [1.0]), [[0.0]], [0.0]), (Box([1.0], [2.0]), [[sign]], [jump - sign]),
                        (Box([2.0], [3.0]), [[3 * sign]], [jump - 5 * sign])])
    assert order(pieces, 0, 4e-4).error == pytest.approx(1e-4)
    with pytest.raises(InvalidInputError, match="output 0 is no continuous function"):
        order(collected([(Box([0.0], [1.0]), [[sign]], [jump]), (Box([1.0], [2.0]), [[sign]], [0.0])]), 0, 1e-6)


def test_room_that_is_not_needed_is_not_used():
    # On the short piece all three laws are within 5e-3, less than tol.
    pieces = collected([(Box([-1.0], [0.0]), [[0.0]], [0.0]), (Box([0.0], [0.005]), [[1.0]], [0.0]),
                        (Box([0.005], [1.0]), [[2.0]], [-0.005])])
    found = order(pieces, 0, 1e-2)
    assert found.error < 1e-14 and found.above[1].tolist() == [False, True, False]
