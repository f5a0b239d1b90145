"""Published facts on explicit predictive laws: how many regions they have, and how far a trained net is from one.

A. Bemporad, M. Morari, V. Dua, E. N. Pistikopoulos, The explicit linear quadratic regulator for constrained systems,
Automatica 38(1), 2002, example 1. R. Schwan, C. N. Jones, D. Kuhn, Stability verification of neural network controllers
using mixed-integer programming, IEEE TAC 68(12), 2023, the double integrator of their repository.
"""

import numpy as np
import pytest
from reference import network, reference

from inc_casadi import INC, Box, Plant
from inc_casadi.admissible_set import admissible_set
from inc_casadi.mpc import MPC
from inc_casadi.pieces.critical_regions import CriticalRegions, feasible_set
from inc_casadi.pieces.difference import largest_difference
from inc_casadi.pieces.linear import discounted_lyapunov
from inc_casadi.pieces.regions import regions

SETTINGS = {"one": ([[0.0], [1.0]], np.diag([1.0, 0.0]), 0.01), "two": ([[0.5], [1.0]], np.eye(2), 1.0)}
COUNTS = [(2, 9, 5), (3, 19, 7), (4, 33, 9), (5, 51, 11), (6, 73, 13)]  # horizon, regions, distinct laws


@pytest.mark.parametrize("setting", SETTINGS)
@pytest.mark.parametrize("horizon, count, laws", COUNTS)
def test_double_integrator(setting, horizon, count, laws):
    B, Q, R = SETTINGS[setting]
    mpc = MPC(Plant([[1.0, 1.0], [0.0, 1.0]], B), Q, [[R]], horizon, Box([-1.0], [1.0]))
    region = Box([-100.0, -30.0], [100.0, 30.0])
    for law in (mpc.inc(), CriticalRegions(mpc)):
        found = regions(mpc.plant, law, region)
        assert (len(found), len(found.distinct_laws()[0])) == (count, laws)
        assert found.volumes.sum() == pytest.approx(region.volume, rel=1e-12)


def test_example_of_bemporad_and_others():
    # P = A'P A + Q. The regions where only the second move is limited begin several hundred units from the origin.
    A = np.array([[0.7326, -0.0861], [0.1722, 0.9909]])
    plant = Plant(A, [[0.0609], [0.0064]])
    inc = INC.from_mpc(plant, np.eye(2), [[0.01]], 2, Box([-2.0], [2.0]), discounted_lyapunov(A, np.eye(2)))
    found = regions(plant, inc, Box([-2000.0, -2000.0], [2000.0, 2000.0]))
    G, g, _ = found.distinct_laws()
    assert (len(found), len(G)) == (9, 5)
    laws = {tuple(row) for row in np.column_stack([G[:, 0], g]).round(4) + 0.0}
    assert laws == {(-6.8355, -6.8585, 0.0), (-9.5936, -9.622, 1.2917), (-9.5936, -9.622, -1.2917), (0.0, 0.0, 2.0),
                    (0.0, 0.0, -2.0)}


@pytest.fixture(scope="module")
def predictive_law():
    """N = 10, Q = I, R = 0.1, |x_i| <= 10, |u| <= 1, and the regulator's maximal admissible set at the end."""
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.0], [1.0]])
    inputs, states = Box([-1.0], [1.0]), Box([-10.0, -10.0], [10.0, 10.0])
    free = MPC(plant, np.eye(2), [[0.1]], 10, inputs)
    regulator = free.inc().jacobian([0.0, 0.0])
    last = admissible_set(plant, regulator, inputs, states)
    assert last.prove()
    return MPC(plant, np.eye(2), [[0.1]], 10, inputs, free.terminal, states=states, terminal_set=last.polytope)


@pytest.fixture(scope="module")
def feasible(predictive_law):
    return feasible_set(predictive_law)


@pytest.mark.slow
def test_worst_error_of_a_net_trained_on_a_predictive_law(predictive_law, feasible):
    data = reference("neural_controllers/evanqp_double_integrator_qp.json")
    net, mpc = network(data), predictive_law
    found = largest_difference(net, mpc, feasible)
    # Published by a mixed-integer program on all x with |x_i| <= 10 for which the predictive law exists.
    assert found.value == pytest.approx(0.050766191223634766, abs=1e-9) and found.ended == ""
    assert found.value == pytest.approx(data["published"]["max_abs_error_vs_MPC"], abs=1e-9)
    x = feasible.sample(200, np.random.default_rng(0))
    by_solver = np.array([mpc.solve(point)[0] for point in x.T]).T
    assert np.abs(by_solver - net(x)).max() <= found.value + 1e-6
    inside = found.point * (1 - 1e-6)
    assert abs(mpc.solve(inside)[0, 0] - net(inside)[0]) == pytest.approx(found.value, abs=1e-4)


def test_the_regions_of_that_law_fill_its_feasible_set(predictive_law, feasible):
    mpc, law = predictive_law, CriticalRegions(predictive_law)
    found = regions(mpc.plant, law, feasible)
    assert found.volumes.sum() == pytest.approx(feasible.volume, rel=1e-12) and found.ended == ""
    x = feasible.sample(200, np.random.default_rng(1))
    by_solver = np.array([mpc.solve(point)[0] for point in x.T]).T
    np.testing.assert_allclose(law(x), by_solver, atol=5e-6)
    for i in np.argsort(found.volumes)[-12:]:  # the hull of a region's pieces is no larger than they are: it is convex
        assert found.polytope(i).volume == pytest.approx(found.volumes[i], rel=1e-6)
