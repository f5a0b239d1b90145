"""Linear controllers, static and dynamic, and what they cost; what neural controllers are measured against."""

from .best_dynamic import best_dynamic_linear
from .controller import LinearController
from .dynamic_loop import dynamic_loop
from .linear_cost import LinearCost, linear_cost
from .lqg import lqg
from .regulator import damped_plant, discounted_lqr
from .static_gain import StaticGain, best_static_gain, scaled_lqr_gain

__all__ = [
    "LinearController", "LinearCost", "StaticGain", "best_dynamic_linear", "best_static_gain", "damped_plant",
    "discounted_lqr", "dynamic_loop", "linear_cost", "lqg", "scaled_lqr_gain",
]
