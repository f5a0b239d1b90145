"""The main job: plant and specification in, a controller with proof and a comparison out.

The plant is the two-state example of the paper: unstable, with a limited input. A linear controller must be timid
everywhere so as to keep the limit at the corners; the controller found here is not linear, and what is said of it is
proved: its cost, its limits, and that no linear controller comes near it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from inc_casadi import Box, Plant, Spec, Uniform
from synthesis import synthesize

Figures = dict[str, float]


def main(picture: str | Path = "two_state.png", hidden: int = 8) -> tuple[Figures, Figures]:
    """Print the table, draw the picture, and return computed and expected figures by name."""
    plant = Plant(A=[[1.10, 1.00], [0.00, 1.02]], B=[[0.20], [0.50]])
    spec = Spec(
        Q=np.eye(2), R=0.05, discount=0.98,
        initial=Uniform(Box([-0.8, -0.8], [0.8, 0.8])),
        inputs=Box([-1.0], [1.0]),
    )

    result = synthesize(plant, spec, hidden=hidden)

    print()
    print(result)
    result.plot(picture)
    print(f"picture: {picture}")

    computed = {
        "certified cost": result.require().cost,
        "every linear controller costs at least": float(result.bounds["linear controllers"]),
        "every controller costs at least": float(result.bounds["any controller"]),
        "best static linear gain": result.linear["best static linear gain"],
        "scaled LQR gain": result.linear["scaled LQR gain"],
    }
    expected = {
        "certified cost": 1.3649619,  # of the clipped LQR; nothing below the bound for every controller is possible
        "every linear controller costs at least": 2.11676,
        "every controller costs at least": 1.3648,
        "best static linear gain": 3.3472,
        "scaled LQR gain": 3.5639,
    }
    return computed, expected


if __name__ == "__main__":
    main(*sys.argv[1:2])
