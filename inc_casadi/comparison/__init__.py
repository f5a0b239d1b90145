"""Controllers against what no competitor of a class can undercut: costs, lower bounds, and the sentences that follow."""

from .compare import compare
from .comparison import Comparison

__all__ = ["Comparison", "compare"]
