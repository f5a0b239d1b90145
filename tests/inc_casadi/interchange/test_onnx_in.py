"""Networks from ONNX: every operator against ONNX's own evaluator, and refusals that name the node."""

from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import INC, LeakyReLU, Logistic, ReLU, Saturation, Tanh
from inc_casadi.activations import TwoSlopes
from inc_casadi.errors import INCError, TranslationError
from inc_casadi.interchange.onnx_in import from_onnx

onnx = pytest.importorskip("onnx", reason="onnx is not installed")
pytest.importorskip("onnx.reference")
pytest.importorskip("onnx.parser")

HEAD = '<ir_version: 8, opset_import: ["" : 17]>\n'


def model(text, p=3, m=2, kind="double", first="N", outputs="u", opset=17, **constants):
    """An ONNX model of nodes in text, y (N, p) to u, with constants given as arrays."""
    ends = ", ".join(f"{kind} {name}" for name in outputs.split())
    parsed = onnx.parser.parse_model(
        HEAD.replace("17", str(opset)) + f"net ({kind}[{first},{p}] y) => ({ends}) {{\n{text}\n}}"
    )
    dtype = {"double": np.float64, "float": np.float32}[kind]
    for name, value in constants.items():
        value = np.asarray(value)
        value = value if value.dtype.kind in "iu" else value.astype(dtype)
        parsed.graph.initializer.append(onnx.numpy_helper.from_array(value, name))
    return parsed


def original(model, points, output="u"):
    """The answers of ONNX's evaluator in double precision, point by point: (p, N) to (m, N)."""
    evaluator, name = onnx.reference.ReferenceEvaluator(model), model.graph.input[0].name
    return np.array([np.ravel(evaluator.run([output], {name: y[None]})[0]) for y in points.T]).T


def agrees(net, inc, rng, tol=1e-12):
    points = 2 * rng.normal(size=(inc.p, 40))
    expected = original(net, points)
    np.testing.assert_allclose(inc(points), expected, rtol=tol, atol=tol * max(1.0, np.max(np.abs(expected))))


