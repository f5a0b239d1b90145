"""Pictures of results, motions and proofs; the only place where the toolbox imports matplotlib, and never pyplot."""

from .attraction_figure import plot_attraction
from .difference_figure import plot_difference
from .reach_figure import plot_reachable
from .regions_figure import plot_regions
from .result_figure import plot_result
from .surface_figure import plot_cost
from .trajectory_figure import plot_trajectories

__all__ = ["plot_attraction", "plot_cost", "plot_difference", "plot_reachable", "plot_regions", "plot_result",
           "plot_trajectories"]
