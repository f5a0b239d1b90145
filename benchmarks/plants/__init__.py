"""Plants with their specifications, each with its source."""

from .paper import Case, implicit_example, output_feedback, scalar, two_state
from .suite import suite

__all__ = ["Case", "implicit_example", "output_feedback", "scalar", "suite", "two_state"]
