"""The ellipsoid on which the law stays linear: closed forms in one state, an implicit law, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

from inc_casadi import INC, Box, LeakyReLU, Plant, ReLU, Saturation, Tanh, close_loop
from inc_casadi.blocks import exact
from inc_casadi.claims import Attraction
from inc_casadi.local.base import Setting
from inc_casadi.local.certify import certify_attraction
from inc_casadi.local.linear import is_feedforward, linear_law
from inc_casadi.local.rest import Rest, rest_of


def test_one_state_stops_where_the_input_saturates():
    found = certify_attraction(Plant([[1.5]], [[1.0]]), INC.saturated([[-0.8]], 2.0), Attraction(), "linear")
    assert found.volume == pytest.approx(2 * 2.0 / 0.8, rel=1e-6) and found.holds()


def test_an_input_limit_on_a_linear_law_is_the_same_limit():
    plant, gain = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]]), [[-0.4, -1.3]]
    limited = certify_attraction(plant, INC.linear(gain), Attraction(Box([-1.5], [1.5])), "linear")
    saturated = certify_attraction(plant, INC.saturated(gain, 1.5), Attraction(), "linear")
    assert limited.volume == pytest.approx(saturated.volume, rel=1e-6) and "input limit 1" in limited.margins()


def test_an_unsymmetric_limit_counts_by_its_nearer_side():
    claim = Attraction(Box([-3.0], [0.5]), states=Box([-0.4], [9.0]))
    found = certify_attraction(Plant([[1.5]], [[1.0]]), INC.linear([[-1.0]]), claim, "linear")
    assert found.volume == pytest.approx(2 * 0.4, rel=1e-6)
    wide = certify_attraction(Plant([[1.5]], [[1.0]]), INC.linear([[-1.0]]), Attraction(Box([-3.0], [0.5])), "linear")
    assert wide.volume == pytest.approx(2 * 0.5, rel=1e-6)


def test_the_linear_law_of_an_implicit_controller_is_its_jacobian():
    rng = np.random.default_rng(1)
    units = (Saturation(), ReLU(), LeakyReLU(0.2))
    inc = INC(0.3 * rng.normal(size=(3, 3)), rng.normal(size=(3, 2)), 0.1 * rng.normal(size=(1, 3)),
              0.1 * rng.normal(size=(1, 2)), 0.1 * rng.normal(size=3), activation=units)
    plant = Plant(0.5 * rng.normal(size=(2, 2)), rng.normal(size=(2, 1)))
    loop = close_loop(plant, inc)
    rest = rest_of(loop)
    N = linear_law(Setting(loop, Attraction(), rest)).astype(float)
    assert inc.K + inc.V @ N == pytest.approx(inc.jacobian(rest.center), rel=1e-12)


def _point(net, x):
    """x, z and u of a net, as if it rested there."""
    return np.array(x), net.W @ net.hidden(x) + net.U @ x + net.b, net(x)


def test_layers_need_no_inverse():
    rng = np.random.default_rng(2)
    layers = [(rng.normal(size=(50, 2)), rng.normal(size=50)), (rng.normal(size=(3, 50)) / 50, rng.normal(size=3)),
              (0.1 * rng.normal(size=(1, 3)), np.zeros(1))]
    net = INC.from_layers(layers, LeakyReLU(0.5))
    loop = close_loop(Plant([[0.5, 0.1], [0.0, 0.3]], [[1.0], [0.2]]), net)
    setting = Setting(loop, Attraction(), Rest.at(*(exact(part) for part in _point(net, [0.3, -0.2]))))
    N = linear_law(setting).astype(float)
    assert net.K + net.V @ N == pytest.approx(net.jacobian([0.3, -0.2]), rel=1e-12)
    assert is_feedforward(net.W) and not is_feedforward(np.array([[0.0, 1.0], [1.0, 0.0]]))
    assert is_feedforward(np.zeros((0, 0)))


def test_the_cost_of_a_linear_loop_is_its_lyapunov_solution():
    plant, gain = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]]), np.array([[-0.4, -1.3]])
    Q, R, discount = np.eye(2), [[0.3]], 0.9
    claim = Attraction(Box([-1], [1]), Q=Q, R=R, discount=discount)
    found = certify_attraction(plant, INC.linear(gain), claim, "linear")
    A = plant.A + plant.B @ gain
    wanted = solve_discrete_lyapunov(np.sqrt(discount) * A.T, Q + gain.T @ R @ gain)
    gap = np.linalg.eigvalsh(found.values["P_cost"] - wanted)
    assert gap[0] > 0 and gap[-1] < 1e-4 * np.linalg.norm(wanted)


@pytest.mark.parametrize(("law", "why"), [
    (INC([[0.0]], [[1.0]], [[-1.0]], [[0.0]], activation=Tanh()), "not piecewise affine"),
    (INC([[0.0]], [[1.0]], [[-1.0]], [[0.0]], activation=ReLU()), "rests on a kink"),
    (INC.linear([[-0.1]]), "linearization has spectral radius 1.4"),
])
def test_what_is_not_linear_or_not_stable_is_refused_with_the_reason(law, why):
    found = certify_attraction(Plant([[1.5]], [[1.0]]), law, Attraction(), "linear")
    assert not found.holds() and why in found.reason and not found.prove()


def test_an_equilibrium_on_a_limit_leaves_no_room():
    found = certify_attraction(Plant([[0.5]], [[1.0]]), INC.linear([[0.1]]), Attraction(states=Box([0.0], [1.0])), "linear")
    assert "state limit number 1" in found.reason and not found.holds()
