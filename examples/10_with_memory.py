"""Where the state is not measured: a controller with memory, proved, and proved to be nearly the best there is.

A cart of which only the position is measured (a double integrator), |u| <= 1/2. No static law brings it to rest. Every
linear controller, of any order, costs at least 2.0999. An observer that knows the clipped input, with one gain all the time,
costs 1.5284. `synthesize_dynamic` begins with the Kalman filter of the unknown start, whose gain differs from step to step:
an INC can count steps, so it is one. That costs 1.2275, and training lowers it to 1.2016, where no controller whatever,
however it uses the measurements, costs less than 1.2011.
"""

from __future__ import annotations

import numpy as np

from inc_casadi import Box, Plant, Spec
from inc_casadi.dynamic import filter_gains
from synthesis import synthesize_dynamic
from synthesis.no_gain import no_stabilizing_gain

STARTS = ("observer with noise 0.01, clipped LQR", "filter, clipped LQR")


def main() -> tuple[dict[str, float], dict[str, float]]:
    """Print costs, bounds and proofs, and return computed and expected figures by name."""
    plant = Plant(A=[[1.0, 1.0], [0.0, 1.0]], B=[[0.5], [1.0]], C=[[1.0, 0.0]])  # the position alone is measured
    spec = Spec(Q=np.eye(2), R=0.1, discount=0.95, initial=Box([-1.0, -0.5], [1.0, 0.5]), inputs=Box([-0.5], [0.5]))
    print(no_stabilizing_gain(plant).split(":")[0])
    result = synthesize_dynamic(plant, spec, hidden=0, starts=STARTS, training_iterations=20,
                                training_seconds=60.0, verbose=False)
    print(result)
    steady, filtered = (one.cost for one in result.history[:2])
    print(f"one gain all the time: {steady:.6f}; the filter's: {filtered:.6f}; trained from it: {result.cost:.6f}")

    computed = {
        "gains of the filter": float(len(filter_gains(plant, spec))),
        "steady observer": steady,
        "scheduled observer": filtered,
        "training pays": float(result.cost < 0.985 * filtered),
        "within 0.5 % of the bound on any controller": float(result.cost < 1.005 * float(result.bounds["any controller"])),
        "settled rigorously": float(bool(result.proof)),
        "every linear controller": float(result.bounds["linear controllers"]),
    }
    expected = {
        "gains of the filter": 2.0,
        "steady observer": 1.528446,
        "scheduled observer": 1.227457,
        "training pays": 1.0,
        "within 0.5 % of the bound on any controller": 1.0,
        "settled rigorously": 1.0,
        "every linear controller": 2.099943,
    }
    return computed, expected


if __name__ == "__main__":
    main()
