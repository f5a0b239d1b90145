"""Plants with their specifications, each with its source."""

from .paper import Case, implicit_example, output_feedback, scalar, two_state

__all__ = ["Case", "implicit_example", "output_feedback", "scalar", "two_state"]