RNG = np.random.default_rng(7)
A, B, C = RNG.normal(size=(3, 4)), RNG.normal(size=(4, 4)), RNG.normal(size=(4, 2))
ROW, PAIR = RNG.normal(size=4), RNG.normal(size=2)
HEAD_ONLY = "a = MatMul(y, A)\nz = Add(a, r)\n"
TAIL = "\nu = MatMul(h, C)"
OPERATORS = {
    "Relu": "h = Relu(z)",
    "Tanh": "h = Tanh(z)",
    "Sigmoid": "h = Sigmoid(z)",
    "LeakyRelu": "h = LeakyRelu <alpha=0.25> (z)",
    "LeakyRelu steep": "h = LeakyRelu <alpha=-2.0> (z)",
    "PRelu": "h = PRelu(z, r)",
    "Abs": "h = Abs(z)",
    "Clip": "h = Clip(z, lo, hi)",
    "Clip from below": "h = Clip(z, lo)",
    "Clip from above": "h = Clip(z, , hi)",
    "Clip not at all": "h = Clip(z)",
    "Clip to a point": "h = Clip(z, lo, lo)",
    "HardSigmoid": "h = HardSigmoid <alpha=0.3, beta=0.4> (z)",
    "Max of two": "w = Relu(z)\nt = MatMul(w, B)\nh = Max(t, z)",
    "Max with a constant": "h = Max(r, z, lo)",
    "Min of two": "w = Tanh(z)\nh = Min(w, z)",
    "Min with a constant": "h = Min(z, r)",
    "skip connection": "w = Relu(z)\nt = MatMul(w, B)\nh = Add(t, z)",
    "past all units": "w = Relu(z)\nh = Add(w, a)",
    "Sub": "w = Relu(z)\nh = Sub(z, w)",
    "Sub from a constant": "w = Sub(r, z)\nh = Relu(w)",
    "Mul and Div": "w = Mul(z, r)\nt = Div(w, r)\ns = Mul(lo, t)\nh = Relu(s)",
    "Neg": "w = Neg(z)\nh = Relu(w)",
    "Identity, Cast, Dropout": "w = Identity(z)\nt = Cast <to=11> (w)\ns = Dropout(t)\nh = Relu(s)",
    "Sum": "w = Relu(z)\nh = Sum(w, z, r, w)",
    "BatchNormalization": "w = BatchNormalization(z, r, lo4, hi4, pos)\nh = Relu(w)",
    "Flatten": "w = Flatten <axis=1> (z)\nh = Relu(w)",
    "Transpose": "t = Transpose <perm=[1, 0]> (z)\nw = MatMul(B, t)\ns = Transpose(w)\nh = Relu(s)",
    "Reshape": "w = Reshape(z, shape3)\ns = Relu(w)\nh = Reshape(s, shape2)",
    "Reshape by Shape": "n = Shape(z)\nw = Reshape(z, shape3)\ns = Tanh(w)\nh = Reshape(s, n)",
    "Squeeze": "w = Unsqueeze(z, axes)\ns = Relu(w)\nh = Squeeze(s, axes)",
    "Squeeze all": "w = Squeeze(z)\nh = Relu(w)",
    "Concat and Slice": "w = Relu(z)\nt = Concat <axis=1> (w, z)\nh = Slice(t, two, six, one)",
    "Concat with a constant": "w = Concat <axis=-1> (z, row)\nh = Slice(w, two, six, one)",
    "Slice backwards": "w = Slice(z, minus_one, minus_nine, one, minus_one)\nh = Relu(w)",
    "Gather": "w = Gather <axis=1> (z, order)\nh = Relu(w)",
    "Split": "w, t = Split <axis=1> (z, halves)\ns = Relu(w)\nh = Concat <axis=1> (t, s)",
    "Split evenly": "w, t = Split <axis=1> (z)\ns = Relu(w)\nh = Concat <axis=1> (t, s)",
    "ReduceMean": "w = ReduceMean <axes=[1], keepdims=1> (z)\nt = Sub(z, w)\nh = Relu(t)",
    "ReduceSum": "w = ReduceSum <keepdims=1> (z, one)\nt = Sub(z, w)\nh = Relu(t)",
    "Constant": "k = Constant <value = double[4] {1.0, -2.0, 0.5, 3.0}> ()\ns = Exp(k)\nw = Add(z, s)\nh = Relu(w)",
}
CONSTANTS = {"A": A, "B": B, "C": C, "r": ROW, "lo": -0.5, "hi": 0.75, "lo4": PAIR.repeat(2), "hi4": -PAIR.repeat(2),
             "pos": np.abs(ROW), "shape3": np.array([-1, 2, 2]), "shape2": np.array([0, 4]), "axes": np.array([0, -1]),
             "one": np.array([1]), "two": np.array([2]), "six": np.array([6]), "minus_one": np.array([-1]),
             "minus_nine": np.array([-9]), "order": np.array([2, 0, -1, 1]), "halves": np.array([1, 3]), "row": ROW[None]}


@pytest.mark.parametrize("name", OPERATORS)
def test_each_operator_answers_as_onnx_does(name):
    net = model(HEAD_ONLY + OPERATORS[name] + TAIL, **CONSTANTS)
    agrees(net, from_onnx(net), np.random.default_rng(1))


@pytest.mark.parametrize("attributes", ["", "<transA=0, transB=1>", "<alpha=0.5, beta=-2.0, transB=1>"])
@pytest.mark.parametrize("addend", ["", ", r"])
def test_gemm_in_all_its_forms(attributes, addend):
    square = RNG.normal(size=(4, 4))
    net = model(f"z = Gemm {attributes} (y, S{addend})\nu = Relu(z)", p=4, S=square, r=ROW)
    agrees(net, from_onnx(net), np.random.default_rng(2))


def test_gemm_with_the_signal_on_the_right_and_as_addend():
    net = model(
        "t = Transpose(y)\nz = Gemm <transB=0> (S, t)\nw = Relu(z)\nv = Transpose(w)\nu = Gemm <beta=3.0> (v, S, y)",
        p=3,
        S=RNG.normal(size=(3, 3)),
    )
    inc = from_onnx(net)
    agrees(net, inc, np.random.default_rng(3))
    assert np.any(inc.K)


def test_a_plain_network_becomes_its_layers_bit_for_bit():
    net = model("z = Gemm <transB=1> (y, W1, b1)\nh = Tanh(z)\nx = Gemm <transB=1> (h, W2, b2)\ng = Tanh(x)\n"
                "u = Gemm <transB=1> (g, W3, b3)", W1=A.T, b1=ROW, W2=B, b2=ROW[::-1], W3=C.T, b3=PAIR)
    inc, layers = from_onnx(net), INC.from_layers([(A.T, ROW), (B, ROW[::-1]), (C.T, PAIR)], Tanh())
    for part in ("W", "U", "V", "K", "b", "d"):
        np.testing.assert_array_equal(getattr(inc, part), getattr(layers, part))
    assert inc.activations == layers.activations


