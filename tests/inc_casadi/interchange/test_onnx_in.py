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
        value = value if value.dtype.kind in "iub" else value.astype(dtype)
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
    "Expand": "w = Expand(z, shape_up)\nt = Relu(w)\nh = Slice(t, zero_at, one, zero_at)",
    "Tile": "w = Tile(z, twice)\nt = Relu(w)\nh = Slice(t, two, six, one)",
    "Pad": "w = Pad(z, pads, hi)\nt = Relu(w)\nh = Slice(t, zero_at, four, one)",
    "Pad by reflection": 'w = Pad <mode="reflect"> (z, pads)\nt = Relu(w)\nh = Slice(t, zero_at, four, one)',
    "CumSum": "w = CumSum(z, last)\nh = Relu(w)",
    "Einsum": 'w = Einsum <equation="ij,bj->bi"> (B, z)\nh = Relu(w)',
    "GatherND": "t = Transpose(z)\nw = GatherND(t, picks)\ns = Transpose(w)\nh = Relu(s)",
    "GatherElements": "w = GatherElements <axis=1> (z, places)\nh = Relu(w)",
    "Conv": "w = Unsqueeze(z, one)\nt = Conv(w, kernel, bias3)\ns = Relu(t)\nv = Flatten(s)\nh = Slice(v, two, six, one)",
    "AveragePool": "w = Unsqueeze(z, one)\nt = AveragePool <kernel_shape=[2], pads=[0, 1]> (w)\nv = Flatten(t)\nh = Relu(v)",
    "ReduceMax": "w = Reshape(z, shape3)\nt = ReduceMax <axes=[2], keepdims=1> (w)\ns = Sub(w, t)\nh = Reshape(s, shape2)",
    "ReduceMin": "w = ReduceMin <axes=[-1], keepdims=0> (z)\nt = Unsqueeze(w, last1)\nh = Sub(z, t)",
    "ReduceMax of three": "w = Slice(z, one, four, one)\nt = ReduceMax <axes=[1]> (w)\nh = Sub(z, t)",
    "Where": "c = Greater(z, r)\nw = Mul(z, two_)\nt = Add(w, lo)\ns = Add(r, z)\nv = Add(s, lo)\nh = Where(c, t, v)",
    "Where with two slopes": "c = GreaterOrEqual(z, nil)\nw = Mul(z, lo)\nh = Where(c, w, z)",
    "Where with one": "c = Less(z, nil)\nn = Not(c)\nd = Sub(z, z)\nh = Where(n, d, z)",
    "Where with rounded slopes": "c = Greater(z, nil)\nw = Mul(z, r)\nt = Mul(w, r)\ns = Mul(t, r)\nh = Where(c, s, z)",
    "Where by a constant": "w = Relu(z)\nh = Where(mask, w, z)",
    "a mask as a factor": "c = LessOrEqual(z, nil)\nf = Cast <to=11> (c)\nw = Mul(f, z)\nh = Mul(w, r)",
    "part of a shape": "n = Shape <start=1> (z)\nw = Reshape(z, n)\nt = Gather(w, order)\nh = Unsqueeze(t, zero_at)",
    "Constant": "k = Constant <value = double[4] {1.0, -2.0, 0.5, 3.0}> ()\ns = Exp(k)\nw = Add(z, s)\nh = Relu(w)",
}
CONSTANTS = {"A": A, "B": B, "C": C, "r": ROW, "lo": -0.5, "hi": 0.75, "lo4": PAIR.repeat(2), "hi4": -PAIR.repeat(2),
             "pos": np.abs(ROW), "shape3": np.array([-1, 2, 2]), "shape2": np.array([0, 4]), "axes": np.array([0, -1]),
             "one": np.array([1]), "two": np.array([2]), "six": np.array([6]), "minus_one": np.array([-1]),
             "minus_nine": np.array([-9]), "order": np.array([2, 0, -1, 1]), "halves": np.array([1, 3]), "row": ROW[None],
             "shape_up": np.array([2, 4]), "zero_at": np.array([0]), "twice": np.array([1, 2]), "four": np.array([4]),
             "pads": np.array([0, 2, 0, 1]), "last": np.array(-1), "picks": np.array([[3], [0], [0], [2]]), "nil": 0.0,
             "places": np.array([[3, 3, 0, 1]]), "kernel": RNG.normal(size=(3, 1, 2)), "bias3": RNG.normal(size=3),
             "last1": np.array([-1]), "two_": 2.0, "mask": np.array([True, False, False, True])}


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


def test_operators_that_only_scikit_learn_writes():
    text = ('<ir_version: 8, opset_import: ["" : 17, "ai.onnx.ml" : 3]>\nnet (double[N,2] y) => (double[N,2] u) { '
            's = ai.onnx.ml.Scaler <offset=[1.0, -2.0], scale=[0.5, 4.0]> (y)\nu = ai.onnx.ml.LinearRegressor '
            '<coefficients=[1.0, 2.0, 3.0, 4.0], intercepts=[0.5, 0.25], targets=2> (s) }')
    inc = from_onnx(onnx.parser.parse_model(text))
    s = np.array([0.5 * (3.0 - 1.0), 4.0 * (5.0 + 2.0)])  # by hand, from ONNX's definition
    assert inc([3.0, 5.0]).tolist() == [s[0] + 2 * s[1] + 0.5, 3 * s[0] + 4 * s[1] + 0.25]
    with pytest.raises(TranslationError, match=r"LinearRegressor\): its post_transform b'PROBIT' is not read"):
        from_onnx(onnx.parser.parse_model(text.replace("targets=2", 'targets=2, post_transform="PROBIT"')))


def test_batches_are_normalized_by_given_numbers_in_old_operator_sets_too():
    """By ONNX's definition of sets 7 to 13 for a node with one output; its evaluator takes those of the batch."""
    net = model("u = BatchNormalization <epsilon=0.0> (y, r3, r3, two3, four3)", opset=9, r3=np.ones(3), two3=2 * np.ones(3),
                four3=4 * np.ones(3))
    assert from_onnx(net)([2.0, 4.0, -2.0]).tolist() == [1.0, 2.0, -1.0]


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
    ("c = Greater(y, lo)\nu = Where(c, y, r3)", r"\(Where\): the two values differ where the condition changes"),
    ("c = Greater(y, lo)\nf = Cast <to=1> (c)\nu = Mul(f, r3)", r"\(Mul\): a comparison times a constant jumps"),
    ("c = Greater(y, lo)\nf = Cast <to=1> (c)\nu = Add(f, y)", r"\(Add\): it reads a comparison .* only go to Cast, Mul"),
    ("c = Greater(y, lo)\nu = Where(c, c, y)", r"\(Where\): its input 1 is a comparison"),
    ("u = Einsum <equation=\"bi,bi->bi\"> (y, y)", r"\(Einsum\): its inputs \[0, 1\] depend"),
    ("s = ReduceSum <keepdims=0> (y)\nu = Pad(A, pads, s)", r"\(Pad\): its inputs \[2\] depend"),
    ("u = Tile(y, order)", r"node 'u' \(Tile\) cannot be computed by ONNX's evaluator"),
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
