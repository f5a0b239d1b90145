"""What is said to rule out a certificate does rule it out, and nothing is said of loops that have one."""

import re

import draws
import numpy as np
import pytest

from inc_casadi import (
    INC,
    Attraction,
    Box,
    Budget,
    DeviationCost,
    DiscountedCost,
    L2Gain,
    Margins,
    Plant,
    Regional,
    ReLU,
    Robust,
    Saturation,
    Stability,
    Tanh,
    Together,
    certify,
)
from inc_casadi.errors import InvalidInputError, NotCertifiedError
from inc_casadi.hindrance import hindrance, linearization
from inc_casadi.uncertainty import InputSector

UNSTABLE = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
CLIPPED = INC.saturated([[-1.1, -2.0]], 1.0)
COST = DiscountedCost(np.eye(2), [[0.1]], 0.98, Box([-1, -1], [1, 1]))


def test_a_bounded_law_on_an_unstable_plant_is_named_with_its_way_out():
    refused = certify(UNSTABLE, CLIPPED, Stability(), multiplier="sector")
    assert refused.reason.startswith("there is no such certificate: the plant alone has spectral radius 1.1, not below 1")
    assert str(refused).endswith("Regional and Attraction claim something about a set.")


def test_a_law_that_does_not_stabilize_is_named_with_its_equilibrium():
    law = INC.linear([[-0.02, -0.1]])
    law = INC(law.W, law.U, law.V, law.K, d=[0.3])
    refused = certify(UNSTABLE, law, Stability(), multiplier="sector")
    radius = np.max(np.abs(np.linalg.eigvals(UNSTABLE.A + UNSTABLE.B @ law.K)))
    rest = np.linalg.solve(np.eye(2) - UNSTABLE.A - UNSTABLE.B @ law.K, UNSTABLE.B @ [0.3])
    assert f"x* = [{rest[0]:.6g}, {rest[1]:.6g}] the loop has spectral radius {radius:.6g}, not below 1" in refused.reason
    assert refused.advice == ""


@pytest.mark.parametrize(("plant", "law", "growth", "named"), [
    (Plant(0.9, 1.0), INC.linear([[0.0]]), 0.8, "spectral radius 0.9, not below 0.8"),
    (Plant(0.9, 1.0), INC.linear([[0.0]]), 0.95, ""),
    (Plant(-0.2, 1.0, dt=0), INC.linear([[0.5]]), 0.0, "an eigenvalue of real part 0.3, not below 0"),
    (Plant(-0.2, 1.0, dt=0), INC.linear([[0.0]]), -0.1, ""),
    (Plant(1.5, 1.0), INC([[0.0]], [[1.0]], [[-1.0]], [[0.0]], activation=Tanh()), 1.0, "the law is bounded"),
    (Plant(1.5, 1.0), INC([[0.0]], [[1.0]], [[-1.0]], [[-0.1]], activation=Tanh()), 1.0, ""),
    (Plant(1.5, 1.0), INC([[0.0]], [[1.0]], [[-1.0]], [[0.0]], activation=ReLU()), 1.0, ""),
    (Plant(1.5, 1.0), INC(np.zeros((2, 2)), [[1.0], [1.0]], [[-1.0, 0.0]], [[0.0]], activation=[Saturation(), ReLU()]), 1.0,
     "the law is bounded"),
])
def test_both_sides_of_each_edge(plant, law, growth, named):
    found = hindrance(plant, law, growth)
    assert named in found and bool(named) == bool(found)


def test_where_the_law_has_no_derivative_nothing_is_concluded():
    law = INC([[0.0]], [[1.0]], [[-1.0]], [[0.0]])  # u = -max(x, 0)
    assert linearization(Plant(0.5, 1.0), law) is None
    away = INC([[0.0]], [[1.0]], [[-1.0]], [[0.0]], b=[1.0])
    assert linearization(Plant(0.5, 1.0), away)[0] == pytest.approx(-0.5)


