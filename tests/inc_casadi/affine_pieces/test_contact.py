"""Do pieces fill their hull, and agree where they meet: shapes by hand, and faces that do not match."""

import json

import numpy as np
import pytest

from inc_casadi import Box, Plant, Polytope, regions
from inc_casadi.affine_pieces.contact import contacts, require_convex
from inc_casadi.affine_pieces.pieces import collected
from inc_casadi.errors import InvalidInputError
from inc_casadi.inc import INC


def constant(shape, *values):
    return shape, np.zeros((len(values), shape.dimension)), list(values)


A, B, C = Box([0.0, 0.0], [1.0, 2.0]), Box([1.0, 0.0], [3.0, 0.7]), Box([1.0, 0.7], [3.0, 2.0])


def test_the_largest_jump_lies_on_a_part_of_a_face():
    # u jumps by 0.2 + y_2 over the face of A and B, 0 <= y_2 <= 0.7, by less elsewhere; all in output 1.
    pieces = collected([(A, np.zeros((2, 2)), [5.0, 0.0]), (B, [[0.0, 0.0], [0.0, 1.0]], [5.0, 0.2]),
                        (C, np.zeros((2, 2)), [5.0, 0.1])])
    found = contacts(pieces)
    assert found.jump == pytest.approx(0.9) and (found.first, found.second, found.output) == (0, 1, 1)
    assert found.point.tolist() == pytest.approx([1.0, 0.7])
    assert found.pairs.tolist() == [[0, 1], [0, 2], [1, 2]]


@pytest.mark.parametrize("slope", [1.0, -1.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_jump_at_one_end_of_a_face_is_seen(slope, axis):
    shapes = [Box([0.0, 0.0], [1.0, 1.0]), Box([1.0, 0.0], [2.0, 1.0])]
    if axis:
        shapes = [Box(each.lower[::-1], each.upper[::-1]) for each in shapes]
    tilt = [[slope, 0.0]] if axis else [[0.0, slope]]
    found = contacts(collected([constant(shapes[0], 0.0), (shapes[1], tilt, [0.0 if slope > 0 else 1.0])]))
    assert found.jump == pytest.approx(1.0)


def test_pieces_that_meet_in_a_corner_share_no_face():
    corners = [Box([i, j], [i + 1, j + 1]) for i in (0.0, 1.0) for j in (0.0, 1.0)]
    assert contacts(collected([constant(each, 0.0) for each in corners])).pairs.tolist() == [[0, 1], [0, 2], [1, 3], [2, 3]]


def test_faces_in_three_dimensions():
    # A cube under two wedges: the diagonal of the wedges crosses the cube's face.
    cube = Box([0.0, 0.0, 0.0], [1.0, 1.0, 1.0])
    points = np.array([[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1], [0, 0, 2], [1, 0, 2], [0, 1, 2], [1, 1, 2]], float).T
    low, high = Polytope.from_vertices(points[:, [0, 1, 2, 4, 5, 6]]), Polytope.from_vertices(points[:, [1, 2, 3, 5, 6, 7]])
    pieces = collected([constant(cube, 0.0), constant(low, 0.0), (high, [[1.0, 1.0, 0.0]], [-1.0])])
    require_convex(pieces)
    found = contacts(pieces)
    assert found.pairs.tolist() == [[0, 1], [0, 2], [1, 2]]
    assert found.jump == pytest.approx(1.0) and found.point.tolist() == pytest.approx([1.0, 1.0, 1.0])
    assert (found.first, found.second) == (0, 2)


def test_a_piece_within_another_meets_it():
    found = contacts(collected([constant(Box([0.0, 0.0], [3.0, 3.0]), 1.0), constant(Box([1.0, 1.0], [2.0, 2.5]), 1.5)]))
    assert found.jump == pytest.approx(0.5) and found.pairs.tolist() == [[0, 1]]


@pytest.mark.parametrize("gap, refused", [(1e-4, True), (1e-6, True), (1e-9, False), (0.0, False), (-0.3, False)])
def test_how_narrow_a_gap_is_seen(gap, refused):
    pieces = collected([constant(Box([0.0, 0.0], [1.0, 2.0]), 0.0), constant(Box([1.0 + gap, 0.0], [2.0, 2.0]), 0.0)])
    if refused:
        with pytest.raises(InvalidInputError, match="must fill a convex set"):
            require_convex(pieces)
    else:
        require_convex(pieces)


def test_the_point_named_lies_in_no_piece():
    shapes = [Box([0.0, 0.0, 0.0], [1.0, 2.0, 1.0]), Box([1.0, 0.0, 0.0], [2.0, 1.0, 1.0])]
    with pytest.raises(InvalidInputError) as refusal:
        require_convex(collected([constant(each, 0.0) for each in shapes]))
    point = np.array(json.loads(str(refusal.value).split("y = ")[1].split("]")[0] + "]"))
    assert not any(each.contains(point) for each in shapes)
    assert Box([0.0, 0.0, 0.0], [2.0, 2.0, 1.0]).contains(point) and point[0] + point[1] < 3
    assert "0.143 of the volume" in str(refusal.value)  # the hull has 3.5, the boxes 3


def test_regions_keep_their_numbers_and_drop_slivers():
    inc = INC.saturated([[1.0, 0.5]], 1.0)
    found = regions(Plant(np.eye(2), np.ones((2, 1))), inc, Box([-2.0, -1.0], [2.0, 1.0]))
    pieces = collected(found)
    assert pieces.number.tolist() == [0, 1, 2] and len(pieces.owner) == len(found.simplices)
    np.testing.assert_allclose(pieces.original(pieces.corners), found.simplices, atol=1e-14)
    np.testing.assert_array_equal(pieces.gain, found.G)
