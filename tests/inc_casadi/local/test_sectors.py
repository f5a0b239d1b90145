"""Local sectors: every certified ellipsoid sampled on trajectories, each number corrupted, and cases solved by hand."""

import numpy as np
import pytest
from attraction_draws import falls, rim
from neural_draws import MIXED, neural, two_layers

from inc_casadi import INC, Box, Plant, ReLU, Saturation, Tanh, close_loop, simulate
from inc_casadi.claims import Attraction
from inc_casadi.ellipsoid_certificate import EllipsoidCertificate
from inc_casadi.local.base import Setting
from inc_casadi.local.certify import certify_attraction
from inc_casadi.local.rest import rest_of
from inc_casadi.local.sectors import LocalSectors


def certified(plant, inc, claim=None, programs=4):
    """A certificate from a short search: what holds of it does not depend on how far the search went."""
    loop, claim = close_loop(plant, inc), claim or Attraction()
    values = LocalSectors(programs).search(Setting(loop, claim, rest_of(loop)))
    assert not isinstance(values, str), values
    found = EllipsoidCertificate(plant, inc, claim, "local sectors", values)
    assert found.holds(), found.reason
    return found


def energies(found, rng, N=200, steps=150):
    """V along motions from the rim, (N, steps + 1), and the run itself."""
    plant, ellipsoid = found.plant, found.ellipsoid
    start = rim(ellipsoid, N, rng, scale=1 - 1e-9)
    run = (simulate(plant, found.inc, start, steps=steps) if plant.discrete else
           simulate(plant, found.inc, start[:, :20], times=np.linspace(0, 12, 40)))
    e = run.x - ellipsoid.center[:, None, None]
    return np.einsum("int,ij,jnt->nt", e, ellipsoid.P, e), run


@pytest.mark.parametrize("draw", [
    dict(), dict(bias=0.3, feedback=0.3), dict(units=MIXED, n=3, m=2, bias=0.1, feedback=0.3),
    dict(units=MIXED, limit=2.0, bias=0.1)], ids=["tanh", "tanh, biased, implicit", "mixed", "saturated"])
@pytest.mark.parametrize("seed", [0, pytest.param(3, marks=pytest.mark.slow)])
def test_motions_from_the_rim_descend_and_arrive(draw, seed):
    rng = np.random.default_rng(seed)
    found = certified(*neural(rng, **draw))
    V, _ = energies(found, rng)
    assert falls(np.maximum(V, 1e-12), 1 + 1e-12) and np.max(V[:, -1]) < 1e-3
    assert found.prove("float").succeeded and found.prove("exact").succeeded


def test_two_layers_in_continuous_time():
    rng = np.random.default_rng(2)
    plant, inc = two_layers(rng, limit=1.0)
    found = certified(Plant(plant.A - 1.05 * np.eye(2), plant.B, dt=0.0), inc, Attraction(rate=0.02))
    V, run = energies(found, rng)
    assert np.all(V <= V[:, :1] * np.exp(-0.02 * run.t) + 1e-6)


def test_one_state_reaches_almost_to_the_next_equilibrium():
    # x+ = 1.2 x - tanh x has its other equilibria where x / 5 = tanh x, at +-4.9995.
    found = certified(Plant([[1.2]], [[1.0]]), INC([[0.0]], [[1.0]], [[-1.0]], [[0.0]], activation=Tanh()), programs=60)
    assert 0.97 * 9.999 < found.volume < 9.9991


@pytest.mark.slow
def test_a_saturated_net_reaches_almost_as_far_as_any_bounded_input():
    # |u| <= 1 holds x+ = 1.5 x + u back for |x| < 2 and no further; the net saturates well before.
    inc = INC([[0.0]], [[0.2]], [[-7.0]], [[0.0]], activation=Tanh()).with_saturated_output(Box([-1.0], [1.0]))
    found = certified(Plant([[1.5]], [[1.0]]), inc, programs=60)
    assert 3.9 < found.volume < 4.0
    beyond = EllipsoidCertificate(found.plant, inc, Attraction(), "local sectors",
                                  {**found.values, "P": 0.9 * found.values["P"], "Lambda": 0.9 * found.values["Lambda"]})
    assert beyond.margins()["decrease"] > 0 > beyond.margins()["room of unit 1"]      # the bending law asks too much


