"""Bring your own plant: an inverted pendulum with a weak motor, from physics to a certified digital controller.

Four steps: write the continuous-time model (a python-control StateSpace does), sample it, say what is asked, and
synthesize. The motor is too weak for a linear controller to be good: near the upright position it must be gentle so
as not to exceed the torque limit from the corners of the set of starts.
"""

from __future__ import annotations

import sys
from pathlib import Path

import control
import numpy as np

from inc_casadi import Box, Plant, Spec, Uniform, simulate
from inc_casadi.plotting import plot_trajectories
from synthesis import synthesize

Figures = dict[str, float]

GRAVITY, LENGTH, MASS = 9.81, 0.5, 0.2  # m/s^2, m, kg
TORQUE = 0.4  # N m; holding the pendulum at 0.2 rad takes 0.196 N m
PERIOD = 0.05  # s


def pendulum() -> control.StateSpace:
    """Return the pendulum about the upright position: x = (angle in rad, rate in rad/s), u = torque in N m.

    Linearized from m l^2 x'' = m g l sin(x) + u.
    """
    A = [[0.0, 1.0], [GRAVITY / LENGTH, 0.0]]
    B = [[0.0], [1.0 / (MASS * LENGTH**2)]]
    return control.ss(A, B, np.eye(2), np.zeros((2, 1)))


def main(picture: str | Path = "pendulum.png") -> tuple[Figures, Figures]:
    """Print the table, draw the result and one motion, and return computed and expected figures by name."""
    plant = Plant.from_control(pendulum()).sampled(PERIOD)
    spec = Spec(
        Q=np.diag([10.0, 1.0]), R=1.0, discount=0.99,  # per step
        initial=Uniform(Box([-0.2, -0.5], [0.2, 0.5])),
        inputs=Box([-TORQUE], [TORQUE]),
    )

    result = synthesize(plant, spec, hidden=0).require()  # 0: no training, the clipped regulator is judged

    print()
    print(result)
    picture = Path(picture)
    result.plot(picture)
    corner = simulate(plant, result.inc, [0.2, 0.5], steps=60)
    plot_trajectories(corner, spec.inputs, picture.with_name(f"{picture.stem}_motion{picture.suffix}"))
    print(f"pictures: {picture} and its companion _motion")

    computed = {
        "unstable eigenvalue": float(np.max(np.linalg.eigvals(plant.A).real)),
        "certified cost": result.cost,
        "certified worst cost": result.worst,
        "every linear controller costs at least": float(result.bounds["linear controllers"]),
        "largest torque from the corner": float(np.max(np.abs(corner.u))),
        "upright after 3 s": float(np.max(np.abs(corner.x[:, -1])) < 1e-3),
    }
    expected = {
        "unstable eigenvalue": float(np.exp(np.sqrt(GRAVITY / LENGTH) * PERIOD)),
        "certified cost": 1.3295273,
        "certified worst cost": 6.6835,
        "every linear controller costs at least": 1.592379,
        "largest torque from the corner": TORQUE,
        "upright after 3 s": 1.0,
    }
    return computed, expected


if __name__ == "__main__":
    main(*sys.argv[1:2])