def test_what_each_claim_allows_motions_to_grow_by():
    assert (Stability().growth(True), Stability().growth(False)) == (1.0, 0.0)
    assert (Stability(0.9).growth(True), Stability(0.6).growth(False)) == (0.9, -0.3)
    assert COST.growth(True) == DeviationCost(COST.Q, COST.R, 0.98, COST.initial).growth(True) == 0.98**-0.5
    assert COST.growth(False) == pytest.approx(-np.log(0.98) / 2)
    assert L2Gain([[1.0], [0.0]]).growth(True) == Margins().growth(True) == 1.0
    assert Robust(Stability(), InputSector(0.5, 2.0)).growth(True) is None
    assert Together((COST, Stability(0.9))).growth(True) == 0.9


@pytest.mark.parametrize("seed", range(4))
def test_no_loop_with_a_certificate_is_said_to_have_none(seed):
    rng = np.random.default_rng(seed)
    plant, law = draws.plant(rng), draws.controller(rng, gain=0.03, bias=0.1)
    found = certify(plant, law, Stability(0.97), multiplier="sector").require()
    assert hindrance(plant, law, found.bound) == ""
    assert "around its equilibrium" in hindrance(plant, law, 0.5)


def test_an_equilibrium_that_repels_is_named_instead_of_searched_about():
    found = certify(UNSTABLE, INC.linear([[0.0, 0.0]]), Attraction(Box([-1.0], [1.0])))
    assert found.reason == ("the equilibrium x* = [0, 0] does not attract: its linearization has spectral radius 1.1, not "
                            "below 1")


SMOOTH = INC([[0.0]], [[-1.1, -2.0]], [[1.0]], [[0.0, 0.0]], activation=Tanh())
NARROW = Regional(Box([-0.8, -0.8], [0.8, 0.8]), Box([-1.0], [1.0]), np.eye(2), [[0.05]], 0.98)


@pytest.mark.parametrize(("law", "budget", "way_out"), [
    (SMOOTH, None, "method='ellipsoid'"), (INC.linear([[-1.1, -2.0]]), None, "inc.with_saturated_output(inputs)"),
    (CLIPPED, Budget(pieces=4), "A larger `budget` may finish it"), (CLIPPED, None, ""),
], ids=["smooth", "limits", "pieces", "holds"])
def test_a_regional_certificate_that_does_not_hold_says_what_to_try(law, budget, way_out):
    found = certify(UNSTABLE, law, NARROW, budget=budget)
    assert way_out in found.advice and str(found).endswith(found.advice) and bool(way_out) != found.holds()
    if way_out:
        with pytest.raises(NotCertifiedError, match=re.escape(f"{found.reason}. {found.advice}")):
            found.require()


BIASED, TWO = INC([[0.0]], [[1.0]], [[-0.2]], [[0.0]], b=[0.5]), Plant([[0.9]], [[1.0]])


@pytest.mark.parametrize(("law", "multiplier", "names"), [
    (BIASED, "slope", ["links hidden units", "has 1 of them", "What applies here: 'sector', 'relu', 'lifted'"]),
    (INC(np.zeros((2, 2)), [[1.0], [1.0]], [[-0.1, -0.1]], [[0.0]], b=[0.5, 0.0]), "slope",
     ["biased loop (b, d or phi(0) is not 0)", "'sector', 'relu', 'lifted'"]),
    (INC([[0.0]], [[1.0]], [[-0.2]], [[0.0]], b=[0.5], activation=Tanh()), "lifted",
     ["the lifted multiplier of a biased loop needs a hidden unit with a kink", "(Tanh())", "here: 'sector';"]),
    (INC(np.zeros((2, 2)), [[1.0], [1.0]], [[-0.1, -0.1]], [[0.0]], b=[0.5, 0.0], activation=[ReLU(), Tanh()]), "relu",
     ["hidden unit 1 is curved: Tanh()", "here: 'sector';"]),
], ids=["one unit", "biased", "smooth", "mixed"])
def test_a_multiplier_that_does_not_apply_is_refused_with_what_does(law, multiplier, names):
    refused = certify(TWO, law, Stability(0.95), multiplier=multiplier)
    assert refused.reason.startswith(f"{multiplier} was asked for, but ")
    assert [name for name in names if name not in refused.reason] == []


def test_a_method_for_a_claim_about_every_state_is_refused():
    with pytest.raises(InvalidInputError, match="method is 'ellipsoid', but Stability is about every state"):
        certify(TWO, BIASED, Stability(), method="ellipsoid")