@pytest.mark.slow
def test_a_deep_relu_net_about_a_rest_inside_its_pieces():
    # Two layers of ReLU that pass x on, a tanh that limits it: the pieces' linear law as long as no kink is reached.
    W = np.zeros((3, 3))
    W[1, 0], W[2, 1] = 1.0, 1.0
    inc = INC(W, [[1.0], [0.0], [0.0]], [[0.0, 0.0, -1.0]], [[0.0]], b=[2.0, 1.0, -3.0], activation=(ReLU(), ReLU(), Tanh()))
    found = certified(Plant([[1.2]], [[1.0]]), inc, programs=60)
    V, _ = energies(found, np.random.default_rng(0))
    assert found.ellipsoid.center == pytest.approx(0.0, abs=1e-12) and 3.9 < found.volume
    assert np.all(np.diff(V, axis=1) <= 1e-9)


def test_limits_and_rate_are_kept():
    rng = np.random.default_rng(6)
    plant, inc = neural(rng, bias=0.1)
    free = certified(plant, inc)
    claim = Attraction(Box([-0.5], [0.6]), Box([-0.5, -2.0], [0.5, 2.0]), rate=0.98)
    found = certified(plant, inc, claim)
    V, run = energies(found, rng)
    assert np.all(run.u <= 0.6) and np.all(run.u >= -0.5) and np.all(np.abs(run.x[0]) <= 0.5)
    assert found.volume < free.volume and falls(np.maximum(V, 1e-12), 0.98**2 + 1e-9) or np.max(V[:, -1]) < 1e-9


@pytest.mark.parametrize("seed", [1, pytest.param(4, marks=pytest.mark.slow)])
def test_the_cost_bound_is_never_exceeded(seed):
    rng = np.random.default_rng(seed)
    plant, inc = neural(rng, MIXED, bias=0.2, limit=2.0)
    claim = Attraction(Q=np.eye(2), R=[[0.1]], discount=0.95, rate=0.99)
    found = certified(plant, inc, claim, programs=8)
    _, run = energies(found, rng)
    x_rest = found.ellipsoid.center
    e, v = run.x - x_rest[:, None, None], run.u - inc(plant.C @ x_rest)[:, None, None]
    cost = (np.sum(e**2, axis=0) + 0.1 * np.sum(v**2, axis=0)) @ 0.95 ** np.arange(e.shape[2])
    bound = np.einsum("in,ij,jn->n", e[:, :, 0], found.values["P_cost"], e[:, :, 0])
    assert np.all(cost <= bound) and np.max(cost / bound) > 0.15


def test_along_directions_the_reach_is_what_is_maximized():
    rng = np.random.default_rng(7)
    plant, inc = neural(rng)
    directions = np.array([[1.0], [0.0]])
    along = certified(plant, inc, Attraction(directions=directions), programs=20)
    widest = certified(plant, inc, programs=20)
    reach = widest.ellipsoid.P[0, 0] ** -0.5
    assert along.bound >= 0.98 * reach and along.volume <= 1.02 * widest.volume
    corner = along.ellipsoid.center + 0.999 * along.bound * directions[:, 0]
    assert along.ellipsoid.contains(corner)
    mean = certified(plant, inc, Attraction(shape="mean", directions=np.eye(2)))
    assert 0 < mean.bound < along.bound


