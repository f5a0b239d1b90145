"""Sets of states and inputs, and distributions of the initial state."""

from .base import Distribution, Set
from .box import Box
from .ellipsoid import Ellipsoid
from .empirical import Empirical
from .gaussian import Gaussian
from .moments import Moments
from .polytope import Polytope
from .uniform import Uniform, as_distribution

__all__ = [
    "Box", "Distribution", "Ellipsoid", "Empirical", "Gaussian", "Moments", "Polytope", "Set", "Uniform", "as_distribution",
]
