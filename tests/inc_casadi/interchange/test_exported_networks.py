"""Networks that PyTorch, Keras and scikit-learn exported: read without these libraries, compared with their answers.

The files in exported/ were written by PyTorch 2.13 (`torch.onnx.export`; "dynamo" is the new exporter, "old" the one that
traces), Keras 3.15 on PyTorch (`Model.export`) and scikit-learn 1.9 with skl2onnx 1.20, from networks with random weights;
remarks about where the exporting code stood were taken out. answers.json has what the libraries answered, a row for a point.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from inc_casadi import LeakyReLU, ReLU, Saturation, Tanh
from inc_casadi.errors import TranslationError
from inc_casadi.interchange import from_onnx

onnx = pytest.importorskip("onnx", reason="onnx is not installed")

EXPORTED = Path(__file__).parent / "exported"
ANSWERS = json.loads((EXPORTED / "answers.json").read_text(encoding="utf-8"))
UNITS = {
    "torch_relu_dynamo": [ReLU()] * 10,
    "torch_batchnorm_dynamo": [ReLU()] * 6,  # folded into the layer before by the exporter
    "torch_batchnorm_opset_9": [ReLU()] * 6,  # an operator set that onnx.reference itself misreads
    "torch_two_heads_dynamo": [ReLU()] * 4 + [Tanh()] * 4,  # concatenated, split, picked by indices
    "torch_view_dynamo": [ReLU()] * 6,  # reshaped, averaged, expanded
    "torch_maxout_old": [ReLU()] * 4,  # the larger of two, four times
    "torch_where_dynamo": [LeakyReLU(float(np.float32(0.2)))] * 5,  # where(z > 0, z, 0.2 z)
    "torch_masked_dynamo": [ReLU()] * 5,  # z.masked_fill(z < 0, 0)
    "torch_softshrink_old": [ReLU()] * 20,  # two choices for each of ten
    "torch_convolution_dynamo": [ReLU()] * 4,
    "torch_einsum_old": [ReLU()] * 4,
    "torch_pad_dynamo": [ReLU()] * 5,
    "torch_scaled_old": [Saturation()] * 3 + [ReLU()] * 5 + [Tanh()] * 2,  # observations scaled and clipped, tanh at the end
    "torch_clamp_old": [ReLU()] * 9,  # clamped between two tensors
    "torch_hardtanh_half_dynamo": [Saturation()] * 10,
    "torch_residual_double_dynamo": [ReLU()] * 5,
    "torch_prelu_opset_11": [LeakyReLU(0.25)] * 10,
    "torch_dropout_opset_9": [ReLU()] * 6,
    "keras_residual": [ReLU()] * 5 + [Tanh()] * 3,
    "keras_batchnorm": [ReLU()] * 6,
    "keras_normalization": [ReLU()] * 6,
    "sklearn_pipeline": [ReLU()] * 6,  # a scaler and a network
    "sklearn_mlp_tanh_double": [Tanh()] * 10,
    "sklearn_ridge": [],
}
TOLERANCES = {"half": 1e-2, "double": 1e-12}  # rounding of what the library computed; else 1e-6


@pytest.mark.parametrize("name", UNITS)
def test_it_answers_as_the_library_did(name):
    inc, points = from_onnx(EXPORTED / f"{name}.onnx"), np.array(ANSWERS[name]["y"]).T
    expected = np.array(ANSWERS[name]["u"]).reshape(points.shape[1], -1).T
    tol = next((value for word, value in TOLERANCES.items() if word in name), 1e-6)
    np.testing.assert_allclose(inc(points), expected, rtol=tol, atol=tol * np.max(np.abs(expected)))
    assert list(inc.activations) == UNITS[name]


@pytest.mark.parametrize(("name", "words"), [
    ("torch_elu_dynamo", r"\(Elu\): the operator has no counterpart.* Clip, .* Relu, .* Tanh"),
    ("torch_gelu_old", r"\(Erf\): the operator has no counterpart"),
    ("torch_silu_dynamo", r"\(Mul\): both factors depend.*SiLU"),
    ("torch_layernorm_dynamo", r"\(LayerNormalization\): the operator has no counterpart"),
    ("torch_softmax_old", r"\(Softmax\): the operator has no counterpart"),
    ("torch_hardshrink_dynamo", r"\(Where\): .*it jumps there, but an INC is continuous"),
])
def test_what_has_no_counterpart_is_refused_by_name(name, words):
    with pytest.raises(TranslationError, match=words):
        from_onnx(EXPORTED / f"{name}.onnx")


def test_every_file_is_tried_and_none_says_where_it_was_made():
    files = {path.stem: path.read_bytes() for path in EXPORTED.glob("*.onnx")}
    assert set(UNITS) < set(files) == set(ANSWERS)
    assert all(b"/" + folder not in content for content in files.values() for folder in (b"home/", b"tmp/", b"root/"))


def test_weights_in_a_file_beside_it(tmp_path):
    """As the new exporter of PyTorch writes larger networks."""
    model = onnx.load(EXPORTED / "torch_relu_dynamo.onnx")
    for constant in model.graph.initializer:
        array = onnx.numpy_helper.to_array(constant)
        constant.CopyFrom(onnx.numpy_helper.from_array(array, constant.name))
    onnx.save(model, tmp_path / "net.onnx", save_as_external_data=True, location="net.onnx.data", size_threshold=0)
    assert (tmp_path / "net.onnx.data").exists()
    inside, beside = from_onnx(EXPORTED / "torch_relu_dynamo.onnx"), from_onnx(tmp_path / "net.onnx")
    np.testing.assert_array_equal(beside.W, inside.W)
    with pytest.raises(TranslationError, match="in another file, and were not loaded with it: give the path"):
        from_onnx(onnx.load(tmp_path / "net.onnx", load_external_data=False))
    (tmp_path / "net.onnx.data").unlink()
    with pytest.raises(TranslationError, match=r"net\.onnx has weights in another file, which cannot be read"):
        from_onnx(tmp_path / "net.onnx")


def test_a_file_that_is_no_model(tmp_path):
    (tmp_path / "net.onnx").write_text("no model\n")
    with pytest.raises(TranslationError, match=r"net\.onnx is no ONNX model"):
        from_onnx(tmp_path / "net.onnx")