def test_every_corrupted_number_is_refused():
    rng = np.random.default_rng(3)
    plant, inc = neural(rng, MIXED, limit=2.0, bias=0.1)
    claim = Attraction(Box([-3.0], [3.0]), Q=np.eye(2), R=[[0.1]], discount=0.95, rate=0.99)
    found = certified(plant, inc, claim)
    spoiled = {"P": 0.6 * found.values["P"], "P_cost": 0.3 * found.values["P_cost"],
               "Lambda": np.zeros_like(found.values["Lambda"]), "Lambda_cost": np.zeros_like(found.values["Lambda_cost"]),
               "r": 0.7 * found.values["r"], "H": 3.0 * found.values["H"]}
    assert set(spoiled) == set(found.values)
    for name, value in spoiled.items():
        assert np.any(value != found.values[name]), name
        bad = EllipsoidCertificate(plant, inc, claim, "local sectors", {**found.values, name: value})
        assert not bad.holds() and not bad.prove().succeeded and not bad.prove("exact").succeeded, name


def test_input_limits_that_are_not_built_in_have_multipliers_that_matter():
    rng = np.random.default_rng(6)
    plant, inc = neural(rng)
    claim = Attraction(Box([-0.5], [0.5]))
    found = certified(plant, inc, claim)
    values = {**found.values, "Lambda_inputs": 0 * found.values["Lambda_inputs"]}
    bad = EllipsoidCertificate(plant, inc, claim, "local sectors", values)
    assert "input limit" in bad.reason


@pytest.mark.slow
def test_another_order_of_units_or_other_coordinates_say_the_same():
    rng = np.random.default_rng(8)
    plant, inc = neural(rng, feedback=0.2)
    first = certified(plant, inc, programs=30).volume
    order = rng.permutation(inc.q)
    shuffled = INC(inc.W[np.ix_(order, order)], inc.U[order], inc.V[:, order], inc.K, inc.b[order], inc.d, Tanh())
    assert certified(plant, shuffled, programs=30).volume == pytest.approx(first, rel=1e-3)
    T = np.diag([10.0, 0.2])
    moved = Plant(T @ plant.A @ np.linalg.inv(T), T @ plant.B, plant.C @ np.linalg.inv(T))
    assert certified(moved, inc, programs=30).volume == pytest.approx(first * np.linalg.det(T), rel=0.05)


def test_what_stands_in_the_way_is_said():
    plain = INC.saturated([[-1.2]], 1.0)
    assert "dead zone method says the same" in certify_attraction(Plant([[1.5]], [[1.0]]), plain, Attraction()).note
    assert certify_attraction(Plant([[1.5]], [[1.0]]), plain, Attraction(), "local sectors").volume > 3.99
    weak = INC([[0.0]], [[1.0]], [[-0.1]], [[0.0]], activation=Tanh())
    assert "linearization" in certify_attraction(Plant([[1.5]], [[1.0]]), weak, Attraction(), "local sectors").reason
    net = INC([[0.0]], [[1.0]], [[-1.0]], [[0.0]], activation=(Tanh(),))
    crowded = certify_attraction(Plant([[1.2]], [[1.0]]), net, Attraction(Box([0.0], [1.0])), "local sectors")
    assert "no room" in crowded.reason


def test_auto_takes_the_local_sectors_for_a_tanh_net():
    found = certify_attraction(Plant([[1.2]], [[1.0]]), INC([[0.0]], [[1.0]], [[-1.0]], [[0.0]], activation=Tanh()),
                               Attraction())
    assert found.method == "local sectors" and found.holds()


def test_a_saturation_that_other_units_read_is_bounded_by_its_sector():
    W = np.zeros((2, 2))
    W[1, 0] = 1.0
    inc = INC(W, [[1.0], [0.0]], [[0.0, -1.4]], [[0.0]], activation=(Saturation(), Tanh()))
    found = certified(Plant([[1.2]], [[1.0]]), inc)
    V, _ = energies(found, np.random.default_rng(0))
    assert np.all(np.diff(V, axis=1) <= 1e-9) and found.values["r"][0] > 1.0
