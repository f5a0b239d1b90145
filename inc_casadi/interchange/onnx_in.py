"""Read a network from ONNX: its graph is walked once, and what it computes is stacked into one INC."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import TranslationError
from ..inc import INC
from .onnx_check import check_answers
from .onnx_ml import DOMAIN
from .onnx_node import Condition, Node, Value
from .onnx_operators import translated
from .onnx_package import evaluator, model_of, onnx_package
from .signals import Signal, Stack

FLOATS: dict[int, np.dtype] = {1: np.dtype(np.float32), 10: np.dtype(np.float16), 11: np.dtype(np.float64)}


def from_onnx(source: Any, output: str | None = None) -> INC:
    """Return the network of an ONNX model as an INC that computes the same function.

    Each entry of an activation is a hidden unit; what lies between is affine and is composed, skip connections and
    normalization by constants included, so that eta = phi(W eta + U y + b) with W strictly lower triangular and
    u = K y + V eta + d. Clip with two limits is a scaled saturation, with one a shifted ReLU; so are Max and Min, and
    choices by comparison (where z > 0, say) that do not jump.

    The result is compared with `onnx.reference.ReferenceEvaluator` at random points and at kinks of all units, and may
    differ by rounding only (`onnx_check.check_answers` states how much). Numbers are taken as they are stored, so in double
    precision the INC is the exact network that single precision approximates.

    Parameters
    ----------
    source : a path, or an `onnx.ModelProto`, of one input and, unless `output` names one, one output. Free sizes, such as
        that of a batch, are taken as 1; the entries of the input in C order are y, those of the output u
    output : the name of the output that is u

    Raises
    ------
    TranslationError : an operator that has no counterpart, by name of its node; several inputs; an answer that differs; a
        file that is no ONNX model, or whose weights, kept in a file beside it, are missing
    SolverError : onnx is not installed
    OSError : the file cannot be read

    Notes
    -----
    The feedforward networks of the paper are INCs with W nilpotent (sec:inc). Operators: `onnx_operators.OPERATORS`.

    Examples
    --------
    >>> from inc_casadi import ReLU
    >>> from inc_casadi.interchange.onnx_out import to_onnx
    >>> net = INC.from_layers([([[1.0, -1.0]], [0.5]), ([[2.0]], [1.0])], ReLU())
    >>> from_onnx(to_onnx(net))([3.0, 1.0]).tolist() == net([3.0, 1.0]).tolist() == [6.0]
    True
    """
    onnx = onnx_package()
    model = model_of(source)
    if model.functions:
        model = onnx.inliner.inline_local_functions(model)
    entry, wanted = _entry(model.graph), _wanted(model.graph, output)
    dtype, shape = _type(entry), _shape(entry)
    stack = Stack(int(np.prod(shape, dtype=int)))
    values: dict[str, Value] = {one.name: onnx.numpy_helper.to_array(one) for one in model.graph.initializer}
    values |= {"": None, entry.name: Signal.measurement(shape)}
    nodes = _needed(model.graph, wanted)
    for node in nodes:
        values |= _computed(onnx, model, node, values, stack)
    found = values[wanted]
    if not isinstance(found, Signal):
        raise TranslationError(f"the output {wanted!r} does not depend on the input {entry.name!r}")
    inc = stack.controller(found)
    original = evaluator(model)

    def answers(y: Array) -> Array:
        return np.ravel(original.run([wanted], {entry.name: y.reshape(shape)})[0])

    check_answers(inc, stack.majorant(found), answers, len(nodes), dtype)
    return inc


def _entry(graph: Any) -> Any:
    constants = {one.name for one in graph.initializer}
    entries = [one for one in graph.input if one.name not in constants]
    if len(entries) != 1:
        names = ", ".join(repr(one.name) for one in entries) or "none"
        raise TranslationError(f"the network must have one input, the measurement y, but has {names}")
    return entries[0]


def _wanted(graph: Any, output: str | None) -> str:
    names = [one.name for one in graph.output]
    if output is None and len(names) == 1:
        return str(names[0])
    if output is None or output not in names:
        raise TranslationError(f"the network has the outputs {', '.join(map(repr, names))}: name one of them as output")
    return output


def _type(entry: Any) -> np.dtype:
    kind = entry.type.tensor_type.elem_type
    if kind not in FLOATS:
        raise TranslationError(f"the input {entry.name!r} is no tensor of floats: its ONNX type is {kind}")
    return FLOATS[kind]


def _shape(entry: Any) -> tuple[int, ...]:
    if not entry.type.tensor_type.HasField("shape"):
        raise TranslationError(f"the input {entry.name!r} has no shape, so the number of measurements is not known")
    sizes = [size.dim_value if size.HasField("dim_value") else None for size in entry.type.tensor_type.shape.dim]
    if len(sizes) > 1 and sizes[-1] is None or 0 in sizes:
        raise TranslationError(f"the input {entry.name!r} has the shape {sizes}, so the number of measurements is not known")
    return tuple(1 if size is None else int(size) for size in sizes)


def _needed(graph: Any, output: str) -> list[Any]:
    """The nodes that the output depends on, in their order."""
    wanted, kept = {output}, []
    for node in reversed(graph.node):
        if wanted & set(node.output):
            wanted |= set(node.input)
            kept.append(node)
    return kept[::-1]


def _computed(onnx: Any, model: Any, node: Any, values: dict[str, Value], stack: Stack) -> dict[str, Value]:
    name = node.name or (node.output[0] if node.output else "")
    missing = [one for one in node.input if one not in values]
    if missing:
        raise TranslationError(f"node {name!r} ({node.op_type}) reads {missing[0]!r}, which nothing computes")
    inputs = [values[one] for one in node.input]
    evaluated = partial(_evaluated, onnx, model, node, name)
    if any(isinstance(value, Signal | Condition) for value in inputs):
        attributes = {one.name: onnx.helper.get_attribute_value(one) for one in node.attribute}
        if node.domain not in ("", "ai.onnx", DOMAIN):
            raise TranslationError(f"node {name!r} ({node.op_type}) is of the domain {node.domain!r}, which is not read")
        found = translated(Node(node.op_type, name, attributes, inputs, stack, len(node.output), evaluated))
    else:
        found = evaluated(inputs)
    return dict(zip(node.output, found, strict=False))


def _evaluated(onnx: Any, model: Any, node: Any, name: str, inputs: list[Any]) -> tuple[np.ndarray, ...]:
    """What a node gives that reads constants only: whatever ONNX's own evaluator says."""
    helper = onnx.helper
    held = [onnx.numpy_helper.from_array(np.asarray(value), given)
            for given, value in zip(node.input, inputs, strict=True) if given]
    outputs = [helper.make_empty_tensor_value_info(one) for one in node.output]
    graph = helper.make_graph([node], "alone", [], outputs, held)
    alone = helper.make_model(graph, opset_imports=model.opset_import)
    try:
        return tuple(np.asarray(value) for value in onnx.reference.ReferenceEvaluator(alone).run(None, {}))
    except (NotImplementedError, RuntimeError, TypeError, ValueError) as error:
        raise TranslationError(f"node {name!r} ({node.op_type}) cannot be computed by ONNX's evaluator: {error}") from error
