"""A plant in continuous time: training by collocation, a certified region, and what a sampled controller would cost.

A double integrator (position in m, velocity in m/s) with |u| <= 1 m/s^2 and cheap inputs. The regulator clipped at these
limits brakes too late and overshoots; a network of four hidden units brakes in time. On motions of the law itself it costs
about 18 % less, and the ellipsoid from which it is proved to converge is larger than the regulator's.
"""

from __future__ import annotations

import numpy as np

from inc_casadi import INC, Attraction, Box, DiscountedCost, Plant, Spec, certify
from inc_casadi.sampled import sample
from synthesis.continuous_setup import continuous_lqr
from synthesis.continuous_training import train_continuous
from synthesis.starts.random_start import linear_start


def main() -> tuple[dict[str, float], dict[str, float]]:
    """Print the costs and proofs, and return computed and expected figures by name."""
    plant = Plant(A=[[0.0, 1.0], [0.0, 0.0]], B=[[0.0], [1.0]], dt=0)
    spec = Spec(Q=np.diag([1.0, 0.0]), R=0.01, discount=0.95, initial=Box([-4.0, -2.0], [4.0, 2.0]),
                inputs=Box([-1.0], [1.0]))                             # Q, R and discount are per second
    K, P = continuous_lqr(plant, spec)
    trained = train_continuous(plant, spec, linear_start(K, plant, spec, hidden=4), horizon=10.0, steps=20,
                               max_iterations=25)
    clipped = certify(plant, INC.saturated(K, 1.0), Attraction(inputs=spec.inputs)).require()
    region = certify(plant, trained.inc, Attraction(inputs=spec.inputs)).require()
    print(f"clipped regulator: cost {trained.start_cost:.6g}; trained: {trained.cost:.6g} ({trained.status})")
    print(f"certified regions: {clipped.volume:.4g} and {region.volume:.4g}; {region.prove()}")

    free = certify(plant, INC.linear(K), DiscountedCost(spec.Q, spec.R, spec.discount, spec.initial)).require()
    held = sample(plant, spec, 0.2)
    print(f"without limits the regulator costs {free.bound:.6g} at most, certified; with its input held for 0.2 s "
          f"{held.cost(K):.6g}")
    computed = {
        "clipped regulator, simulated": trained.start_cost,
        "the trained law costs at least a tenth less": float(trained.cost < 0.9 * trained.start_cost),
        "its region is settled rigorously": float(region.prove().succeeded),
        "regulator without limits, certified": free.bound,
        "the same held for 0.2 s": held.cost(K),
    }
    expected = {
        "clipped regulator, simulated": 14.7189,
        "the trained law costs at least a tenth less": 1.0,
        "its region is settled rigorously": 1.0,
        "regulator without limits, certified": float(np.trace(P @ spec.initial.second_moment)),
        "the same held for 0.2 s": 2.837817,
    }
    return computed, expected


if __name__ == "__main__":
    print(main())
