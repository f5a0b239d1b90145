"""Wall times, each beside its target."""

from .evaluation import evaluation
from .exact_cost import exact_cost
from .imports import imports
from .main_job import main_job
from .measurement import Measurement, table

__all__ = ["Measurement", "evaluation", "exact_cost", "imports", "main_job", "table"]
