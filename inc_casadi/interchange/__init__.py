"""In and out: JSON files of what the toolbox knows, networks from elsewhere, ONNX, and systems for python-control."""

from .control_system import from_lqr, to_control
from .files import load, save
from .onnx_in import from_onnx
from .onnx_out import to_onnx
from .scaling import scaled
from .weights import from_keras_weights, from_state_dict

__all__ = [
    "from_keras_weights", "from_lqr", "from_onnx", "from_state_dict", "load", "save", "scaled", "to_control", "to_onnx",
]
