"""Plain-NumPy answers that share no code with the package: formulas typed again, Picard iteration, roll-outs."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize


def phi(unit, z):
    """The activation's value, typed here once more and chosen by the name of its class."""
    name = type(unit).__name__
    if name == "ReLU":
        return np.where(z > 0, z, 0.0)
    if name == "LeakyReLU":
        return np.where(z > 0, z, unit.slope * z)
    if name == "Saturation":
        return np.clip(z, -1.0, 1.0)
    if name == "Tanh":
        return np.tanh(z)
    if name == "CenteredLogistic":
        return 1.0 / (1.0 + np.exp(-z)) - 0.5
    if name == "Logistic":
        return 1.0 / (1.0 + np.exp(-z))
    if name == "Identity":
        return z
    return unit(z)


def hidden(inc, y, iterations=400):
    """eta of eta = phi(W eta + U y + b) for columns y (p, N), by Picard iteration from zero."""
    eta = np.zeros((inc.W.shape[0], y.shape[1]))
    for _ in range(iterations):
        z = inc.W @ eta + inc.U @ y + inc.b[:, None]
        new = np.array([phi(unit, z[i]) for i, unit in enumerate(inc.activations)]).reshape(eta.shape)
        if np.all(np.abs(new - eta) <= 1e-15 * (1 + np.max(np.abs(new), initial=0.0))):
            break
        eta = new
    return eta


def control(inc, y):
    """u of the controller for columns y (p, N)."""
    return inc.K @ y + inc.V @ hidden(inc, y) + inc.d[:, None]


def roll_out(plant, inc, x0, steps):
    """States (n, N, steps + 1) and inputs (m, N, steps + 1) of a discrete loop from columns x0 (n, N)."""
    xs, us, x = [], [], np.asarray(x0, dtype=float)
    for _ in range(steps + 1):
        u = control(inc, plant.C @ x)
        xs.append(x)
        us.append(u)
        x = plant.A @ x + plant.B @ u
    return np.stack(xs, axis=-1), np.stack(us, axis=-1)


def flow(plant, inc, x0, duration, steps):
    """States (n, N, steps + 1) of a continuous loop by the classical Runge-Kutta method."""
    def velocity(x):
        return plant.A @ x + plant.B @ control(inc, plant.C @ x)

    h, x = duration / steps, np.asarray(x0, dtype=float)
    xs = [x]
    for _ in range(steps):
        k1 = velocity(x)
        k2 = velocity(x + h / 2 * k1)
        k3 = velocity(x + h / 2 * k2)
        k4 = velocity(x + h * k3)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        xs.append(x)
    return np.stack(xs, axis=-1)


def discounted_cost(x, u, Q, R, discount):
    """The discounted sums (N,) of x'Qx + u'Ru over the listed steps, x (n, N, T+1) and u (m, N, T+1)."""
    weights = discount ** np.arange(x.shape[-1])
    return (np.einsum("int,ij,jnt->nt", x, Q, x) + np.einsum("int,ij,jnt->nt", u, R, u)) @ weights


def quadratic(P, x):
    """x'P x over the first axis of x."""
    return np.einsum("i...,ij,j...->...", x, P, x)


def least_sequence(plant, spec, P, x0, T):
    """The best T moves within a box by a general method, on the discounted cost written out again: SciPy's result."""
    def cost(flat):
        x, total = x0, 0.0
        for k, u in enumerate(flat.reshape(T, plant.m)):
            total += spec.discount**k * (x @ spec.Q @ x + u @ spec.R @ u)
            x = plant.A @ x + plant.B @ u
        return total + spec.discount**T * (x @ P @ x)
    bounds = list(zip(np.tile(spec.inputs.lower, T), np.tile(spec.inputs.upper, T), strict=True))
    return minimize(cost, np.zeros(T * plant.m), bounds=bounds, method="L-BFGS-B", options={"ftol": 1e-15, "gtol": 1e-10})
