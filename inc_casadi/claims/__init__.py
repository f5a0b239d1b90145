"""Claims, one promise per file."""

from .base import Claim
from .performance import DiscountedCost
from .regional import Regional
from .stability import Stability

__all__ = ["Claim", "DiscountedCost", "Regional", "Stability"]
