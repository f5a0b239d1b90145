"""Small problems to train on, cheap and without symmetry, and what laws truly cost there."""

import numpy as np
import oracles

from inc_casadi import Box, Plant, Spec
from synthesis.objective import Objective
from synthesis.rollout import Parameters
from synthesis.starts.random_start import random_start
from synthesis.training_setup import setup


def small(p=2, inputs=None):
    """Two states, one limited input, output feedback for p = 1."""
    C = None if p == 2 else [[1.0, 0.5]]
    plant = Plant([[1.0, 0.2], [0.0, 1.0]], [[0.02], [0.2]], C)
    return plant, Spec(np.eye(2), 0.1, 0.95, Box([-2.0, -1.0], [2.0, 1.0]), inputs or Box(-1, 0.5))


def posed(hidden=3, p=2, frozen=(), seed=1, kappa=0.6, order=4, horizon=10, anchored=True, unit=None):
    """The objective of the small problem from a random start, and that start."""
    plant, spec = small(p)
    start = random_start(plant, spec, hidden, unit, kappa=kappa, seed=seed)
    problem = setup(plant, spec, start, kappa=kappa, horizon=horizon, order=order, anchored=anchored, frozen=frozen,
                    terminal=None, seed=0)
    return Objective(problem.scenario(130), problem.layout, problem.scale), Parameters.of(start)


def true_cost(plant, spec, inc, order=11, steps=60):
    """The cost by plain simulation, with the states and inputs met."""
    nodes, weights = spec.initial.quadrature(order)
    x, u = oracles.roll_out(plant, inc, nodes, steps)
    return float(oracles.discounted_cost(x, u, spec.Q, spec.R, spec.discount) @ weights), x, u
