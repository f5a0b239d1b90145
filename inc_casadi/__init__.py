"""inc_casadi: describe, evaluate and certify implicit neural controllers of linear plants.

eta = phi(W eta + U y + b), u = K y + V eta + d. Importing this package loads NumPy only; the solvers come in with the verbs
that need them.
"""

from . import bounds, errors
from .activations import CenteredLogistic, Identity, LeakyReLU, Logistic, ReLU, Saturation, Tanh
from .certificate import Certificate
from .certify import certify
from .claims import DiscountedCost, Regional, Stability
from .errors import INCError
from .inc import INC
from .interchange import load, save
from .loop import close_loop, equilibrium
from .plant import Plant
from .sets import Box, Ellipsoid, Empirical, Gaussian, Polytope, Uniform
from .simulate import simulate
from .spec import Spec

__all__ = [
    "Box", "CenteredLogistic", "Certificate", "DiscountedCost", "Ellipsoid", "Empirical", "Gaussian", "INC", "INCError",
    "Identity", "LeakyReLU", "Logistic", "Plant", "Polytope", "ReLU", "Regional", "Saturation", "Spec", "Stability",
    "Tanh", "Uniform", "bounds", "certify", "close_loop", "equilibrium", "errors", "load", "save", "simulate",
]
