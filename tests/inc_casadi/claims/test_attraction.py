"""The noun of a region of attraction: what it accepts, what it refuses, and how it measures an ellipsoid."""

from __future__ import annotations

import numpy as np
import pytest

from inc_casadi import INC, Box, Plant
from inc_casadi.claims import Attraction
from inc_casadi.errors import DimensionError, InvalidInputError

PLANT = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
LAW = INC.saturated([[-0.5, -1.5]], 1.0)


def test_the_shape_follows_from_the_directions():
    assert Attraction().shape == "volume"
    assert Attraction(directions=[[1.0], [0.0]]).shape == "reach"
    assert Attraction(directions=[[1.0], [0.0]], shape="mean").shape == "mean"


@pytest.mark.parametrize(("given", "names"), [
    ({"shape": "volume", "directions": [[1.0]]}, "takes no directions"),
    ({"shape": "mean"}, "needs directions"),
    ({"shape": "big"}, "'big'"),
    ({"directions": [[1.0, 0.0], [0.0, 0.0]]}, "zero column, number 1"),
    ({"directions": np.zeros((2, 0))}, "no column"),
    ({"Q": [[1.0]]}, "R is missing"),
    ({"R": [[1.0]]}, "Q is missing"),
    ({"Q": [[-1.0]], "R": [[1.0]]}, "Q must be positive semidefinite"),
    ({"discount": 0.0}, "discount"),
    ({"rate": 0.0}, "rate"),
    ({"inputs": [1.0]}, "inputs must be"),
    ({"states": 1.0}, "states must be"),
])
def test_what_makes_no_sense_is_refused_by_name(given, names):
    with pytest.raises(InvalidInputError, match=names):
        Attraction(**given)


@pytest.mark.parametrize("given", [
    {"inputs": Box([-1, -1], [1, 1])}, {"states": Box([-1], [1])}, {"Q": np.eye(3), "R": np.eye(1)},
    {"Q": np.eye(2), "R": np.eye(2)}, {"directions": np.ones((3, 1))},
])
def test_what_does_not_fit_the_plant_is_refused_by_name(given):
    with pytest.raises(DimensionError, match="|".join(given)):
        Attraction(**given).check(PLANT, LAW)


def test_a_rate_of_one_and_a_cost_in_continuous_time_are_refused():
    with pytest.raises(InvalidInputError, match="rate = 1"):
        Attraction(rate=1.0).check(PLANT, LAW)
    flow = Plant(PLANT.A, PLANT.B, dt=0.0)
    Attraction(rate=1.0).check(flow, LAW)
    with pytest.raises(InvalidInputError, match="discrete"):
        Attraction(Q=np.eye(2), R=np.eye(1)).check(flow, LAW)


def test_merits_are_those_of_the_ellipsoid():
    P = np.diag([4.0, 0.25])
    assert Attraction().merit(P) == pytest.approx(0.0)
    assert Attraction(directions=np.eye(2)).merit(P) == pytest.approx(0.5)
    assert Attraction(directions=np.eye(2), shape="mean").merit(P) == pytest.approx((4.25 / 2) ** -0.5)
    assert Attraction().merit(-np.eye(1)) == -np.inf and Attraction(directions=[[1.0]]).merit(-np.eye(1)) == -np.inf
