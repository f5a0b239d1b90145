"""A specification is checked at the door, and against the plant it is used with."""

import control
import numpy as np
import pytest

from inc_casadi.errors import DimensionError, INCError, InvalidInputError
from inc_casadi.plant import Plant
from inc_casadi.sets import Box, Ellipsoid, Empirical, Gaussian, Polytope, Uniform
from inc_casadi.spec import Spec

Q = np.diag([1.0, 0.0, 2.0])
R = np.array([[0.1, 0.05], [0.05, 0.3]])
START = Box([-1, -2, -3], [1, 2, 4])
LIMITS = Box([-1, -0.5], [1, 0.7])
PLANT = Plant(np.diag([0.5, 1.2, 1.0]), np.ones((3, 2)), np.ones((1, 3)))


def test_a_complete_specification():
    spec = Spec(Q, R, 0.9, Uniform(START), LIMITS)
    assert (spec.n, spec.m, spec.discount) == (3, 2, 0.9)
    assert spec.inputs is LIMITS and spec.initial.support is START
    assert spec.check(PLANT) is spec
    assert spec.check(control.StateSpace(PLANT.A, PLANT.B, PLANT.C, np.zeros((1, 2)), 1.0)) is spec


@pytest.mark.parametrize("region", [START, Ellipsoid(np.diag([1.0, 2.0, 3.0])), Polytope(START.H, START.h)])
def test_a_bare_set_stands_for_its_uniform_distribution(region):
    initial = Spec(Q, R, 1.0, region).initial
    assert isinstance(initial, Uniform) and initial.support is region


@pytest.mark.parametrize("initial", [Gaussian(np.zeros(3), np.eye(3)), Empirical(np.ones((3, 4)))])
def test_a_distribution_is_taken_as_it_is(initial):
    assert Spec(Q, R, 1.0, initial).initial is initial


def test_the_weights_may_vanish_and_the_discount_may_be_one():
    spec = Spec(np.zeros((3, 3)), np.zeros((2, 2)), 1, START)
    assert spec.discount == 1.0 and not spec.R.flags.writeable


GOOD = {"Q": Q, "R": R, "discount": 0.9, "initial": START, "inputs": LIMITS}


@pytest.mark.parametrize(("change", "error", "message"), [
    ({"Q": Q + np.eye(3, k=1)}, InvalidInputError, "Q is not symmetric"),
    ({"Q": -Q}, InvalidInputError, "Q must be positive semidefinite.* -2"),
    ({"Q": Q[:2]}, DimensionError, r"Q has shape \(2, 3\)"),
    ({"Q": Q * np.nan}, InvalidInputError, "Q holds a NaN"),
    ({"Q": np.zeros((0, 0))}, DimensionError, "Q has shape"),
    ({"R": [[1.0, 2.0], [2.0, 1.0]]}, InvalidInputError, "R must be positive semidefinite.* -1"),
    ({"R": [1.0, 1.0]}, DimensionError, "R has shape"),
    ({"R": np.zeros((0, 0)), "inputs": None}, DimensionError, "R has shape"),
    ({"discount": 0.0}, InvalidInputError, "discount = 0 is outside"),
    ({"discount": 1.1}, InvalidInputError, "discount = 1.1 is outside"),
    ({"discount": np.nan}, InvalidInputError, "discount holds a NaN"),
    ({"discount": [0.5]}, InvalidInputError, "discount must be one number"),
    ({"initial": np.ones((3, 8))}, InvalidInputError, r"not ndarray; points as columns are Empirical"),
    ({"initial": None}, InvalidInputError, "initial distribution must be"),
    ({"initial": LIMITS}, DimensionError, r"initial is a distribution on R\^2"),
    ({"inputs": Ellipsoid(np.eye(2))}, InvalidInputError, "inputs must be a Box.*not Ellipsoid"),
    ({"inputs": (-1, 1)}, InvalidInputError, "inputs must be a Box.*not tuple"),
    ({"inputs": START}, DimensionError, r"inputs is a set in R\^3, but R has shape \(2, 2\)"),
])
def test_a_bad_specification_is_refused(change, error, message):
    with pytest.raises(error, match=message):
        Spec(**(GOOD | change))


def test_the_message_says_what_does_not_fit_the_plant():
    spec = Spec(**GOOD)
    with pytest.raises(DimensionError, match=r"Q has shape \(3, 3\).*4 states"):
        spec.check(Plant(np.eye(4), np.ones((4, 2))))
    with pytest.raises(DimensionError, match=r"R has shape \(2, 2\) and inputs is a set in R\^2.*1 inputs"):
        spec.check(Plant(np.eye(3), np.ones((3, 1))))
    with pytest.raises(DimensionError, match=r"R has shape \(2, 2\), but"):
        Spec(Q, R, 0.9, START).check(Plant(np.eye(3), np.ones((3, 1))))
    with pytest.raises(InvalidInputError, match="a plant must be"):
        spec.check(np.eye(3))


def test_every_refusal_is_an_error_of_the_toolbox():
    with pytest.raises(INCError):
        Spec(**(GOOD | {"discount": "high"}))
