"""The half-spaces of the claim, by hand, and what it refuses."""

from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import Box, Ellipsoid, Plant, Polytope
from inc_casadi.blocks import exact
from inc_casadi.claims import Invariance
from inc_casadi.claims.invariance import Slacks
from inc_casadi.errors import DimensionError, InvalidInputError

PLANT = Plant([[1.0, 0.5], [0.0, 2.0]], [[0.0], [3.0]])
TRIANGLE = Polytope([[-1.0, 0.0], [0.0, -1.0], [1.0, 2.0]], [1.0, 1.0, 1.0])


def test_rows_by_hand():
    claim = Invariance(TRIANGLE, Box([-1.0], [2.0]))
    rows = claim.rows(PLANT)
    assert rows.E.tolist() == [[0, 0], [0, 0], [-1, -0.5], [0, -2], [1, 4.5]]
    assert rows.G.tolist() == [[1], [-1], [0], [-3], [6]] and rows.t.tolist() == [2, 1, 1, 1, 1]
    assert claim.limits == 2 and claim.name(1) == "half-space 1 of the input set"
    assert claim.name(4) == "half-space 2 of the region at the next state"
    assert Invariance(TRIANGLE).rows(PLANT).G.tolist() == [[0], [-3], [6]]


def test_rows_in_other_numbers():
    rows = Invariance(TRIANGLE, Box([-1.0], [2.0])).rows(PLANT, exact)
    assert rows.E[4, 1] == Fraction(9, 2) and rows.G[4, 0] == 6 and rows.E[0, 0] == 0
    sizes = Invariance(TRIANGLE, Box([-1.0], [2.0])).rows(PLANT, np.abs)
    assert sizes.E.tolist() == [[0, 0], [0, 0], [1, 0.5], [0, 2], [1, 4.5]] and sizes.t.tolist() == [2, 1, 1, 1, 1]


def test_what_does_not_fit_is_refused():
    with pytest.raises(InvalidInputError, match="region must be a Box or a Polytope"):
        Invariance(Ellipsoid(np.eye(2)))
    with pytest.raises(InvalidInputError, match="inputs must be a Box, a Polytope or None"):
        Invariance(TRIANGLE, 1.0)
    with pytest.raises(DimensionError, match="R.1, but the plant has 2 states"):
        Invariance(Box([-1.0], [1.0])).check(PLANT)
    with pytest.raises(DimensionError, match="R.2, but the plant has 1 inputs"):
        Invariance(TRIANGLE, Box([-1.0, -1.0], [1.0, 1.0])).check(PLANT)


def test_the_worst_row_is_the_one_that_may_be_smallest():
    unknown = np.full(3, -np.inf)
    found = Slacks(unknown, np.array([3.0, -1.0, 2.0]), np.zeros((3, 1)), "", 0, 0.0)
    assert found.worst() == 1
