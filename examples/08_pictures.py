"""Every picture of the toolbox, drawn from one plant: what each shows, and the one line that draws it.

The plant is the paper's two-state example, unstable and with a limited input. Nothing is drawn here that was not computed:
regions, reachable sets and costs are exact, certified sets come from certificates that hold, bounds are proved; what is
simulated or estimated says so in title or legend. The pictures go to the current folder.
"""

from __future__ import annotations

import numpy as np

from inc_casadi import (
    INC,
    Attraction,
    Box,
    DiscountedCost,
    Plant,
    Regional,
    Spec,
    certify,
    compare,
    largest_difference,
    reachable,
    region_of_attraction,
    regions,
    simulate,
)
from inc_casadi import plotting as draw
from inc_casadi.bounds import ScalarSeparation
from inc_casadi.linear import best_dynamic_linear, best_static_gain, discounted_lqr
from inc_casadi.pieces.walk import Budget
from inc_casadi.plotting.paths import converging
from synthesis import synthesize
from synthesis.alternation import alternate
from synthesis.starts.random_start import linear_start
from synthesis.training import train

Figures = dict[str, float]
PLANT = Plant(A=[[1.10, 1.00], [0.00, 1.02]], B=[[0.20], [0.50]])
INITIAL, LIMITS, AROUND = Box([-0.8, -0.8], [0.8, 0.8]), Box([-1.0], [1.0]), Box([-4.0, -2.5], [4.0, 2.5])
SPEC = Spec(Q=np.eye(2), R=0.05, discount=0.98, initial=INITIAL, inputs=LIMITS)
LQR = discounted_lqr(PLANT, SPEC)[0]
LAW = INC.saturated(LQR, 1.0)


def motions(gain: INC) -> None:
    """Draw the phase portrait and motions of two laws in the same axes, with their limits."""
    certificate = certify(PLANT, LAW, Attraction(LIMITS, directions=INITIAL.vertices))
    starts = np.column_stack([INITIAL.vertices, [[3.4, -3.4], [-0.4, 0.2]], [[3.8, -3.8], [1.2, -1.2]]])
    draw.plot_phase_portrait(PLANT, LAW, AROUND, initial=INITIAL, certificate=certificate, starts=starts,
                             path="phase_portrait.png")
    runs = {name: simulate(PLANT, law, [0.8, 0.8], steps=25) for name, law in (("clipped LQR", LAW), ("best gain", gain))}
    draw.plot_trajectories(runs, LIMITS, "trajectories.png")
    draw.plot_reachable(reachable(PLANT, LAW, INITIAL, 5), path="reachable.png")
    basin = region_of_attraction(PLANT, LAW, AROUND, LIMITS, budget=Budget(pieces=500))
    draw.plot_attraction(basin, {"ellipsoid by matrix inequalities": certificate}, converging(PLANT, LAW, AROUND, 81),
                         path="attraction.png")


def law_and_cost(gain: INC) -> None:
    """Draw the regions of the law, its difference from another, and its cost from every start."""
    draw.plot_regions(regions(PLANT, LAW, INITIAL), "regions.png")
    draw.plot_difference(largest_difference(LAW, gain, INITIAL), "difference.png")
    draw.plot_cost(certify(PLANT, LAW, Regional(INITIAL, LIMITS, SPEC.Q, SPEC.R, SPEC.discount)), "cost.png")
    draw.plot_separation(ScalarSeparation(0.9), path="separation.png")


def search(gain: INC) -> Figures:
    """Draw how laws are found: a training, an alternation, all attempts of a synthesis."""
    trained = train(PLANT, SPEC, linear_start(gain.K, PLANT, SPEC, hidden=4), horizon=15, max_iterations=20)
    draw.plot_training(trained, "training.png")
    start = INC([[0.2, -0.1], [0.1, 0.0]], [[0.3, 0.1], [-0.2, -0.4]], [[0.2, 0.3]], [[-0.6, -1.2]])
    descent = alternate(PLANT, start, DiscountedCost(SPEC.Q, SPEC.R, SPEC.discount, INITIAL), max_rounds=12)
    draw.plot_alternation(descent, "alternation.png")
    result = synthesize(PLANT, SPEC, hidden=0, verbose=False)
    draw.plot_training(result, "attempts.png")
    result.plot("result.png")
    return {"training lowers the estimate": float(trained.improved),
            "alternation lowers the certified cost": float(descent.improvement > 0.01),
            "certified cost of the synthesis": result.cost}


def main() -> tuple[Figures, Figures]:
    """Draw all pictures, and return computed and expected figures by name."""
    best = best_static_gain(PLANT, SPEC)
    gain = INC.linear(best.F)
    motions(gain)
    law_and_cost(gain)
    found = compare(PLANT, SPEC, {"clipped LQR": LAW, "best linear found": best_dynamic_linear(PLANT, SPEC),
                                  "best gain found": best, "LQR without limits": LQR}, prove=True)
    found.plot("comparison.png")
    draw.plot_intervals(found, "intervals.png")
    computed = search(gain) | {"cost of the clipped LQR": found.cost_of("clipped LQR"),
                               "linear controllers cost at least": float(found.floor("linear").value)}  # type: ignore[union-attr]
    expected = {
        "training lowers the estimate": 1.0,
        "alternation lowers the certified cost": 1.0,
        "certified cost of the synthesis": 1.3649619,
        "cost of the clipped LQR": 1.3649619,
        "linear controllers cost at least": 2.116763,
    }
    print("\n".join(f"{name}: {value:.6g}" for name, value in computed.items()))
    return computed, expected


if __name__ == "__main__":
    main()
