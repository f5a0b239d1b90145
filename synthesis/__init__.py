"""synthesis: find a controller worth certifying. `synthesize(plant, spec)` is the main verb."""

from inc_casadi import Spec

from .result import Result
from .storage import load_result
from .synthesize import synthesize

__all__ = ["Result", "Spec", "load_result", "synthesize"]
