"""Networks that others published: from their weights into an INC, through ONNX and back, and certified."""

import numpy as np
import pytest
from reference import reference

from inc_casadi import Attraction, Box, Budget, Plant, Regional, ReLU, Tanh, certify, load, save, simulate
from inc_casadi.interchange import from_keras_weights, from_onnx, from_state_dict, to_onnx
from inc_casadi.local.certify import certify_attraction

NAMES = ("nflveripy_double_integrator", "evanqp_double_integrator_qp", "yin_pendulum_sat", "yin_vehicle_lateral")
PHI = {"relu": (ReLU(), lambda z: np.maximum(z, 0)), "tanh": (Tanh(), np.tanh)}


def published(name):
    """Plant, limits, weights by name as PyTorch has them, activation, and the network as its layers say."""
    data = reference(f"neural_controllers/{name}.json")
    layers = [(np.array(layer["W"]), np.array(layer["b"])) for layer in data["controller"]["layers"]]
    activation, phi = PHI[data["controller"]["activation"]]
    plant, (low, high) = data["plant"], data["plant"]["input_limits"]

    def forward(y):
        for weight, bias in layers[:-1]:
            y = phi(weight @ y + bias[:, None])
        return np.clip(layers[-1][0] @ y + layers[-1][1][:, None], low, high)

    parameters = {f"{2 * i}.{part}": value for i, layer in enumerate(layers)
                  for part, value in zip(("weight", "bias"), layer, strict=True)}
    return Plant(plant["A"], plant["B"], plant["C"], plant["Ts"]), Box([low], [high]), parameters, activation, forward


@pytest.mark.parametrize("name", NAMES)
def test_the_weights_make_the_network(name):
    plant, limits, parameters, activation, forward = published(name)
    net = from_state_dict(parameters, activation, output=limits)
    points = np.repeat([0.1, 1.0, 10.0], 300) * np.random.default_rng(1).normal(size=(plant.n, 900))
    np.testing.assert_allclose(net(points), forward(points), rtol=1e-12, atol=1e-12)
    kept = [value.T if value.ndim == 2 else value for value in parameters.values()]
    np.testing.assert_array_equal(from_keras_weights(kept, activation, output=limits).W, net.W)


@pytest.mark.parametrize("name", NAMES)
def test_through_onnx_and_back_bit_for_bit(name, tmp_path):
    pytest.importorskip("onnx", reason="onnx is not installed")
    _, limits, parameters, activation, _ = published(name)
    net = from_state_dict(parameters, activation, output=limits)
    to_onnx(net, tmp_path / "net.onnx")
    again = from_onnx(tmp_path / "net.onnx")
    for part in ("W", "U", "V", "K", "b", "d"):
        np.testing.assert_array_equal(getattr(again, part), getattr(net, part))
    assert again.activations == net.activations
    single = from_onnx(to_onnx(net, double=False))  # their numbers are of single precision
    np.testing.assert_array_equal(single.U[:-1], net.U[:-1])


@pytest.mark.parametrize(("name", "start"), [
    (NAMES[0], Box([2.5, -0.25], [3.0, 0.25])), (NAMES[1], Box([-0.5, -0.5], [0.5, 0.5])),
    pytest.param(NAMES[1], Box([-2.0, -1.0], [2.0, 1.0]), marks=pytest.mark.slow),
])
def test_relu_networks_are_certified_from_a_box(name, start, tmp_path):
    plant, limits, parameters, activation, forward = published(name)
    net = from_state_dict(parameters, activation, output=limits)
    found = certify(plant, net, Regional(start, limits, np.eye(2), [[0.1]], 0.95), budget=Budget(seconds=30.0))
    assert found.holds() and found.prove()
    save(found, tmp_path / "found.json")
    assert load(tmp_path / "found.json").bound == found.bound
    x, cost = start.sample(2000, np.random.default_rng(2)), 0.0
    for k in range(200):
        u = forward(x)
        cost = cost + 0.95**k * (np.sum(x**2, axis=0) + 0.1 * u[0] ** 2)
        x = plant.A @ x + plant.B @ u
    assert np.max(cost) <= found.worst_bound and abs(np.mean(cost) - found.bound) < 5 * np.std(cost) / np.sqrt(2000)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "volume"), [(NAMES[2], 7.5), (NAMES[3], 9e4)])
def test_tanh_networks_are_certified_on_an_ellipsoid(name, volume):
    plant, limits, parameters, activation, forward = published(name)
    net = from_state_dict(parameters, activation, output=limits)
    found = certify_attraction(plant, net, Attraction(limits), "local sectors")
    assert found.holds() and found.prove() and found.volume > volume
    rim = np.linalg.solve(np.linalg.cholesky(found.ellipsoid.P).T, np.random.default_rng(3).normal(size=(plant.n, 50)))
    rim = rim / np.sqrt(np.sum(rim * (found.ellipsoid.P @ rim), axis=0))
    x = simulate(plant, net, (1 - 1e-9) * rim, steps=1500).x
    V = np.einsum("int,ij,jnt->nt", x, found.ellipsoid.P, x)
    assert np.all(np.diff(V, axis=1) <= 1e-12) and np.max(V[:, -1]) < 1e-3
