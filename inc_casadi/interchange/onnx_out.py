"""Write a feedforward INC as an ONNX model: one Gemm and one activation for each level and kind of unit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..activations import (
    Activation,
    CenteredLogistic,
    Identity,
    LeakyReLU,
    Logistic,
    ReLU,
    Saturation,
    Tanh,
    TwoSlopes,
)
from ..activations.stack import groups
from ..arrays import Array
from ..errors import InvalidInputError, TranslationError
from ..fixed_point import feedforward_levels
from ..inc import INC
from .onnx_package import onnx_package

OPSET, IR_VERSION = 17, 8
SIMPLE: dict[type[Activation], str] = {ReLU: "Relu", Tanh: "Tanh", Logistic: "Sigmoid", Identity: "Identity"}


def to_onnx(inc: INC, path: str | Path | None = None, *, double: bool = True) -> Any:
    """Return a feedforward INC as an `onnx.ModelProto`, operator set 17, and write it to a path if one is given.

    A feedforward W is nilpotent: its units fall into levels that read earlier ones only. Each level is
    z = U y + W eta + b by one Gemm for the first thing that it reads and a MatMul for each further one, then its
    activation; blocks of zeros are left out, so a layered network becomes its layers again. The model reads "y", (N, p),
    and gives "u", (N, m), for any batch size N.

    Parameters
    ----------
    inc : with W nilpotent
    path : file to write, usually .onnx
    double : numbers as doubles, so that nothing is rounded; False rounds them to single precision, as most runtimes for
        small devices want them

    Raises
    ------
    TranslationError : W has a loop, or an activation has no ONNX operator
    SolverError : onnx is not installed

    Notes
    -----
    ONNX graphs have no cycles. An implicit law (W with a loop) can be written as C code with its own solver instead.

    Examples
    --------
    >>> model = to_onnx(INC.saturated([[2.0, 1.0]], 1.0))
    >>> [node.op_type for node in model.graph.node]
    ['Gemm', 'Clip', 'Gemm']
    """
    onnx = onnx_package()
    if not isinstance(inc, INC):
        raise InvalidInputError(f"inc must be an INC, not {type(inc).__name__}")
    levels = feedforward_levels(inc.W)
    if levels is None:
        raise TranslationError(f"W ({inc.q} x {inc.q}) has a loop: hidden units read one another in a circle, which an ONNX "
                               "graph cannot say; write C code instead (to_c), which solves the fixed point")
    writer = _Writer(onnx, np.dtype(np.float64 if double else np.float32))
    known: list[tuple[str, np.ndarray]] = []
    for level in levels:
        for unit, members in groups(tuple(inc.activations[i] for i in level)):
            rows = level[members]
            z = writer.affine(inc.U[rows], [(name, inc.W[np.ix_(rows, units)]) for name, units in known], inc.b[rows])
            known.append((writer.activation(unit, z), rows))
    writer.affine(inc.K, [(name, inc.V[:, units]) for name, units in known], inc.d, "u")
    model = writer.model(inc)
    onnx.checker.check_model(model)
    if path is not None:
        onnx.save(model, str(path))
    return model


class _Writer:
    """Nodes and constants as they come; names are numbered."""

    def __init__(self, onnx: Any, dtype: np.dtype) -> None:
        self.onnx, self.dtype = onnx, dtype
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, value: Array) -> str:
        name = f"c{len(self.constants)}"
        self.constants.append(self.onnx.numpy_helper.from_array(np.ascontiguousarray(value, dtype=self.dtype), name))
        return name

    def node(self, operator: str, *inputs: str, output: str = "", **attributes: Any) -> str:
        output = output or f"t{len(self.nodes)}"
        self.nodes.append(self.onnx.helper.make_node(operator, list(inputs), [output], name=f"{operator}_{len(self.nodes)}",
                                                     **attributes))
        return output

    def affine(self, on_y: Array, on_units: list[tuple[str, Array]], offset: Array, output: str = "") -> str:
        """Write on_y y + sum of weights times known units + offset, and return its name."""
        terms = [(name, weight) for name, weight in (("y", on_y), *on_units) if np.any(weight)] or [("y", on_y)]
        first, weight = terms[0]
        last = output if len(terms) == 1 else ""
        found = self.node("Gemm", first, self.constant(weight), self.constant(offset), output=last, transB=1)
        for i, (name, weight) in enumerate(terms[1:], 2):
            product = self.node("MatMul", name, self.constant(weight.T))
            found = self.node("Add", found, product, output=output if i == len(terms) else "")
        return found

    def activation(self, unit: Activation, z: str) -> str:
        """Write an activation, and return the name of its result."""
        if type(unit) in SIMPLE:
            return self.node(SIMPLE[type(unit)], z)
        if isinstance(unit, Saturation):
            return self.node("Clip", z, self.constant(np.array(-1.0)), self.constant(np.array(1.0)))
        if isinstance(unit, LeakyReLU):
            return self.leaky(unit.slope, z)
        if isinstance(unit, TwoSlopes):
            return self.two_slopes(unit, z)
        if isinstance(unit, CenteredLogistic):
            return self.node("Sub", self.node("Sigmoid", z), self.constant(np.array(0.5)))
        raise TranslationError(f"the activation {unit!r} has no ONNX operator")

    def leaky(self, slope: float, z: str) -> str:
        if float(np.float32(slope)) == slope or self.dtype == np.float32:
            return self.node("LeakyRelu", z, alpha=slope)
        return self.node("PRelu", z, self.constant(np.array([slope])))  # the attribute alpha is single precision

    def two_slopes(self, unit: TwoSlopes, z: str) -> str:
        if unit.right == 1.0:
            return self.node("PRelu", z, self.constant(np.array([unit.left])))
        right = self.node("Mul", self.node("Relu", z), self.constant(np.array(unit.right)))
        left = self.node("Mul", self.node("Relu", self.node("Neg", z)), self.constant(np.array(unit.left)))
        return self.node("Sub", right, left)

    def model(self, inc: INC) -> Any:
        helper, kind = self.onnx.helper, self.onnx.helper.np_dtype_to_tensor_dtype(self.dtype)
        ends = [[helper.make_tensor_value_info(name, kind, ["N", size])] for name, size in (("y", inc.p), ("u", inc.m))]
        graph = helper.make_graph(self.nodes, "inc", *ends, self.constants)
        return helper.make_model(graph, producer_name="inc_casadi", ir_version=IR_VERSION,
                                 opset_imports=[helper.make_opsetid("", OPSET)])
