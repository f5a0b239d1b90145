"""Where inputs stay saturated for several steps, a trained network is proved better than the clipped LQR.

A double integrator (dt = 1 s, position in m, velocity in m/s) with |u| <= 0.5 m/s^2 and initial states over a wide box: the
clipped LQR costs 14.646, the trained law is certified at 14.598, and no controller whatever gets under 14.5975.
"""

from __future__ import annotations

import sys

import numpy as np

from inc_casadi import Box, Plant, Spec
from synthesis import synthesize


def main(picture: str = "training_pays.png") -> tuple[dict[str, float], dict[str, float]]:
    """Print the table, draw the picture, and return computed and expected figures by name."""
    plant = Plant(A=[[1.0, 1.0], [0.0, 1.0]], B=[[0.5], [1.0]])
    spec = Spec(Q=np.eye(2), R=[[0.1]], discount=0.95, initial=Box([-3.0, -1.5], [3.0, 1.5]), inputs=Box([-0.5], [0.5]))
    result = synthesize(plant, spec, hidden=8)
    print(result)
    result.require().plot(picture)

    clipped = next(one for one in result.history if one.name == "clipped LQR")
    assert clipped.verdict is not None and result.proof is not None
    computed = {
        "clipped LQR, certified": clipped.verdict.cost,
        "trained, certified": result.cost,
        "every controller costs at least": float(result.bounds["any controller"]),
        "settled rigorously": float(result.proof.succeeded),
    }
    expected = {
        "clipped LQR, certified": 14.646053,
        "trained, certified": 14.598,
        "every controller costs at least": 14.59755,
        "settled rigorously": 1.0,
    }
    return computed, expected


if __name__ == "__main__":
    print(main(*sys.argv[1:2]))
