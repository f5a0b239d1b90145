"""What a controller is measured against: linear control, clipped regulators, observers, predictive control."""

from .designs import BASELINES, Baseline, Designed, design
from .linear import control_lqr_gain, dense_search, lyapunov_costs
from .saturated import saturated_lqr

__all__ = [
    "BASELINES", "Baseline", "Designed", "control_lqr_gain", "dense_search", "design", "lyapunov_costs", "saturated_lqr",
]
