"""The onnx package, imported only when it is needed, with its file reader and its evaluator."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..errors import SolverError, TranslationError


def onnx_package() -> Any:
    """Return the package `onnx` with its reference evaluator.

    Raises SolverError when it is not installed.

    >>> onnx_package().__name__
    'onnx'
    """
    try:
        import onnx
        import onnx.inliner
        import onnx.parser
        import onnx.reference
        import onnx.reference.op_run
    except ImportError as error:
        raise SolverError("ONNX files need the package onnx: pip install 'inc-casadi[onnx]'") from error
    return onnx


def model_of(source: Any) -> Any:
    """Return the `onnx.ModelProto` of a path, or the given one, with all weights in it.

    Raises
    ------
    TranslationError : it is neither; the file is no ONNX model; weights in a file beside it are missing
    OSError : the file cannot be read

    >>> model_of(3)
    Traceback (most recent call last):
    inc_casadi.errors.TranslationError: the model must be a path or an onnx.ModelProto, not int
    """
    onnx = onnx_package()
    from google.protobuf.message import DecodeError  # comes with onnx

    if not isinstance(source, str | Path | onnx.ModelProto):
        raise TranslationError(f"the model must be a path or an onnx.ModelProto, not {type(source).__name__}")
    if isinstance(source, onnx.ModelProto):
        for one in source.graph.initializer:
            if onnx.external_data_helper.uses_external_data(one):
                raise TranslationError(f"the weights {one.name!r} of the model are in another file, and were not loaded "
                                       "with it: give the path of the model")
        return source
    try:
        return onnx.load(str(source))
    except DecodeError as error:
        raise TranslationError(f"{source} is no ONNX model: {error}") from error
    except onnx.checker.ValidationError as error:
        raise TranslationError(f"{source} has weights in another file, which cannot be read: {error}") from error


def evaluator(model: Any) -> Any:
    """Return ONNX's own evaluator of a model, with one mistake mended.

    In operator sets 7 to 13 a BatchNormalization with one output normalizes by the given mean and variance (test mode), but
    `onnx.reference` mixes those of the batch in.

    >>> text = ('<ir_version: 8, opset_import: ["" : 9]> n (double[1,1] y, double[1] s) => (double[1,1] u) '
    ...         '{ u = BatchNormalization <epsilon=0.0> (y, s, s, s, s) }')
    >>> y, s = np.array([[9.0]]), np.array([4.0])
    >>> evaluator(onnx_package().parser.parse_model(text)).run(None, {"y": y, "s": s})[0].tolist()
    [[14.0]]
    """
    onnx = onnx_package()

    class BatchNormalization(onnx.reference.op_run.OpRun):  # type: ignore[misc, name-defined]
        op_domain = ""

        def _run(self, x: Any, scale: Any, shift: Any, mean: Any, variance: Any, epsilon: Any = None, **others: Any) -> Any:
            rows = [value.reshape(-1, *[1] * (x.ndim - 2)) for value in (scale, shift, mean, variance)]
            return ((rows[0] * (x - rows[2]) / np.sqrt(rows[3] + epsilon) + rows[1]).astype(x.dtype),)

    old = any(one.domain in ("", "ai.onnx") and 7 <= one.version < 14 for one in model.opset_import)
    return onnx.reference.ReferenceEvaluator(model, new_ops=[BatchNormalization] if old else None)
