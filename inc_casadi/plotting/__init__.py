"""Pictures of results, motions and proofs; the only place where the toolbox imports matplotlib, and never pyplot."""

from .alternation_figure import plot_alternation
from .attraction_figure import plot_attraction
from .bounds_chart import plot_bounds
from .comparison_figure import plot_comparison
from .cost_panel import ABOUT, AT_LEAST, AT_MOST, FOUND, Row
from .difference_figure import plot_difference
from .interval_figure import Interval, plot_intervals
from .paths import converging
from .phase_portrait import plot_phase_portrait
from .reach_figure import plot_reachable
from .regions_figure import plot_regions
from .result_figure import plot_result
from .separation_figure import plot_separation
from .surface_figure import plot_cost
from .training_figure import plot_training
from .trajectory_figure import plot_trajectories
from .two_state_figure import plot_two_states

__all__ = [
    "ABOUT", "AT_LEAST", "AT_MOST", "FOUND", "Interval", "Row", "converging", "plot_alternation", "plot_attraction",
    "plot_bounds", "plot_comparison", "plot_cost", "plot_difference", "plot_intervals", "plot_phase_portrait",
    "plot_reachable", "plot_regions", "plot_result", "plot_separation", "plot_training", "plot_trajectories",
    "plot_two_states",
]
