"""What can be proved of a law against a specification: one judge, read by comparisons and by the gate of synthesis."""

from .causes import Cause
from .findings import Passed, Refused
from .judge import Judgement, judge

__all__ = ["Cause", "Judgement", "Passed", "Refused", "judge"]
