"""Hinging hyperplanes: found where a law is a sum of kinks along hyperplanes, and only there."""

import numpy as np
import pytest

from inc_casadi import INC, Box, Plant, regions
from inc_casadi.affine_pieces.contact import contacts
from inc_casadi.affine_pieces.hinges import hinged, hyperplanes
from inc_casadi.affine_pieces.pieces import collected

REGION = Box([-2.0, -1.0, 0.0], [2.0, 1.5, 1.0])


def laws_of(law, region):
    pieces = collected(regions(Plant(np.eye(region.dimension), np.ones((region.dimension, law.m))), law, region))
    return pieces, hyperplanes(pieces, contacts(pieces).pairs, 1e-9)


def one_layer(seed, weights):
    rng = np.random.default_rng(seed)
    weights = np.array(weights)
    q = weights.shape[1]
    return INC.from_layers([(rng.normal(size=(q, 3)), 0.3 * rng.normal(size=q)), (weights, rng.normal(size=len(weights)))])


@pytest.mark.parametrize("seed", range(3))
def test_a_hidden_layer_is_found_again(seed):
    law = one_layer(seed, [[1.0, -2.0, 0.5, 0.25]])
    pieces, table = laws_of(law, REGION)
    found = hinged(pieces, table, 0, 1e-9)
    assert found is not None and len(found.planes) == 4 and found.error < 1e-13
    slope = np.abs(found.weight[:, None] * table.slope[found.planes])
    wanted = np.abs(law.V.T * law.U)
    np.testing.assert_allclose(slope[np.lexsort(slope.T)], wanted[np.lexsort(wanted.T)], atol=1e-12)


def test_each_output_has_its_own_hyperplanes():
    law = one_layer(7, [[1.0, -2.0, 0.0, 0.0, 1.0], [0.0, 1.0, 3.0, 1.0, 0.0]])
    pieces, table = laws_of(law, REGION)
    first, second = (hinged(pieces, table, i, 1e-9) for i in (0, 1))
    assert first is not None and second is not None and len(table.shift) == 5
    assert len(first.planes) == len(second.planes) == 3 and len(np.intersect1d(first.planes, second.planes)) == 1


def test_a_kink_that_ends_is_not_straight():
    # max{0, min{y_1, y_2}}: each of its kinks is a half-line.
    law = INC([[0.0, 0.0], [-1.0, 0.0]], [[1.0, -1.0], [1.0, 0.0]], [[0.0, 1.0]], [[0.0, 0.0]])
    pieces, table = laws_of(law, Box([-1.0, -1.0], [2.0, 1.0]))
    assert table.crossed.any() and hinged(pieces, table, 0, 1e-9) is None


def test_a_kink_of_changing_size_is_not_one_hinge():
    # relu(y_1 - relu(y_2)) - relu(y_1): all hyperplanes straight but one.
    law = INC([[0.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]], [[0.0, 1.0], [1.0, 0.0], [1.0, 0.0]], [[0.0, 1.0, -1.0]],
              [[0.0, 0.0]])
    pieces, table = laws_of(law, Box([-1.0, -1.0], [2.0, 1.0]))
    assert hinged(pieces, table, 0, 1e-9) is None


def test_a_law_that_is_hinged_but_for_a_little_is_so_only_with_tol():
    shapes = [Box([0.0], [1.0]), Box([1.0], [2.0]), Box([2.0], [3.0])]
    pieces = collected([(shapes[0], [[0.0]], [0.0]), (shapes[1], [[1.0]], [-1.0]), (shapes[2], [[0.0]], [1.0 + 1e-5])])
    table = hyperplanes(pieces, contacts(pieces).pairs, 1e-9)
    loose = hyperplanes(pieces, contacts(pieces).pairs, 1e-3)
    found = hinged(pieces, loose, 0, 1e-3)
    assert found is not None and 1e-6 < found.error < 3e-5
    assert hinged(pieces, loose, 0, 1e-7) is None and hinged(pieces, table, 0, 1e-7) is None
