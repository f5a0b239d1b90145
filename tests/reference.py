"""Reference data that others published, read where it lies; a test that needs it is skipped where it is absent."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from inc_casadi import INC

FOLDER = Path(__file__).resolve().parents[2] / "shared" / "reference"


def reference(name):
    """The parsed JSON file `name` of the reference folder, or a skipped test that says what is missing."""
    path = FOLDER / name
    if not path.exists():
        pytest.skip(f"reference data {name} is not here: {path.parent} is absent")
    return json.loads(path.read_text())


def network(data):
    """The feedforward ReLU network of a file with controller layers, as an INC."""
    layers = data["controller"]["layers"]
    return INC.from_layers([(np.array(layer["W"]), np.array(layer["b"])) for layer in layers])
