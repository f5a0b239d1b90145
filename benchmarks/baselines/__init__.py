"""What a controller is measured against: linear gains and the clipped regulator."""

from .linear import control_lqr_gain, dense_search, lyapunov_costs
from .saturated import saturated_lqr

__all__ = ["control_lqr_gain", "dense_search", "lyapunov_costs", "saturated_lqr"]
