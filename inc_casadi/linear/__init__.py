"""Linear controllers, static and dynamic, and what they cost; what neural controllers are measured against."""

from .best_dynamic import best_dynamic_linear
from .clipped_cost import ClippedCost, clipped_cost
from .controller import LinearController
from .dynamic_loop import dynamic_loop
from .kept_gain import best_kept_gain
from .linear_cost import LinearCost, linear_cost
from .lqg import lqg
from .regulator import damped_plant, discounted_lqr
from .static_gain import StaticGain, best_static_gain, scaled_lqr_gain
from .unswitched_cost import UnswitchedCost, unswitched_cost

__all__ = [
    "ClippedCost", "LinearController", "LinearCost", "StaticGain", "UnswitchedCost", "best_dynamic_linear", "best_kept_gain",
    "best_static_gain", "clipped_cost", "damped_plant", "discounted_lqr", "dynamic_loop", "linear_cost", "lqg",
    "scaled_lqr_gain", "unswitched_cost",
]
