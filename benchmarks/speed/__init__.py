"""Wall times, each beside its target."""

from .alternation import alternation, alternation_table
from .certification import certification, certification_table, certification_targets
from .evaluation import evaluation
from .exact_cost import exact_cost
from .imports import imports
from .main_job import main_job
from .measurement import Measurement, table
from .pieces import pieces, pieces_table
from .single_evaluation import single_evaluation, single_table
from .training import quick_training, training, training_table

__all__ = ["Measurement", "alternation", "alternation_table", "certification", "certification_table",
           "certification_targets", "evaluation", "exact_cost", "imports", "main_job", "pieces", "pieces_table",
           "quick_training", "single_evaluation", "single_table", "table", "training", "training_table"]
