"""What is not known of a plant, one kind per file, each with the quadratic constraint that it obeys."""

from .base import Uncertainty
from .input_sector import InputSector
from .norm_bounded import NormBounded

__all__ = ["InputSector", "NormBounded", "Uncertainty"]
