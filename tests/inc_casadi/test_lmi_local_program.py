"""The convex program of the largest ellipsoid: against CVXPY's determinant, by hand, and in the conditions it is for."""

import cvxpy as cp
import numpy as np
import pytest
from neural_draws import two_layers

from inc_casadi import INC, Box, Plant, close_loop
from inc_casadi.claims import Attraction
from inc_casadi.interior_point import solve
from inc_casadi.lmi_local_goal import goal, goal_unknowns
from inc_casadi.lmi_local_program import Around, program_for
from inc_casadi.lmi_local_start import consistent_bounds, linear_start
from inc_casadi.local.base import Setting
from inc_casadi.local.checks import is_satisfied
from inc_casadi.local.rest import rest_of
from inc_casadi.local.sectors import LocalSectors
from inc_casadi.local.unit_bounds import linearized, local_lines


def boxed(n, rows, claim, P):
    """The largest ellipsoid with |row e| <= 1 for each row, of a plant that needs no control; its P."""
    plant = Plant(0.5 * np.eye(n), np.ones((n, 1)))
    setting = Setting(close_loop(plant, INC.linear(np.zeros((1, n)))), claim, rest_of(close_loop(
        plant, INC.linear(np.zeros((1, n))))))
    none = np.zeros(0)
    program = program_for(setting, Around(none, none, none, none, rows), P)
    return program.values_at(solve(program.problem).y)["P"]


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_the_volume_is_that_of_cvxpy_s_determinant(n):
    rng = np.random.default_rng(n)
    rows = rng.normal(size=(2 * n + 1, n))
    X = cp.Variable((n, n), PSD=True)
    cp.Problem(cp.Maximize(cp.log_det(X)), [row @ X @ row <= 1 for row in rows]).solve(solver=cp.CLARABEL)
    P = boxed(n, rows, Attraction(), 3.0 * np.eye(n))
    assert -np.linalg.slogdet(P)[1] == pytest.approx(np.linalg.slogdet(X.value)[1], abs=1e-5)


def test_in_a_box_the_ball_and_the_reach_are_known():
    rows = np.diag([1.0, 0.5, 0.25])
    np.testing.assert_allclose(boxed(3, rows, Attraction(), np.eye(3)), rows**2, atol=1e-6)
    P = boxed(3, rows, Attraction(directions=np.eye(3)), np.eye(3))
    assert np.max(np.diag(P)) == pytest.approx(1.0, abs=1e-6)            # the narrowest direction decides the common reach
    P = boxed(3, rows, Attraction(shape="mean", directions=np.eye(3)), np.eye(3))
    np.testing.assert_allclose(np.diag(P), [1.0, 0.25, 0.0625], atol=1e-5)


@pytest.mark.parametrize("dt", [1.0, 0.0])
@pytest.mark.parametrize("bent", [False, True])
def test_a_solution_passes_the_conditions_that_it_is_for(dt, bent):
    plant, inc = two_layers(np.random.default_rng(1), limit=1.0)
    plant = plant if dt else Plant(plant.A - 1.05 * np.eye(2), plant.B, dt=0.0)
    claim = Attraction(Box([-2.0], [2.0]), Box([-3.0, -3.0], [3.0, 3.0]), rate=0.999 if dt else 0.01)
    loop = close_loop(plant, inc)
    setting = Setting(loop, claim, rest_of(loop))
    P, flags = 400.0 * linear_start(setting), np.zeros(inc.q, dtype=bool)
    flags[-1] = bent
    r = consistent_bounds(setting, P, np.ones(inc.q), ~flags)
    bounds = linearized(setting, r, P)
    H = np.where(flags[:, None], np.ones((1, 2)), 0.0)
    around = Around.of(local_lines(setting, r, H), bounds.rows(loop.Z[:, :2]), bounds.rooms(r), r > 0)
    program = program_for(setting, around, P)
    answer = solve(program.problem)
    assert answer.status == "optimal"
    values = {**program.values_at(answer.interior), "r": r}
    assert np.any(values["H"]) == bent and is_satisfied(LocalSectors(), setting, values)
    assert claim.merit(values["P"]) > claim.merit(P) - 1e-3              # P itself fits, for it asked for these bounds


def test_every_goal_has_its_unknowns():
    along = np.ones((4, 3))
    for claim in (Attraction(), Attraction(directions=along), Attraction(shape="mean", directions=along)):
        names = {unknown.name: unknown.shape for unknown in goal_unknowns(claim, 4)}
        assert names == ({"L": (4, 4), "tower": (3,)} if claim.directions is None else
                         {"tau": (1 if claim.shape == "reach" else 3,)})
    places = {"X": np.array([[0]]), "tau": np.array([1])}
    blocks, cost = goal(Attraction(directions=[[2.0]]), np.eye(1), places, 2)
    assert cost.tolist() == [0.0, 1.0] and blocks[0].value(np.array([4.0, 1.0])).tolist() == [[1.0, 2.0], [2.0, 4.0]]
