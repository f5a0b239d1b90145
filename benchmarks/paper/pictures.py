"""The two figures of the paper's separation results, drawn from exact numbers."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.baselines import saturated_lqr
from benchmarks.plants import scalar, two_state
from inc_casadi import INC, bounds
from inc_casadi.linear.static_gain import best_static_gain, scaled_lqr_gain
from inc_casadi.plotting.cost_panel import AT_LEAST, AT_MOST, FOUND, Row
from inc_casadi.plotting.separation_figure import plot_separation
from inc_casadi.plotting.two_state_figure import plot_two_states

from .scalar_figure import SHOWN
from .separation import exact_cost

MOVES, CELLS = 20, 10_000
START = (0.8, 0.8)


def draw_all(folder: str | Path) -> list[Path]:
    """Write both figures into a folder, which is made when missing, and return where they are.

    The scalar one twice: for r = 0 as the paper has it, where counting more moves adds nothing because a linear controller
    with memory attains the bound of the first one; and for r = 0.1, where it does.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / name for name in ("scalar_separation.png", "scalar_separation_input_cost.png", "two_states.png")]
    scalar_separation(0.0, paths[0])
    scalar_separation(0.1, paths[1])
    two_states(paths[2])
    return paths


def scalar_separation(r: float = 0.0, path: str | Path | None = None) -> Figure:
    """Return fig:scalar_separation, with what linear controllers cost at least over 20 moves as a curve more.

    r: weight of the input.
    """
    floors = [float(bounds.affine_moves(*scalar(float(beta), r)[:2], MOVES)) for beta in SHOWN]
    return plot_separation(bounds.ScalarSeparation(1.0, r), (SHOWN, floors), path)


def two_states(path: str | Path | None = None) -> Figure:
    """Return fig:two_state_numerics: the clipped regulator's cost is exact there, not sampled."""
    plant, spec, _ = case = two_state()
    law, best, scaled = saturated_lqr(plant, spec), best_static_gain(plant, spec), scaled_lqr_gain(plant, spec)
    rows = [
        Row("clipped LQR", exact_cost(case, law), AT_MOST),
        Row("best static gain", best.cost, FOUND),
        Row("scaled LQR gain", scaled.cost, FOUND),
        Row("any controller", float(bounds.any_controller(plant, spec, CELLS)), AT_LEAST),
        Row("linear controllers", float(bounds.affine_moves(plant, spec, MOVES)), AT_LEAST),
    ]
    laws = {"clipped LQR": law, "best static gain": INC.linear(best.F), "scaled LQR gain": INC.linear(scaled.F)}
    return plot_two_states(plant, spec, laws, rows, START, path)