def test_each_activation_entry_is_one_hidden_unit():
    net = model(
        HEAD_ONLY + "w = Relu(z)\nt = MatMul(w, B)\ns = Clip(t, lo, hi)\nx = Add(s, w)\nh = Tanh(x)" + TAIL, **CONSTANTS
    )
    inc = from_onnx(net)
    assert inc.activations == (ReLU(),) * 4 + (Saturation(),) * 4 + (Tanh(),) * 4
    assert not np.any(np.triu(inc.W)) and inc.contraction.holds


def test_units_of_the_simplest_kind_are_chosen():
    net = model("h = PRelu(y, s)\nu = LeakyRelu <alpha=-0.5> (h)", s=[0.0, 0.3, 2.0])
    assert from_onnx(net).activations[:3] == (ReLU(), LeakyReLU(0.3), TwoSlopes(2.0, 1.0))
    assert from_onnx(net).activations[3] == TwoSlopes(-0.5, 1.0)


def test_normalization_of_the_input_moves_into_the_weights():
    mean, std = np.array([1.0, -2.0, 30.0]), np.array([0.5, 2.0, 10.0])
    net = model("c = Sub(y, mean)\nn = Div(c, std)\nz = MatMul(n, A)\nh = Sigmoid(z)\nv = MatMul(h, C)\ng = Mul(v, five)\n"
                "u = Add(g, r)", mean=mean, std=std, A=A, C=C, five=5.0, r=PAIR)
    inc = from_onnx(net)
    np.testing.assert_allclose(inc.U, (A / std[:, None]).T, rtol=1e-15)
    assert inc.activations == (Logistic(),) * 4 and not inc.K.any()
    agrees(net, inc, np.random.default_rng(4))


def test_a_clip_stays_within_its_limits_exactly():
    """In fractions center + half width <= high: what certificates of limits ask for."""
    rounded_outward = (-1.009618183538736, -0.20917557487171307)  # (low + high) / 2 + (high - low) / 2 > high in floats
    for low, high in [rounded_outward, *np.sort(np.random.default_rng(12).normal(size=(5, 2)), axis=1).tolist()]:
        inc = from_onnx(model("u = Clip(y, lo, hi)", lo=low, hi=high))
        center, half = Fraction(inc.d[0]), Fraction(inc.V[0, 0])
        assert center + half <= Fraction(high) and center - half >= Fraction(low)
        assert inc(3 * [(low + high) / 2])[0] == pytest.approx((low + high) / 2, abs=1e-12)


@pytest.mark.parametrize("first", ["1", "N"])
def test_single_precision_networks_are_read_as_they_are_stored(first):
    net = model("z = Gemm <transB=1> (y, W1, b1)\nh = Relu(z)\nu = Gemm <transB=1> (h, W2, b2)", kind="float", first=first,
                W1=A.T, b1=ROW, W2=C.T, b2=PAIR)
    inc = from_onnx(net)
    np.testing.assert_array_equal(inc.U, A.T.astype(np.float32).astype(float))
    agrees(net, inc, np.random.default_rng(5))


def test_the_runtime_of_others_agrees():
    runtime = pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")
    net = model(
        HEAD_ONLY + "w = Relu(z)\nt = MatMul(w, B)\ns = Clip(t, lo, hi)\nh = Add(s, z)" + TAIL, kind="float", **CONSTANTS
    )
    session = runtime.InferenceSession(net.SerializeToString(), providers=["CPUExecutionProvider"])
    points = np.random.default_rng(6).normal(size=(3, 200)).astype(np.float32)
    theirs = session.run(None, {"y": points.T})[0].T
    np.testing.assert_allclose(from_onnx(net)(points.astype(float)), theirs, atol=2e-5)


def test_older_operator_sets_keep_limits_and_axes_in_attributes():
    net = model(
        HEAD_ONLY + "w = Clip <min=-0.5, max=0.75> (z)\nt = Unsqueeze <axes=[0]> (w)\nh = Squeeze <axes=[0]> (t)" + TAIL,
        opset=9,
        **CONSTANTS,
    )
    agrees(net, from_onnx(net), np.random.default_rng(8))


