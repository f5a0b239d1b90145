"""inc_casadi: describe, evaluate and certify implicit neural controllers of linear plants.

eta = phi(W eta + U y + b), u = K y + V eta + d. Importing this package loads NumPy only; the solvers come in with the verbs
that need them.
"""

from . import bounds, errors
from .activations import CenteredLogistic, Identity, LeakyReLU, Logistic, ReLU, Saturation, Tanh
from .certificate import Certificate
from .certify import certify
from .claims import DeviationCost, DiscountedCost, L2Gain, Margins, Polytopic, Regional, Robust, Stability, Together
from .errors import INCError
from .inc import INC
from .interchange import load, save
from .loop import close_loop, equilibrium
from .multipliers import Lifted
from .plant import Plant
from .sets import Box, Ellipsoid, Empirical, Gaussian, Polytope, Uniform
from .simulate import simulate
from .spec import Spec
from .uncertainty import InputSector, NormBounded

__all__ = [
    "Box", "CenteredLogistic", "Certificate", "DeviationCost", "DiscountedCost", "Ellipsoid", "Empirical", "Gaussian", "INC",
    "INCError", "Identity", "InputSector", "L2Gain", "LeakyReLU", "Lifted", "Logistic", "Margins", "NormBounded", "Plant",
    "Polytope", "Polytopic", "ReLU", "Regional", "Robust", "Saturation", "Spec", "Stability", "Tanh", "Together", "Uniform",
    "bounds", "certify", "close_loop", "equilibrium", "errors", "load", "save", "simulate",
]
