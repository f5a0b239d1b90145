"""Claims, one promise per file."""

from .attraction import Attraction
from .base import Claim
from .deviation import DeviationCost
from .gain import L2Gain
from .invariance import Invariance
from .margins import Margins
from .performance import DiscountedCost
from .polytopic import Polytopic
from .regional import Regional
from .robust import Robust
from .stability import Stability
from .together import Together

__all__ = ["Attraction", "Claim", "DeviationCost", "DiscountedCost", "Invariance", "L2Gain", "Margins", "Polytopic",
           "Regional", "Robust", "Stability", "Together"]
