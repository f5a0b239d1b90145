"""Controllers with memory against loops written out part by part."""

import numpy as np
import pytest

from inc_casadi import INC, Box, LeakyReLU, Plant, Saturation, Spec, load, save, simulate
from inc_casadi.dynamic import DynamicINC, extended, extended_spec
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.linear import LinearController

N, M, P, L, Q = 3, 2, 1, 4, 5


def parts(rng: np.random.Generator) -> dict:
    """Return matrices of a controller with all sizes different and W strictly triangular."""
    shapes = {"A_c": (L, L), "B_c": (L, P), "C_c": (M, L), "K": (M, P), "W": (Q, Q), "U": (Q, P), "S": (Q, L), "V": (M, Q),
              "E_c": (L, Q), "b": (Q,), "d": (M,), "a_c": (L,), "xi_0": (L,)}
    drawn = {name: 0.5 * rng.standard_normal(shape) for name, shape in shapes.items()}
    drawn["W"] = np.tril(drawn["W"], -1)
    return drawn


def plant(rng: np.random.Generator) -> Plant:
    return Plant(0.4 * rng.standard_normal((N, N)), rng.standard_normal((N, M)), rng.standard_normal((P, N)))


def written_out(system: Plant, c: dict, x: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Follow one motion by hand: hidden units one after the other, leaky units with slope 0.2."""
    xi, states, inputs, memories = c["xi_0"], [], [], []
    for _ in range(steps):
        y, eta = system.C @ x, np.zeros(Q)
        for i in range(Q):
            z = sum(c["W"][i, j] * eta[j] for j in range(i)) + c["U"][i] @ y + c["S"][i] @ xi + c["b"][i]
            eta[i] = z if z > 0 else 0.2 * z
        u = c["K"] @ y + c["C_c"] @ xi + c["V"] @ eta + c["d"]
        states.append(x), inputs.append(u), memories.append(xi)
        x, xi = system.A @ x + system.B @ u, c["A_c"] @ xi + c["B_c"] @ y + c["E_c"] @ eta + c["a_c"]
    return np.array(states).T, np.array(inputs).T, np.array(memories).T


def test_extended_loop_makes_the_motions_written_out():
    rng = np.random.default_rng(1)
    c, system, x = parts(rng), plant(rng), rng.standard_normal(N)
    dynamic = DynamicINC.from_matrices(**c, activation=LeakyReLU(0.2))
    states, inputs, memories = written_out(system, c, x, 8)
    run = simulate(*extended(system, dynamic), np.concatenate([x, c["xi_0"]]), steps=7)
    assert (dynamic.order, dynamic.p, dynamic.m, dynamic.q) == (L, P, M, Q)
    np.testing.assert_allclose(run.x, np.vstack([states, memories]), rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(run.u[:M], inputs, rtol=1e-10, atol=1e-12)


def test_steps_of_the_controller_are_those_written_out():
    rng = np.random.default_rng(2)
    c, system, x = parts(rng), plant(rng), rng.standard_normal(N)
    dynamic = DynamicINC.from_matrices(**c, activation=LeakyReLU(0.2))
    states, inputs, memories = written_out(system, c, x, 5)
    after, u = dynamic.step(memories[:, :-1], system.C @ states[:, :-1])
    np.testing.assert_allclose(u, inputs[:, :-1], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(after, memories[:, 1:], rtol=1e-10, atol=1e-12)


def test_linear_controller_is_the_one_without_units():
    rng = np.random.default_rng(3)
    A_c, B_c, C_c, D_c = (rng.standard_normal(shape) for shape in ((L, L), (L, P), (M, L), (M, P)))
    linear = LinearController(A_c, B_c, C_c, D_c, rng.standard_normal(L))
    dynamic = DynamicINC.from_linear(linear)
    for ours, theirs in zip(dynamic.step(linear.xi_0, [0.7]), linear.step(linear.xi_0, [0.7]), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-13)


def test_clipped_controller_clips_the_input_and_not_the_state():
    rng = np.random.default_rng(4)
    dynamic = DynamicINC.from_matrices(**parts(rng), activation=LeakyReLU(0.2))
    y, xi = rng.standard_normal((P, 200)), rng.standard_normal((L, 200))
    held = dynamic.with_saturated_output(Box([-0.5, -0.2], [0.25, 0.7]))
    (after, u), (plain_after, plain_u) = held.step(xi, y), dynamic.step(xi, y)
    np.testing.assert_allclose(after, plain_after, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(u, np.clip(plain_u, [[-0.5], [-0.2]], [[0.25], [0.7]]), atol=1e-13)
    assert np.any(u != plain_u)


def test_cost_of_the_extended_spec_is_that_of_plant_and_input():
    rng = np.random.default_rng(5)
    c, system = parts(rng), plant(rng)
    dynamic = DynamicINC.from_matrices(**c, activation=LeakyReLU(0.2))
    Q_x, R = np.diag([1.0, 2.0, 0.5]), np.array([[0.3, 0.1], [0.1, 0.2]])
    spec = extended_spec(Spec(Q_x, R, 0.9, Box([-1, -2, 0], [1, 1, 3])), dynamic)
    x = np.array([0.5, -1.0, 2.0])
    states, inputs, _ = written_out(system, c, x, 8)
    by_hand = sum(0.9**k * (s @ Q_x @ s + u @ R @ u) for k, (s, u) in enumerate(zip(states.T, inputs.T, strict=True)))
    run = simulate(*extended(system, dynamic), np.concatenate([x, c["xi_0"]]), steps=7)
    np.testing.assert_allclose(run.cost(spec.Q, spec.R, spec.discount), by_hand, rtol=1e-12)
    np.testing.assert_array_equal(spec.initial.vertices[N:], np.repeat(c["xi_0"][:, None], 8, axis=1))


def test_controller_comes_back_from_a_file(tmp_path):
    dynamic = DynamicINC.from_matrices(**parts(np.random.default_rng(6)), activation=LeakyReLU(0.2))
    save({"law": dynamic.law, "xi_0": dynamic.xi_0}, tmp_path / "dynamic.json")
    again = DynamicINC(**load(tmp_path / "dynamic.json"))
    np.testing.assert_array_equal(again.step([0.1, 0.2, 0.3, 0.4], [0.5])[0], dynamic.step([0.1, 0.2, 0.3, 0.4], [0.5])[0])


@pytest.mark.parametrize("law, xi_0, message", [
    (INC.linear(np.ones((3, 2))), [], "xi_0 is empty"),
    (INC.linear(np.ones((3, 2))), [0.0, 0.0], "more than 2 measurements and outputs, but it has 2 and 3"),
    (INC.linear(np.ones((2, 3))), [0.0, 0.0], "more than 2 measurements and outputs, but it has 3 and 2"),
])
def test_law_without_room_for_plant_and_memory_is_refused(law, xi_0, message):
    with pytest.raises(DimensionError, match=message):
        DynamicINC(law, xi_0)


def test_misfits_are_refused():
    dynamic = DynamicINC.from_matrices(**parts(np.random.default_rng(7)), activation=Saturation())
    spec = Spec(np.eye(N), np.eye(M), 0.9, Box(-np.ones(N), np.ones(N)), Box([-1, -1], [1, 1]))
    with pytest.raises(DimensionError, match="maps 1 measurements to 2 inputs"):
        extended(Plant(np.eye(2), np.eye(2)), dynamic)
    with pytest.raises(InvalidInputError, match="continuous"):
        extended(Plant(np.eye(N), np.ones((N, M)), np.ones((P, N)), dt=0.0), dynamic)
    with pytest.raises(InvalidInputError, match="memory is missing"):
        extended_spec(spec, dynamic)
    with pytest.raises(DimensionError, match=r"memory is a box in R\^1, but the controller has order 4"):
        extended_spec(spec, dynamic, Box(-1, 1))
    with pytest.raises(InvalidInputError, match="law must be an INC"):
        DynamicINC(np.eye(2), [0.0])  # type: ignore[arg-type]
