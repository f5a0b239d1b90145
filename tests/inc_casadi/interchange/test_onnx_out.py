"""Feedforward controllers as ONNX models: their answers, their shape, and what comes back."""

import numpy as np
import pytest

from inc_casadi import (
    INC,
    Box,
    CenteredLogistic,
    Identity,
    LeakyReLU,
    Logistic,
    ReLU,
    Saturation,
    Tanh,
)
from inc_casadi.activations import TwoSlopes
from inc_casadi.activations.base import Activation
from inc_casadi.errors import InvalidInputError, TranslationError
from inc_casadi.interchange.onnx_in import from_onnx
from inc_casadi.interchange.onnx_out import to_onnx

onnx = pytest.importorskip("onnx", reason="onnx is not installed")
pytest.importorskip("onnx.reference")

PARTS = ("W", "U", "V", "K", "b", "d")
KINDS = (ReLU(), Tanh(), Logistic(), Identity(), Saturation(), LeakyReLU(0.25), LeakyReLU(0.3), CenteredLogistic(),
         TwoSlopes(-0.3, 1.0), TwoSlopes(0.7, -1.3))


def layered(rng, activation, sizes=(3, 5, 4, 2)):
    return INC.from_layers([(rng.normal(size=(after, before)), rng.normal(size=after))
                            for before, after in zip(sizes, sizes[1:], strict=False)], activation)


def tangled(rng, q=9, p=3, m=2):
    """Units of every kind that read one another in a hidden order, and the measurement, and all of them are read."""
    W, order = np.tril(rng.normal(size=(q, q)), -1) * (rng.random((q, q)) < 0.5), rng.permutation(q)
    units = tuple(KINDS[i % len(KINDS)] for i in range(q))
    return INC(W[np.ix_(order, order)], rng.normal(size=(q, p)), rng.normal(size=(m, q)), rng.normal(size=(m, p)),
               rng.normal(size=q), rng.normal(size=m), units)


def answers(model, points, name="y"):
    return onnx.reference.ReferenceEvaluator(model).run(None, {name: points.T})[0].T


@pytest.mark.parametrize("activation", KINDS, ids=repr)
def test_a_layered_network_of_each_kind_answers_alike(activation):
    rng = np.random.default_rng(1)
    inc, points = layered(rng, activation), 2 * rng.normal(size=(3, 100))
    np.testing.assert_allclose(answers(to_onnx(inc), points), inc(points), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("activation", [ReLU(), Tanh(), Saturation(), LeakyReLU(0.25), LeakyReLU(0.3), Logistic()], ids=repr)
def test_layers_come_back_bit_for_bit(activation):
    inc = layered(np.random.default_rng(2), activation)
    again = from_onnx(to_onnx(inc))
    assert again.activations == inc.activations
    for part in PARTS:
        np.testing.assert_array_equal(getattr(again, part), getattr(inc, part))


def test_units_in_any_order_answer_alike_and_come_back_by_level():
    rng = np.random.default_rng(3)
    for _ in range(5):
        inc, points = tangled(rng), 2 * rng.normal(size=(3, 100))
        model = to_onnx(inc)
        np.testing.assert_allclose(answers(model, points), inc(points), rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(from_onnx(model)(points), inc(points), rtol=1e-11, atol=1e-11)


def test_a_network_is_its_layers_again_and_nothing_more():
    model = to_onnx(layered(np.random.default_rng(4), ReLU()))
    assert [node.op_type for node in model.graph.node] == ["Gemm", "Relu", "Gemm", "Relu", "Gemm"]
    assert model.opset_import[0].version == 17
    onnx.checker.check_model(model, full_check=True)


def test_linear_constant_and_clipped_laws():
    points = np.random.default_rng(5).normal(size=(2, 50))
    for inc in (INC.linear([[1.0, -2.0]]), INC(np.zeros((0, 0)), [], [], np.zeros((1, 2)), d=[3.0]),
                INC.saturated([[1.0, 1.0]], 0.5), INC.linear(np.eye(2)).with_saturated_output(Box([-1.0, 0.0], [0.5, 0.3]))):
        model = to_onnx(inc)
        np.testing.assert_allclose(answers(model, points), inc(points), rtol=1e-13)
        if np.any(inc.K) or inc.q:
            np.testing.assert_allclose(from_onnx(model)(points), inc(points), rtol=1e-13)


def test_a_clipped_law_stays_within_its_limits_after_a_round_trip():
    inc = INC.linear([[3.0]]).with_saturated_output(Box([-0.1], [0.7 / 3]))
    again = from_onnx(to_onnx(inc))
    np.testing.assert_array_equal(again.V, inc.V)
    assert again([[-9.0, 9.0]]).tolist() == inc([[-9.0, 9.0]]).tolist()


def test_any_number_of_points_at_once_in_the_runtime_of_others():
    runtime = pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")
    rng = np.random.default_rng(6)
    inc, points = tangled(rng), rng.normal(size=(3, 64))
    for double, dtype, tol in ((True, np.float64, 1e-12), (False, np.float32, 3e-5)):
        session = runtime.InferenceSession(
            to_onnx(inc, double=double).SerializeToString(), providers=["CPUExecutionProvider"]
        )
        for count in (1, 64):
            theirs = session.run(None, {"y": points[:, :count].T.astype(dtype)})[0].T
            assert theirs.dtype == dtype
            np.testing.assert_allclose(theirs, inc(points[:, :count]), rtol=tol, atol=tol)


def test_single_precision_rounds_the_numbers_and_nothing_else():
    inc = layered(np.random.default_rng(7), Tanh())
    again = from_onnx(to_onnx(inc, double=False))
    for part in PARTS:
        np.testing.assert_array_equal(getattr(again, part), getattr(inc, part).astype(np.float32))


def test_a_file_and_the_method(tmp_path):
    inc = layered(np.random.default_rng(8), ReLU())
    inc.to_onnx(tmp_path / "net.onnx")
    np.testing.assert_array_equal(INC.from_onnx(tmp_path / "net.onnx").U, inc.U)


def test_a_loop_is_refused_by_name():
    inc = INC([[0.0, 0.5], [0.5, 0.0]], [[1.0], [1.0]], [[1.0, 1.0]], [[0.0]])
    with pytest.raises(TranslationError, match=r"W \(2 x 2\) has a loop.*to_c"):
        to_onnx(inc)
    with pytest.raises(TranslationError, match="has a loop"):
        to_onnx(INC([[0.5]], [[1.0]], [[1.0]], [[0.0]]))


class Cubed(Activation):
    """An activation that ONNX does not know."""

    slopes = (0.0, 1.0)

    def formula(self, z, ops):
        return z

    def derivative(self, z):
        return np.ones_like(z)


def test_an_activation_without_operator_is_refused_by_name():
    with pytest.raises(TranslationError, match="Cubed"):
        to_onnx(INC([[0.0]], [[1.0]], [[1.0]], [[0.0]], activation=Cubed()))
    with pytest.raises(InvalidInputError, match="ndarray"):
        to_onnx(np.eye(2))
