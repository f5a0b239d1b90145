"""Linear controllers: the regulator, static gains and what they cost; what neural controllers are measured against."""

from .regulator import damped_plant, discounted_lqr
from .static_gain import StaticGain, best_static_gain, scaled_lqr_gain

__all__ = ["StaticGain", "best_static_gain", "damped_plant", "discounted_lqr", "scaled_lqr_gain"]
