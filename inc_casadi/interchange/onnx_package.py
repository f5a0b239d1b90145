"""The onnx package, imported only when it is needed."""

from __future__ import annotations

from typing import Any

from ..errors import SolverError


def onnx_package() -> Any:
    """Return the package `onnx` with its reference evaluator.

    Raises SolverError when it is not installed.

    >>> onnx_package().__name__
    'onnx'
    """
    try:
        import onnx
        import onnx.inliner
        import onnx.reference
    except ImportError as error:
        raise SolverError("ONNX files need the package onnx: pip install 'inc-casadi[onnx]'") from error
    return onnx
