"""Random plants under random linear dynamic controllers, and their motions step by step."""

from __future__ import annotations

import numpy as np

from inc_casadi import Box, Plant, Spec
from inc_casadi.linear.controller import LinearController


def rolled(plant, controller, x, steps):
    """States (steps, n, N) and inputs (steps, m, N) from the columns of x, straight from the definitions."""
    states, inputs, xi = [], [], np.tile(controller.xi_0[:, None], (1, x.shape[1]))
    for _ in range(steps):
        y = plant.C @ x
        u = controller.C_c @ xi + controller.D_c @ y
        states.append(x)
        inputs.append(u)
        x, xi = plant.A @ x + plant.B @ u, controller.A_c @ xi + controller.B_c @ y
    return np.array(states), np.array(inputs)


def summed(plant, spec, controller, x, steps=2000):
    """The discounted cost (N,) of motions from the columns of x, summed up."""
    states, inputs = rolled(plant, controller, x, steps)
    stage = np.sum(states * (spec.Q @ states), axis=1) + np.sum(inputs * (spec.R @ inputs), axis=1)
    return spec.discount ** np.arange(steps) @ stage


def expected(plant, spec, controller, steps=2000):
    """The expected cost: a quadrature that is exact for quadratics, of summed motions."""
    nodes, weights = spec.initial.quadrature(2)
    return float(summed(plant, spec, controller, nodes, steps) @ weights)


def case(seed, n=3, m=2, p=None, radius=1.05, discount=0.95, size=0.3):
    """A plant, unstable by default, and a spec with asymmetric limits and an initial box off the origin."""
    rng = np.random.default_rng(seed)
    A, root = rng.standard_normal((n, n)), rng.standard_normal((n, n))
    A *= radius / np.max(np.abs(np.linalg.eigvals(A)))
    plant = Plant(A, rng.standard_normal((n, m)), None if p is None else rng.standard_normal((p, n)))
    middle, half = 0.1 * size * rng.standard_normal(n), size * rng.uniform(0.5, 1.0, n)
    spec = Spec(root @ root.T, np.diag(rng.uniform(0.05, 1.0, m)), discount, Box(middle - half, middle + half),
                Box(-rng.uniform(0.6, 1.0, m), rng.uniform(0.6, 1.0, m)))
    return plant, spec


def controller(seed, m=2, p=4, order=3, gain=0.01):
    """A stable controller of small gain that starts off its origin."""
    rng = np.random.default_rng(seed)
    A_c = rng.standard_normal((order, order))
    A_c *= 0.7 / np.max(np.abs(np.linalg.eigvals(A_c)))
    return LinearController(A_c, rng.standard_normal((order, p)), gain * rng.standard_normal((m, order)),
                            gain * rng.standard_normal((m, p)), rng.standard_normal(order))
