"""inc_casadi: describe, evaluate and certify implicit neural controllers of linear plants.

eta = phi(W eta + U y + b), u = K y + V eta + d. Importing this package loads NumPy only; the solvers come in with the verbs
that need them.
"""

from . import bounds, errors
from .activations import CenteredLogistic, Identity, LeakyReLU, Logistic, ReLU, Saturation, Tanh
from .admissible_set import admissible_set
from .certificate import Certificate
from .certify import certify
from .claims import (
    Attraction,
    DeviationCost,
    DiscountedCost,
    Invariance,
    L2Gain,
    Margins,
    Polytopic,
    Regional,
    Robust,
    Stability,
    Together,
)
from .comparison import compare
from .errors import INCError
from .inc import INC
from .interchange import load, save
from .loop import close_loop, equilibrium
from .mpc import MPC
from .multipliers import Lifted
from .pieces.basin import region_of_attraction
from .pieces.critical_regions import CriticalRegions, feasible_set
from .pieces.difference import largest_difference
from .pieces.reach import reachable
from .pieces.regions import regions
from .pieces.scale import largest_scale
from .pieces.walk import Budget
from .plant import Plant
from .sets import Box, Ellipsoid, Empirical, Gaussian, Moments, Polytope, Uniform
from .simulate import simulate
from .spec import Spec
from .uncertainty import InputSector, NormBounded

__all__ = [
    "Attraction", "Box", "Budget", "CenteredLogistic", "Certificate", "CriticalRegions", "DeviationCost",
    "DiscountedCost", "Ellipsoid", "Empirical", "Gaussian", "INC", "INCError", "Identity", "InputSector", "Invariance",
    "L2Gain", "LeakyReLU", "Lifted", "Logistic", "MPC", "Margins", "Moments", "NormBounded", "Plant", "Polytope",
    "Polytopic", "ReLU", "Regional", "Robust", "Saturation", "Spec", "Stability", "Tanh", "Together", "Uniform",
    "admissible_set", "bounds", "certify", "close_loop", "compare", "equilibrium", "errors", "feasible_set",
    "largest_difference", "largest_scale", "load", "reachable", "region_of_attraction", "regions", "save", "simulate",
]
