"""Pictures of results and of motions; the only place where the toolbox imports matplotlib, and never pyplot."""

from .result_figure import plot_result
from .trajectory_figure import plot_trajectories

__all__ = ["plot_result", "plot_trajectories"]
