"""synthesis: find a controller worth certifying. `synthesize(plant, spec)` is the main verb."""

from inc_casadi import Spec

from .dynamic_result import DynamicAttempt, DynamicResult
from .dynamic_synthesis import synthesize_dynamic
from .gate import Verdict
from .result import Attempt, Result
from .storage import SavedResult, load_result
from .synthesize import synthesize

__all__ = ["Attempt", "DynamicAttempt", "DynamicResult", "Result", "SavedResult", "Spec", "Verdict", "load_result",
           "synthesize", "synthesize_dynamic"]
