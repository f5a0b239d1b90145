"""The search for a cheap ellipsoid: far below the cost on the largest one, no corner left out, and what its program says."""

import numpy as np
import pytest
from attraction_draws import lqr, unstable

from inc_casadi import INC, Box, Plant, Spec, Tanh, Uniform, close_loop
from inc_casadi.claims import Attraction
from inc_casadi.ellipsoidal_region import certify_ellipsoidal
from inc_casadi.interior_point import solve
from inc_casadi.lmi_local_cost import program_for_cost
from inc_casadi.lmi_local_sectors import around_at
from inc_casadi.lmi_local_snug import snug
from inc_casadi.local import containment
from inc_casadi.local.base import Setting, without_cost
from inc_casadi.local.certify import certify_attraction
from inc_casadi.local.rest import rest_of

STEEP = Plant([[1.10, 1.00], [0.0, 1.02]], [[0.20], [0.50]])


def test_its_cost_bound_is_a_small_part_of_that_on_the_largest_ellipsoid():
    law, start = INC.saturated(lqr(STEEP), 1.0), Box([-0.4, -0.4], [0.4, 0.4])
    cost = {"Q": np.eye(2), "R": [[0.05]], "discount": 0.98}
    widest = certify_attraction(STEEP, law, Attraction(**cost, directions=start.vertices[:, :2]), "dead zone")
    found = certify_ellipsoidal(STEEP, law, Spec(np.eye(2), 0.05, 0.98, start, Box(-1, 1)))
    moment = Uniform(start).second_moment
    assert widest.holds() and widest.bound > 1 and found.bound < 0.1 * np.sum(widest.values["P_cost"] * moment)


def test_corners_that_were_not_asked_for_at_first_are_contained_too(monkeypatch):
    monkeypatch.setattr(containment, "MOST_OUTERMOST", 1)
    rng = np.random.default_rng(4)
    plant = unstable(rng, n=3, m=2, radius=1.05)
    law, half = INC.saturated(lqr(plant), [1.0, 1.0]), np.array([0.02, 0.03, 0.01])
    found = certify_ellipsoidal(plant, law, Spec(np.eye(3), np.eye(2), 0.97, Box(-half, half), Box([-1, -1], [1, 1])))
    assert found.holds(), found.reason
    assert np.all(found.ellipsoid.contains(Box(-half, half).vertices))


def test_where_the_loop_is_linear_gamma_is_the_worst_cost_on_the_ellipsoid():
    law, start = INC.saturated([[-1.2]], 1.0), np.array([[0.5]])
    loop = close_loop(Plant([[1.5]], [[1.0]]), law)
    setting = Setting(loop, Attraction(Q=[[1.0]], R=[[1.0]], discount=0.9), rest_of(loop))
    P = np.array([[1 / 0.6**2]])
    around = around_at(without_cost(setting), P, np.ones(1), np.zeros(1, dtype=bool))[0]
    program = program_for_cost(setting, around, P, start)
    answer = solve(program.problem)
    scale = 0.6**2  # of the state's part of the stage cost in the coordinates of P
    exact = (1 + 1.2**2) / (1 - 0.9 * 0.3**2) * 0.5**2
    assert answer.y[program.places["gamma"]].item() * scale == pytest.approx(exact, rel=1e-4)


def test_a_linear_law_without_units_is_searched_too():
    loop = close_loop(Plant([[1.5]], [[1.0]]), INC.linear([[-1.2]]))
    setting = Setting(loop, Attraction(Box(-1, 1), Q=[[1.0]], R=[[1.0]], discount=0.9), rest_of(loop))
    values = snug(setting, np.array([[0.8]]), np.array([[0.2]]))
    assert values["P_cost"].item() == pytest.approx((1 + 1.2**2) / (1 - 0.9 * 0.3**2), rel=1e-3)
    assert "scaled by 0.9" in snug(setting, np.array([[0.9]]), np.array([[0.2]]))  # 1 / 1.2 is all that the limit allows


@pytest.mark.slow
def test_the_way_with_bent_lines_reaches_where_sectors_do_not():
    # |u| <= 1 holds x+ = 1.5 x + u back for |x| < 2; a sector on the saturation's range says so for less.
    law = INC([[0.0]], [[0.2]], [[-7.0]], [[0.0]], activation=Tanh()).with_saturated_output(Box([-1.0], [1.0]))
    loop = close_loop(Plant([[1.5]], [[1.0]]), law)
    setting = Setting(loop, Attraction(Q=[[1.0]], R=[[0.0]], discount=0.9), rest_of(loop))
    values = snug(setting, np.array([[1.9]]), np.array([[1.0]]))
    assert not isinstance(values, str) and values["H"].any() and values["P"].item() * 1.9**2 <= 1
