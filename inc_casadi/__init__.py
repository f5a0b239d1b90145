"""inc_casadi: describe, evaluate and certify implicit neural controllers of linear plants.

eta = phi(W eta + U y + b), u = K y + V eta + d. Importing this package loads NumPy only; the solvers come in with the verbs
that need them.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from . import errors
from .activations import CenteredLogistic, Identity, LeakyReLU, Logistic, ReLU, Saturation, Tanh
from .errors import INCError
from .inc import INC
from .loop import close_loop, equilibrium
from .plant import Plant
from .sets import Box, Ellipsoid, Empirical, Gaussian, Polytope, Uniform
from .simulate import simulate
from .spec import Spec

_LATER = {
    "certify": "certify", "Certificate": "certificate", "Stability": "claims", "DiscountedCost": "claims",
    "Regional": "claims", "load": "interchange", "save": "interchange",
}

__all__ = [
    "Box", "CenteredLogistic", "Certificate", "DiscountedCost", "Ellipsoid", "Empirical", "Gaussian", "INC", "INCError",
    "Identity", "LeakyReLU", "Logistic", "Plant", "Polytope", "ReLU", "Regional", "Saturation", "Spec", "Stability",
    "Tanh", "Uniform", "bounds", "certify", "close_loop", "equilibrium", "errors", "load", "save", "simulate",
]


def __getattr__(name: str) -> Any:
    if name == "bounds":
        return import_module(".bounds", __name__)
    if name in _LATER:
        value = getattr(import_module(f".{_LATER[name]}", __name__), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'inc_casadi' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