def test_what_the_output_does_not_need_is_left_out_and_outputs_are_named():
    net = model("h = Relu(y)\nu = Neg(h)\nv = Exp(y)", outputs="u v")
    assert from_onnx(net, output="u").q == 3
    with pytest.raises(TranslationError, match="outputs 'u', 'v'"):
        from_onnx(net)
    with pytest.raises(TranslationError, match="Exp"):
        from_onnx(net, output="v")


def test_local_functions_are_taken_apart():
    text = (
        '<ir_version: 8, opset_import: ["" : 17, "mine" : 1]>\nnet (double[N,2] y) => (double[N,2] u) '
        '{ u = mine.twice (y) }\n<domain: "mine", opset_import: ["" : 17]>\ntwice (a) => (c) { b = Relu(a)\n c = Add(b, b) }'
    )
    inc = from_onnx(onnx.parser.parse_model(text))
    assert inc([1.5, -2.0]).tolist() == [3.0, 0.0]


@pytest.mark.parametrize(("text", "words"), [
    ("u = Softmax(y)", r"\(Softmax\): the operator has no counterpart.*Relu"),
    ("h = Relu(y)\nu = Mul(h, y)", r"\(Mul\): both factors depend"),
    ("t = Transpose(y)\nu = MatMul(t, y)", r"\(MatMul\): both factors depend"),
    ("u = Clip(y, y)", r"\(Clip\): its input 1 depends"),
    ("u = Clip(y, hi, lo)", r"\(Clip\): the limits \[0.75, -0.5\] are not an interval"),
    ("c = Cast <to=7> (y)\nu = Relu(c)", r"\(Cast\): it turns a signal into something else"),
    ("u = Div(lo, y)", r"\(Div\): "), ("u = Div(y, zero)", r"\(Div\): it divides by zero"),
    ("u = MatMul(y, A)\n", ""), ("u = Reshape(y, odd)", r"\(Reshape\): cannot reshape"),
    ("u = Gather <axis=5> (y, order)", r"\(Gather\): axis 5 is not one of 2"),
    ("u = BatchNormalization <training_mode=1> (y, r3, r3, r3, r3)", r"\(BatchNormalization\): it normalizes by the batch"),
    ("h = Relu(nothing)\nu = Add(h, y)", r"reads 'nothing', which nothing computes"),
    ("u = Identity(A)", "does not depend on the input 'y'"),
])
def test_refusals_name_the_node(text, words):
    net = model(text, r3=np.ones(3), zero=0.0, odd=np.array([2, 2]), **CONSTANTS)
    if not words:
        assert from_onnx(net).q == 0
        return
    with pytest.raises(TranslationError, match=words) as error:
        from_onnx(net)
    assert isinstance(error.value, INCError)


def test_named_nodes_are_named():
    net = model("u = Softmax(y)")
    net.graph.node[0].name = "/actor/3"
    with pytest.raises(TranslationError, match="node '/actor/3'"):
        from_onnx(net)


def test_entries_that_are_none():
    with pytest.raises(TranslationError, match="one input.*'x', 'y'"):
        from_onnx(onnx.parser.parse_model(HEAD + "net (double[N,2] x, double[N,2] y) => (double[N,2] u) { u = Add(x, y) }"))
    with pytest.raises(TranslationError, match="no tensor of floats"):
        from_onnx(onnx.parser.parse_model(HEAD + "net (int64[N,2] y) => (int64[N,2] u) { u = Identity(y) }"))
    with pytest.raises(TranslationError, match="number of measurements is not known"):
        from_onnx(onnx.parser.parse_model(HEAD + "net (double[N,M] y) => (double[N,M] u) { u = Relu(y) }"))
    with pytest.raises(TranslationError, match="path or an onnx.ModelProto"):
        from_onnx(3)
    with pytest.raises(OSError):
        from_onnx("no-such-file.onnx")


def test_a_file_and_the_class_method(tmp_path):
    net = model("u = Relu(y)")
    onnx.save(net, tmp_path / "net.onnx")
    assert INC.from_onnx(tmp_path / "net.onnx")([1.0, -1.0, 2.0]).tolist() == [1.0, 0.0, 2.0]
    assert INC.from_onnx(str(tmp_path / "net.onnx")).q == 3
