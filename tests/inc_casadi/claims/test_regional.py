"""The regional claim at the door."""

import numpy as np
import pytest

from inc_casadi import INC, Box, Ellipsoid, Gaussian, Plant, Polytope, Uniform
from inc_casadi.claims.regional import Regional
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.regional_certificate import certify_region

BOX = Box([-1.0, -2.0, -3.0], [1.0, 2.0, 1.0])


def test_a_bare_set_is_the_uniform_distribution_on_it():
    bare, full = (Regional(region, None, np.eye(3), [[1.0]], 0.5) for region in (BOX, Uniform(BOX)))
    assert isinstance(bare.initial, Uniform) and bare.initial.support is full.initial.support is BOX
    assert bare.discount == 0.5 and Regional(BOX, None, np.eye(3), [[1.0]]).discount == 1.0


@pytest.mark.parametrize("initial", [Gaussian(np.zeros(3), np.eye(3)), Ellipsoid(np.eye(3)),
                                     Uniform(Ellipsoid(np.eye(3))), np.eye(3), None])
def test_what_cannot_be_cut_into_simplices_is_refused(initial):
    with pytest.raises(InvalidInputError, match="initial must be a Box, a Polytope or a Uniform over one"):
        Regional(initial, None, np.eye(3), [[1.0]])


@pytest.mark.parametrize("change, error, message", [
    ({"inputs": 1.0}, InvalidInputError, "inputs must be a Box, a Polytope or None"),
    ({"Q": np.eye(2)}, DimensionError, "Q"),
    ({"Q": -np.eye(3)}, InvalidInputError, "Q must be positive semidefinite"),
    ({"Q": np.triu(np.ones((3, 3)))}, InvalidInputError, "Q is not symmetric"),
    ({"R": np.eye(2)}, DimensionError, "R"),
    ({"R": [[np.nan]]}, InvalidInputError, "R holds a NaN"),
    ({"discount": 0.0}, InvalidInputError, "discount"),
    ({"discount": 1.5}, InvalidInputError, "discount"),
])
def test_what_does_not_fit_names_the_culprit(change, error, message):
    limits = Polytope([[1.0], [-1.0]], [1.0, 2.0])
    good = {"initial": BOX, "inputs": limits, "Q": np.eye(3), "R": [[1.0]], "discount": 0.9}
    Regional(**good)
    with pytest.raises(error, match=message):
        Regional(**(good | change))


def test_a_claim_about_another_plant_is_refused():
    plant, inc = Plant([[0.5, 0.1], [0.0, 0.4]], [[1.0], [2.0]]), INC.linear([[0.0, 0.0]])
    square = Box([-1.0, -1.0], [1.0, 1.0])
    for claim in (Regional(BOX, None, np.eye(3), [[1.0]]), Regional(square, None, np.eye(2), np.eye(2))):
        with pytest.raises(DimensionError, match="plant has 2"):
            certify_region(plant, inc, claim)
